"""Units of length of files that state none."""

from __future__ import annotations

import re
from collections.abc import Mapping

from palpate.core.plugins import LENGTHS

METRES_PER_UNIT: Mapping[str, float] = LENGTHS
LIKELY_UNITS = ("m", "mm")  # among which a unit is guessed
OWN_UNITS = {".stl": "mm"}  # units in which palpate writes formats; m for all others


def guess_unit(
    suffix: str, extent: float, min_size: float = 0.02, max_size: float = 1.0
) -> str | None:
    """The unit of a mesh with a largest extent in that unit; None if several units are likely.

    GLB is in m, by its definition. For other files a unit is likely if the object then has a size
    from `min_size` to `max_size` [m], which a hand can grip.
    """
    if suffix == ".glb":
        return "m"
    sizes = {unit: METRES_PER_UNIT[unit] * extent for unit in LIKELY_UNITS}
    likely = [unit for unit, size in sizes.items() if min_size <= size <= max_size]
    return likely[0] if len(likely) == 1 else None


# A unit after the name of a column: "X [mm]", "x (mm)", "x_mm", "x/mm".
_COLUMN_UNIT = re.compile(rf"(?:[\s_/]+|[\s_/]*[\[(])\s*({'|'.join(METRES_PER_UNIT)})\s*[\])]?$")


def column_name(header: str) -> str:
    """The name of a column in lower case, without quotes and unit."""
    name = header.strip().strip('"').strip().lower()
    return _COLUMN_UNIT.sub("", name) or name
