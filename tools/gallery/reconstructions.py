"""Chapter 5 of the thesis: free-form deformation, and solids rebuilt from contours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from palpate.core.arrays import Floats
from palpate.core.geometry import close_rings
from palpate.core.shapes import Mesh, Superquadric, regular_points
from palpate.core.splines import (
    CUBIC,
    Basis,
    Lattice,
    SplineVolume,
    clamped_basis,
    upright_parallelepiped,
)
from palpate.core.thesis import ThesisSolid, rebuild_thesis
from palpate.launch import charts
from palpate.tools.gallery import style

ELLIPSOID = Superquadric(np.array([0.55, 0.55, 1.0]), np.ones(2))
LINE, SHELL, CORE = "#5a93bf", "#4a4a4a", "#f3d9a4"  # Colours of surfaces, and of lattices


@dataclass(frozen=True, slots=True, kw_only=True)
class LatticeSettings:
    """A lattice of control points around the ellipsoid, and how it is pulled.

    Lengths are in units of the ellipsoid's half height.
    """

    n_control: tuple[int, int, int] = (5, 5, 13)  # points along x, y and z
    n_tapered: int = 4  # lowest layers, which are narrowed and pulled downwards
    bottom_scale: float = 0.35  # width of the lowest layer / its width before; 1: no taper
    layer_drop: float = 0.14  # added to the gap between a tapered layer and the one above it
    layer_shift: float = 0.3  # of the layers above, alternately against x and along it
    n_rows: int = 121  # points of the ellipsoid's mesh from pole to pole
    n_columns: int = 96  # points around
    line_stride: int = 6  # rows and columns from one drawn line to the next


@dataclass(frozen=True, slots=True, kw_only=True)
class SolidLayout:
    """Mesh of an example's solid, and the lines that are drawn on it."""

    n_rows: int = 201  # points from pole to pole
    n_columns: int = 180  # points around
    n_lines: int = 27  # of equal eta, and as many of equal nu


LATTICE, SOLID = LatticeSettings(), SolidLayout()


def draw_lattice(settings: LatticeSettings = LATTICE) -> Figure:
    """Figures 5.1 to 5.4: an ellipsoid, and the lattice around it before and after it is pulled."""
    before, after = _even_control(settings), _deformed_control(settings)
    grid = _ellipsoid_grid(settings)
    shape = style.together(
        style.shaded(style.grid_mesh(grid)),
        style.lines(_sparse_lines(grid, settings.line_stride), LINE, 1.0),
    )
    inside = style.together(style.shaded(style.grid_mesh(grid)), _lattice_lines(before))
    around = np.concatenate([before.reshape(-1, 3), after.reshape(-1, 3)])
    pulled = _lattice_lines(after)
    return _in_a_row(
        around,
        ("shape (5.1)", shape, style.OBLIQUE),
        ("in its lattice (5.4)", inside, style.OBLIQUE),
        ("lattice, pulled (5.2)", pulled, style.OBLIQUE),
        ("from the side (5.3)", pulled, style.FROM_SIDE),
    )


def draw_deformation(settings: LatticeSettings = LATTICE) -> Figure:
    """Figures 5.5 to 5.8: the ellipsoid in that lattice, by B-splines and by Bernstein's."""
    by_spline, by_bernstein = (
        _deformed_grid(settings, bernstein=bernstein) for bernstein in (False, True)
    )
    around = np.concatenate([by_spline.reshape(-1, 3), by_bernstein.reshape(-1, 3)])
    solid, smooth = (style.shaded(style.grid_mesh(grid)) for grid in (by_spline, by_bernstein))
    curves = _sparse_lines(by_spline, settings.line_stride)
    lined = style.together(solid, style.lines(curves, LINE, 1.0))
    return _in_a_row(
        around,
        ("from the side (5.5)", lined, style.FROM_SIDE),
        ("B-splines (5.6)", lined, style.OBLIQUE),
        ("shaded (5.7)", solid, style.OBLIQUE),
        ("Bernstein (5.8)", smooth, style.OBLIQUE),
    )


