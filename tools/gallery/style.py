"""Solids drawn into panels of a figure. Values on them have the colours of viridis.

Solids are drawn by the rasteriser: matplotlib sorts triangles by their middles, and shows
what lies behind.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from palpate.core.arrays import Floats, Ints
from palpate.core.shapes import Mesh
from palpate.launch import charts
from palpate.launch.colours import rgb as rgb_of
from palpate.tools.view.rasteriser import FINER, Camera, Canvas

WIDTH, DPI = 7.0, 100  # Of a figure [inch], and its pixels an inch as a file
SOLID = rgb_of("solid")
MARGIN = 1.08  # Around what a camera is fitted to, times its extent
OPENING = 10.0  # Of cameras, degrees: nearly parallel rays
OBLIQUE, FROM_SIDE, FROM_TOP = (-63.0, 22.0), (-90.0, 0.0), (-90.0, 90.0)  # Azimuth, elevation
styled = matplotlib.rc_context({**charts.STYLE, "text.parse_math": True})  # decorates what draws
Draw = Callable[[Canvas], None]  # Draws something into a canvas


def new_figure(height: float) -> Figure:
    """An empty figure of the common width and a height in inches."""
    return charts.new_figure(*(charts.PIXELS_PER_INCH * side for side in (WIDTH, height)))


def rgb(colour: str) -> Floats:
    """Red, green and blue (3,), 0 to 255, of ``#rrggbb``."""
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)], dtype=np.float64)


def fitted_camera(points: Floats, view: tuple[float, float], shape: tuple[int, int]) -> Camera:
    """The camera that has points (n, 3) as large as a picture of (height, width) pixels allows.

    `view`: azimuth and elevation of the eye, degrees.
    """
    axes = Camera(np.zeros(3), 1.0, *view).axes()
    seen = points @ axes.T
    middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    off = np.abs(seen - middle)[:, :2] * MARGIN
    opened = np.tan(np.radians(0.5 * OPENING)) * np.array([shape[1] / shape[0], 1.0])
    distance = (off / opened).max(axis=1) + (seen - middle)[:, 2]
    return Camera(middle @ axes, float(distance.max()), *view, opening=OPENING)


def show_solid(
    axes: Axes,
    draw: Draw,
    around: Floats,
    view: tuple[float, float] = OBLIQUE,
    *,
    shape: tuple[int, int],
    title: str = "",
) -> Canvas:
    """Fill a panel with what `draw` draws, seen so that points `around` (n, 3) have room.

    `view`: azimuth and elevation, degrees. `shape`: of the panel, (height, width) in pixels.
    Returns what was drawn into.
    """
    canvas = Canvas(shape[1], shape[0], fitted_camera(around, view, shape))
    draw(canvas)
    axes.imshow(canvas.image())
    axes.set_axis_off()
    axes.set_title(title)
    return canvas


def label_points(axes: Axes, canvas: Canvas, labels: Mapping[str, Sequence[float]]) -> None:
    """Write letters at places (3,) of what a panel shows."""
    height, width = canvas.height, canvas.width
    flat = canvas.project(np.array(list(labels.values())))[:, :2]
    for text, place in zip(labels, flat / FINER, strict=True):
        axes.text(
            place[0], place[1], text, ha="center", va="center", fontsize=11, fontstyle="italic"
        )
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))


def shaded(mesh: Mesh, colour: Floats | tuple[int, int, int] = SOLID) -> Draw:
    """What draws a mesh in light."""
    return lambda canvas: canvas.draw_mesh(
        mesh.vertices, mesh.faces.astype(np.int32), np.asarray(colour)
    )


def lines(curves: Sequence[Floats] | Floats, colour: str = charts.INK, width: float = 1.0) -> Draw:
    """What draws curves (n, 3) each."""

    def draw(canvas: Canvas) -> None:
        for curve in curves:
            canvas.draw_line(curve, rgb(colour), width)

    return draw


def crosses(points: Floats, colour: str = charts.INK, radius: float = 1.3) -> Draw:
    """What draws points (n, 3) as dots; `radius` in pixels."""
    return lambda canvas: canvas.draw_points(points, rgb(colour), radius)


def together(*draws: Draw) -> Draw:
    """One after the other."""

    def draw(canvas: Canvas) -> None:
        for one in draws:
            one(canvas)

    return draw


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


def few_ticks(axes: Axes, across: int = 5, up: int = 5) -> None:
    """Round values, and no more than so many steps between them."""
    axes.xaxis.set_major_locator(MaxNLocator(across))
    axes.yaxis.set_major_locator(MaxNLocator(up))
