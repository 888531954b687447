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


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaleSettings:
    """How the top of a scale of colours follows from the values on a surface."""

    quantile: float = 0.98  # of the values; values above the top have the last colour
    min_top: float = 1e-6  # [m] smallest top
    mantissas: tuple[float, ...] = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # of a round top


DEFAULT_SCALE = ScaleSettings()


@dataclass(slots=True)
class TruthSurface:
    """The true surface, whose search tree is built with the first question."""

    truth: Truth
    _search: geometry.NearestSearch | None = field(default=None, repr=False)

    def deviations(self, points: Floats) -> Floats:
        """Distances (n,) of points (n, 3) from the true surface [m]."""
        if self._search is None:
            corners = geometry.triangle_corners(self.truth.vertices, self.truth.faces)
            self._search = geometry.nearest_search(corners)
        return geometry.nearest_points(self._search, points).distances


class VertexColours(NamedTuple):
    """Colours of a mesh, and their scale."""

    name: str  # of the scalar
    top: float  # value from which on all have the last colour [m]
    colours: Colours  # (n, 3)


def vertex_colours(scalars: Mapping[str, Floats]) -> VertexColours | None:
    """Colours by the first of the scalars; None without any."""
    for name, values in scalars.items():
        top = scale_top(values)
        return VertexColours(name, top, shades(values, top))
    return None


def scale_top(values: Floats, settings: ScaleSettings = DEFAULT_SCALE) -> float:
    """Value of the last colour [m]: a round number above nearly all of the values (n,)."""
    top = max(
        float(np.quantile(values, settings.quantile)) if len(values) else 0.0, settings.min_top
    )
    power = 10.0 ** np.floor(np.log10(top))
    return float(power * next(m for m in settings.mantissas if m * power >= 0.999 * top))


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


def tactile_colours(compression: Floats, top: float, grey: int = 236) -> Colours:
    """Colours (rows, cols, 3) of a tactile image [m]: viridis to `top`, `grey` without contact."""
    colours = viridis(compression.ravel(), top).reshape(*compression.shape, 3)
    colours[compression <= 0.0] = grey
    return colours


def thinned(
    vertices: Floats, faces: NDArray[np.int32], max_faces: int
) -> tuple[NDArray[np.intp], NDArray[np.int32]]:
    """Indices (k,) of some of the vertices (n, 3), and at most `max_faces` triangles over them.

    Of the vertices in a cell of space the one closest to their mean is kept (Rossignac and Borrel,
    1993), so that the kept vertices lie on the surface.
    """
    kept, groups = np.arange(len(vertices)), faces
    spread = np.ptp(vertices, axis=0)
    too_many = len(faces) > max_faces
    cell = np.sqrt(spread @ np.roll(spread, 1) * 2.0 / max_faces) if too_many else 0.0
    while len(groups) > max_faces:
        _, cells, counts = np.unique(
            np.floor(vertices / cell).astype(np.int64),
            axis=0,
            return_inverse=True,
            return_counts=True,
        )
        cells = cells.ravel()
        sums = [np.bincount(cells, vertices[:, i]) for i in range(3)]
        distances = np.linalg.norm(
            vertices - np.column_stack(sums)[cells] / counts[cells, None], axis=1
        )
        kept = np.lexsort((distances, cells))[np.cumsum(counts) - counts]
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
    return f"linear-gradient(to right, {', '.join(hex_colour(value, 1.0) for value in values)})"


# Every sixteenth of the 256 colours of viridis (van der Walt and Smith, 2015), and the last.
_VIRIDIS = np.frombuffer(
    bytes.fromhex(
        "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c "
        "1fa088 28ae80 3fbc73 5ec962 84d44b addc30 d8e219 fde725"
    ),
    np.uint8,
).reshape(-1, 3)
