"""Solids drawn into panels of a figure. Values on them have the colours of viridis.

Solids are drawn by the rasteriser: matplotlib sorts triangles by their middles, and shows
what lies behind.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from palpate.core.arrays import Floats, Ints
from palpate.core.shapes import Mesh
from palpate.launch import charts
from palpate.launch.colours import rgb as rgb_of
from palpate.tools.view.rasteriser import Camera, Canvas

SOLID = rgb_of("solid")
styled = matplotlib.rc_context({**charts.STYLE, "text.parse_math": True})  # decorator of drawings
Draw = Callable[[Canvas], None]  # Draws something into a canvas


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureLayout:
    """Sizes that all figures share."""

    width: float = 7.0  # [inch]
    dpi: int = 100  # pixels an inch in a file
    margin: float = 1.08  # extent of a panel / extent of the points that it has to show
    opening: float = 10.0  # [degrees] of cameras: nearly parallel rays


LAYOUT = FigureLayout()


class View(NamedTuple):
    """Direction from a solid to the eye [degrees]."""

    azimuth: float
    elevation: float


OBLIQUE, FROM_SIDE, FROM_TOP = View(-63.0, 22.0), View(-90.0, 0.0), View(-90.0, 90.0)


def new_figure(height: float) -> Figure:
    """An empty figure of the common width and a height in inches."""
    return charts.new_figure(*(charts.PIXELS_PER_INCH * side for side in (LAYOUT.width, height)))


def rgb(colour: str) -> Floats:
    """Red, green and blue (3,), 0 to 255, of ``#rrggbb``."""
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)], dtype=np.float64)


def fitted_camera(
    points: Floats, view: View, shape: tuple[int, int], layout: FigureLayout = LAYOUT
) -> Camera:
    """Camera that shows points (n, 3) as large as a picture of (height, width) pixels allows."""
    axes = Camera(np.zeros(3), 1.0, *view).axes()
    seen = points @ axes.T
    middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    offsets = np.abs(seen - middle)[:, :2] * layout.margin
    opened = np.tan(np.radians(0.5 * layout.opening)) * np.array([shape[1] / shape[0], 1.0])
    distance = (offsets / opened).max(axis=1) + (seen - middle)[:, 2]
    return Camera(middle @ axes, float(distance.max()), *view, opening=layout.opening)


def show_solid(
    axes: Axes,
    draw: Draw,
    around: Floats,
    view: View = OBLIQUE,
    *,
    shape: tuple[int, int],
    title: str = "",
) -> Canvas:
    """Fill a panel with what `draw` draws, with the points `around` (n, 3) in view.

    `shape`: (height, width) of the panel [pixels]. Returns the canvas.
    """
    canvas = Canvas(shape[1], shape[0], fitted_camera(around, view, shape))
    draw(canvas)
    axes.imshow(canvas.image())
    axes.set_axis_off()
    axes.set_title(title)
    return canvas


def label_points(axes: Axes, canvas: Canvas, labels: Mapping[str, Sequence[float]]) -> None:
    """Write letters at points (3,) of the solid in a panel."""
    height, width = canvas.height, canvas.width
    flat = canvas.project(np.array(list(labels.values())))[:, :2]
    for text, place in zip(labels, flat / canvas.settings.supersampling, strict=True):
        axes.text(
            place[0], place[1], text, ha="center", va="center", fontsize=11, fontstyle="italic"
        )
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))


def shaded(mesh: Mesh, colour: Floats | tuple[int, int, int] = SOLID) -> Draw:
    """Drawing of a mesh in light."""
    return lambda canvas: canvas.draw_mesh(
        mesh.vertices, mesh.faces.astype(np.int32), np.asarray(colour)
    )


def lines(curves: Sequence[Floats] | Floats, colour: str = charts.INK, width: float = 1.0) -> Draw:
    """Drawing of curves (n, 3); `width` [pixels]."""

    def draw(canvas: Canvas) -> None:
        for curve in curves:
            canvas.draw_line(curve, rgb(colour), width)

    return draw


def crosses(points: Floats, colour: str = charts.INK, radius: float = 1.3) -> Draw:
    """Drawing of points (n, 3) as discs; `radius` [pixels]."""
    return lambda canvas: canvas.draw_points(points, rgb(colour), radius)


def together(*draws: Draw) -> Draw:
    """Drawing that runs several drawings in order."""

    def draw_all(canvas: Canvas) -> None:
        for draw in draws:
            draw(canvas)

    return draw_all


def grid_lines(grid: Floats) -> list[Floats]:
    """Both families of lines of a grid of points (a, b, 3)."""
    return [*grid, *grid.transpose(1, 0, 2)]


def grid_mesh(grid: Floats) -> Mesh:
    """Triangles between a grid of points (a, b, 3)."""
    number: Ints = np.arange(grid.shape[0] * grid.shape[1], dtype=np.int32).reshape(grid.shape[:2])
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack([a, c, b], -1), np.stack([a, d, c], -1)]).reshape(-1, 3)
    return Mesh(grid.reshape(-1, 3), faces)


def box_edges(low: Floats, high: Floats) -> list[Floats]:
    """The twelve edges of an upright box as lines (2, 3)."""
    corners = np.array(np.meshgrid(*zip(low, high, strict=True), indexing="ij")).reshape(3, 8).T
    pairs = [(i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit]
    return [corners[list(pair)] for pair in pairs]


def few_ticks(axes: Axes, max_steps: int = 5) -> None:
    """Set ticks at round values, with at most `max_steps` steps between them along each axis."""
    axes.xaxis.set_major_locator(MaxNLocator(max_steps))
    axes.yaxis.set_major_locator(MaxNLocator(max_steps))
