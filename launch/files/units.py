"""Units of length of files that tell none: one table for all verbs."""

from __future__ import annotations

import re
from collections.abc import Mapping

from palpate.core.plugins import LENGTHS

METRES_PER_UNIT: Mapping[str, float] = LENGTHS
LIKELY_UNITS = ("m", "mm")  # Units that are guessed
OWN_UNITS = {".stl": "mm"}  # Unit in which palpate writes a format, where that is not m
MIN_HAND_SIZE, MAX_HAND_SIZE = 0.02, 1.0  # Largest extents of objects that hands grip, m


def guess_unit(suffix: str, extent: float) -> str | None:
    """The unit of a mesh of a largest extent, in its own unit; None if none is likely alone.

    GLB is in m, by its definition; others are in the one that makes the object one for hands.
    """
    if suffix == ".glb":
        return "m"
    likely = [
        unit
        for unit in LIKELY_UNITS
        if MIN_HAND_SIZE <= METRES_PER_UNIT[unit] * extent <= MAX_HAND_SIZE
    ]
    return likely[0] if len(likely) == 1 else None


# A unit behind the name of a column: "X [mm]", "x (mm)", "x_mm", "x/mm".
_COLUMN_UNIT = re.compile(rf"(?:[\s_/]+|[\s_/]*[\[(])\s*({'|'.join(METRES_PER_UNIT)})\s*[\])]?$")


def column_name(header: str) -> str:
    """The name of a column in small letters, without quotes and without its unit."""
    name = header.strip().strip('"').strip().lower()
    return _COLUMN_UNIT.sub("", name) or name
