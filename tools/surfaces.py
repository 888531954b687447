"""Colours of values, of a surface or a tactile image, and distances from the true surface.

Values become colours by viridis, which keeps its order in print and for colour-blind readers: on a
surface from light, where the value is 0, to dark, so that light and shade still show the shape; in
a tactile image from dark to light. What has one colour has it from `palpate.launch.COLOURS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core import geometry
from palpate.core.arrays import Floats
from palpate.messages.types import Truth

Colours = NDArray[np.uint8]
QUANTILE = 0.98  # Of the values, from which on all have the last colour
LEAST_TOP = 1e-6  # Of a scale, m
ROUND = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)


@dataclass(slots=True)
class TruthSurface:
    """The true surface, made ready for the search when somebody first asks."""

    truth: Truth
    _search: geometry.NearestSearch | None = field(default=None, repr=False)

    def deviations(self, points: Floats) -> Floats:
        """Distances (n,) of points (n, 3) from the true surface, m."""
        if self._search is None:
            corners = geometry.triangle_corners(self.truth.vertices, self.truth.faces)
            self._search = geometry.nearest_search(corners)
        return geometry.nearest_points(self._search, points).distances


class VertexColours(NamedTuple):
    """Colours of a mesh, and what they mean."""

    name: str  # Of the scalar
    top: float  # From which on all have the last colour, m
    colours: Colours  # (n, 3)


def vertex_colours(scalars: Mapping[str, Floats]) -> VertexColours | None:
    """Colours by the first of the scalars; None without any."""
    for name, values in scalars.items():
        top = scale_top(values)
        return VertexColours(name, top, shades(values, top))
    return None


def scale_top(values: Floats) -> float:
    """Value from which on all have the last colour: a round one, over nearly all that are there."""
    top = max(float(np.quantile(values, QUANTILE)) if len(values) else 0.0, LEAST_TOP)
    power = 10.0 ** np.floor(np.log10(top))
    return float(power * next(one for one in ROUND if one * power >= 0.999 * top))


def shades(values: Floats, top: float) -> Colours:
    """Colours (n, 3) on a surface of values (n,) from 0, which is light, to `top`, dark."""
    return viridis(top - np.clip(values, 0.0, top), top)


def viridis(values: Floats, top: float) -> Colours:
    """Colours (n, 3) of values (n,) from 0, which is dark, to `top`, light."""
    shares = np.clip(values / top, 0.0, 1.0) * (len(_VIRIDIS) - 1)
    whole = np.minimum(shares.astype(np.intp), len(_VIRIDIS) - 2)
    rest = (shares - whole)[:, None]
    mixed = (1.0 - rest) * _VIRIDIS[whole] + rest * _VIRIDIS[whole + 1]
    return np.asarray(np.rint(mixed), np.uint8)


def thinned(
    vertices: Floats, faces: NDArray[np.int32], most: int
) -> tuple[NDArray[np.intp], NDArray[np.int32]]:
    """Some of the vertices (n, 3), by number, and at most so many triangles (m, 3) over them.

    Of all vertices in a cell of space the one next to their middle stays (Rossignac and Borrel,
    1993), so that what is kept lies on the surface.
    """
    kept, groups = np.arange(len(vertices)), faces
    spread = np.ptp(vertices, axis=0)
    cell = np.sqrt(spread @ np.roll(spread, 1) * 2.0 / most) if len(faces) > most else 0.0
    while len(groups) > most:
        _, cells, counts = np.unique(
            np.floor(vertices / cell).astype(np.int64),
            axis=0,
            return_inverse=True,
            return_counts=True,
        )
        cells = cells.ravel()
        sums = [np.bincount(cells, vertices[:, i]) for i in range(3)]
        off = np.linalg.norm(vertices - np.column_stack(sums)[cells] / counts[cells, None], axis=1)
        kept = np.lexsort((off, cells))[np.cumsum(counts) - counts]
        groups = cells[faces].astype(np.int32)
        groups = groups[(groups != np.roll(groups, 1, axis=1)).all(axis=1)]
        cell *= 1.1
    return kept, groups


def hex_colour(value: float, top: float) -> str:
    """Colour of one value as ``#rrggbb``, as `viridis` has it."""
    return "#" + viridis(np.array([value]), top).tobytes().hex()


def css_ramp(*, of_surface: bool) -> str:
    """CSS gradient of the scale of values on a surface, or of a tactile image; 0 is at the left."""
    values = np.linspace(1.0, 0.0, 17) if of_surface else np.linspace(0.0, 1.0, 17)
    return f"linear-gradient(to right, {', '.join(hex_colour(one, 1.0) for one in values)})"


# Every sixteenth of the 256 colours of viridis (van der Walt and Smith, 2015), and the last.
_VIRIDIS = np.frombuffer(
    bytes.fromhex(
        "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c "
        "1fa088 28ae80 3fbc73 5ec962 84d44b addc30 d8e219 fde725"
    ),
    np.uint8,
).reshape(-1, 3)