def _in_a_row(around: Floats, *panels: tuple[str, style.Draw, style.View]) -> Figure:
    """Solids beside each other by title, drawing and view; all show the points `around`."""
    figure = style.new_figure(2.9)
    for axes, (title, draw, view) in zip(figure.subplots(1, len(panels)), panels, strict=True):
        style.show_solid(axes, draw, around, view, shape=(250, 171), title=title)
    return figure


def _bases(settings: LatticeSettings, *, bernstein: bool) -> tuple[Basis, Basis, Basis]:
    s, t, u = (clamped_basis(n, n - 1 if bernstein else CUBIC) for n in settings.n_control)
    return s, t, u


def _even_control(settings: LatticeSettings) -> Floats:
    size = ELLIPSOID.size
    return upright_parallelepiped(-size, 2.0 * size).even_control(settings.n_control)


def _deformed_control(settings: LatticeSettings) -> Floats:
    """The lattice drawn out and tapered at the bottom, and shifted to and fro above."""
    control, n_tapered = _even_control(settings), settings.n_tapered
    scale, shift = settings.bottom_scale, settings.layer_shift
    for number in range(settings.n_control[2]):
        layer = control[:, :, number]
        if number < n_tapered:
            layer[..., :2] *= scale + (1.0 - scale) * number / n_tapered
            layer[..., 2] -= settings.layer_drop * (n_tapered - number)
        else:
            layer[..., 0] += shift if number % 2 else -shift
    return control


def _deformed_grid(settings: LatticeSettings, *, bernstein: bool) -> Floats:
    """Points of the deformed ellipsoid, rows from pole to pole."""
    bases = _bases(settings, bernstein=bernstein)
    deformed, even = _deformed_control(settings), _even_control(settings)
    lattice = Lattice(SplineVolume(deformed, bases), SplineVolume(even, bases))
    grid = _ellipsoid_grid(settings)
    return lattice.deform(grid.reshape(-1, 3)).reshape(grid.shape)


def _ellipsoid_grid(settings: LatticeSettings) -> Floats:
    eta = np.linspace(-0.5 * np.pi, 0.5 * np.pi, settings.n_rows)
    omega = np.linspace(-np.pi, np.pi, settings.n_columns + 1)
    places = (some.ravel() for some in np.meshgrid(eta, omega, indexing="ij"))
    return regular_points(ELLIPSOID, *places).points.reshape(len(eta), len(omega), 3)


def _sparse_lines(grid: Floats, stride: int) -> list[Floats]:
    return [*grid[::stride], *grid[:, ::stride].transpose(1, 0, 2)]


def _lattice_lines(control: Floats) -> style.Draw:
    """Drawing of a lattice (l, m, n, 3): its shell dark, its core lighter."""
    layers = [line for layer in control.transpose(2, 0, 1, 3) for line in style.grid_lines(layer)]
    inner = control[1:-1, 1:-1].reshape(-1, *control.shape[2:])
    rim = np.concatenate([control[0], control[-1], control[1:-1, 0], control[1:-1, -1]])
    rims = [
        np.concatenate([layer[0], layer[:, -1], layer[-1, ::-1], layer[::-1, 0]])
        for layer in control.transpose(2, 0, 1, 3)
    ]
    return style.together(
        style.lines([*layers, *inner], CORE, 1.0),
        style.lines([*rims, *rim], SHELL, 1.0),
    )


class Example(NamedTuple):
    """An object and its traced contours, in place of one that the thesis draws without formula."""

    radius: Callable[[Floats, Floats], Floats]  # of heights, from -1 to 1, and azimuths [rad]
    heights: Floats  # (m,) of its contours, upwards
    n_points: int  # of a contour, whose last is the first again
    first_figure: int  # number in chapter 5 of the figure that shows the object

    def contours(self) -> Floats:
        """Contours (m, n_points, 3) as an exact finger traces them."""
        return self._rings(self.heights, np.linspace(-np.pi, np.pi, self.n_points))

    def mesh(self, n_rows: int, n_columns: int) -> Mesh:
        """The object itself, with plane ends."""
        azimuths = 2.0 * np.pi * np.arange(n_columns) / n_columns
        rings = self._rings(np.linspace(-1.0, 1.0, n_rows), azimuths)
        return Mesh(*close_rings(rings[0].mean(axis=0), rings, rings[-1].mean(axis=0)))

    def _rings(self, heights: Floats, azimuths: Floats) -> Floats:
        z, t = (some.copy() for some in np.broadcast_arrays(heights[:, None], azimuths[None]))
        radius = self.radius(z, t)
        return np.stack([radius * np.cos(t), radius * np.sin(t), z], axis=-1)


def draw_example(example: Example, layout: SolidLayout = SOLID) -> Figure:
    """The object, the fitted lattice, the rebuilt solid with the traced points, and it shaded."""
    figure = style.new_figure(5.1)
    panels = figure.subplots(2, 3)
    solid, contours = rebuild_thesis(example.contours()), example.contours()
    points = contours.reshape(-1, 3)
    object_mesh, rebuilt = (some.mesh(layout.n_rows, layout.n_columns) for some in (example, solid))
    curves = _model_lines(solid, layout.n_lines)
    lined = style.together(style.shaded(rebuilt, (225, 233, 240)), style.lines(curves, LINE, 1.0))
    crossed = style.together(lined, style.crosses(points, charts.VERMILION))
    around = np.concatenate([object_mesh.vertices, solid.lattice.control.reshape(-1, 3)])
    views = (style.OBLIQUE,) * 3, (style.FROM_TOP, style.FROM_SIDE, style.OBLIQUE)
    draws = (
        style.shaded(object_mesh),
        _lattice_lines(solid.lattice.control),
        *(crossed,) * 3,
        style.shaded(rebuilt),
    )
    names = (
        "object",
        "control lattice",
        "solid and points",
        "from the top",
        "from the side",
        "shaded",
    )
    for number, (axes, draw, name) in enumerate(zip(panels.flat, draws, names, strict=True)):
        title = f"{name} (5.{example.first_figure + number})"
        view = views[number // 3][number % 3]
        style.show_solid(axes, draw, around, view, shape=(238, 229), title=title)
    return figure


def _model_lines(solid: ThesisSolid, n_lines: int) -> list[Floats]:
    """Lines of equal eta, and as many of equal nu."""
    fine = np.linspace(0.0, 1.0, 181)
    rows = solid.surface(np.linspace(0.0, 1.0, n_lines), fine)
    columns = solid.surface(fine, np.arange(n_lines) / n_lines)
    return [*rows, *columns.transpose(1, 0, 2)]


def _lobed(z: Floats, t: Floats) -> Floats:
    outline = np.sqrt(1.04 - z**2) * (0.75 + 0.18 * np.sin(9.0 * z))
    return np.asarray(outline * (1.0 + 0.12 * np.cos(3.0 * t) + 0.08 * np.sin(2.0 * t + 2.0 * z)))


def _smooth(z: Floats, t: Floats) -> Floats:
    outline = (1.02 - z**2) ** 0.35 * (0.8 + 0.1 * z)
    return np.asarray(outline * (1.0 + 0.15 * np.cos(2.0 * t)))


FIRST = Example(_lobed, np.linspace(-1.0, 1.0, 27), 81, 9)
SECOND = Example(_smooth, np.sin(0.5 * np.pi * np.linspace(-1.0, 1.0, 24)), 41, 15)


def draw_example_1() -> Figure:
    """Figures 5.9 to 5.14: 27 contours of 81 points at even heights."""
    return draw_example(FIRST)


def draw_example_2() -> Figure:
    """Figures 5.15 to 5.20: 24 contours of 41 points at uneven heights."""
    return draw_example(SECOND)
