"""Chapter 5 of the thesis: free-form deformation, and solids rebuilt from contours."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from palpate.core.arrays import Floats
from palpate.core.geometry import close_rings
from palpate.core.shapes import Mesh, Superquadric, regular_points
from palpate.core.splines import Basis, Lattice, SplineVolume, clamped_basis, upright_parallelepiped
from palpate.core.thesis import ThesisSolid, rebuild_thesis
from palpate.launch import charts
from palpate.tools.gallery import style

ELLIPSOID = Superquadric(np.array([0.55, 0.55, 1.0]), np.ones(2))
COUNTS = (5, 5, 13)  # Control points along x, y and z
TAPERED = 4  # Layers at the bottom; the others zig and zag
LEAST_SCALE, LOWERED, SHIFT = 0.35, 0.14, 0.3  # Of the lowest layer; of each; of the others
DEFORMED_ROWS, DEFORMED_COLUMNS = 121, 96  # Points of the mesh, of which every sixth has lines
STRIDE = 6
LINE, SHELL, CORE = "#5a93bf", "#4a4a4a", "#f3d9a4"  # Of surfaces, and of lattices
MESH_ROWS, MESH_COLUMNS = 201, 180
DRAWN_ROWS, DRAWN_COLUMNS = 27, 27  # Lines of a rebuilt solid


def draw_lattice() -> Figure:
    """Figures 5.1 to 5.4: an ellipsoid, and the lattice around it before and after it is pulled."""
    before, after = _even_control(), _deformed_control()
    grid = _ellipsoid_grid()
    shape = style.together(
        style.shaded(style.grid_mesh(grid)), style.lines(_sparse_lines(grid), LINE, 1.0)
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


def draw_deformation() -> Figure:
    """Figures 5.5 to 5.8: the ellipsoid in that lattice, by B-splines and by Bernstein's."""
    by_spline, by_bernstein = (_deformed_grid(bernstein=one) for one in (False, True))
    around = np.concatenate([by_spline.reshape(-1, 3), by_bernstein.reshape(-1, 3)])
    solid, smooth = (style.shaded(style.grid_mesh(one)) for one in (by_spline, by_bernstein))
    lined = style.together(solid, style.lines(_sparse_lines(by_spline), LINE, 1.0))
    return _in_a_row(
        around,
        ("from the side (5.5)", lined, style.FROM_SIDE),
        ("B-splines (5.6)", lined, style.OBLIQUE),
        ("shaded (5.7)", solid, style.OBLIQUE),
        ("Bernstein (5.8)", smooth, style.OBLIQUE),
    )


def _in_a_row(around: Floats, *panels: tuple[str, style.Draw, tuple[float, float]]) -> Figure:
    """Solids beside each other: title, what is drawn and from where; `around` is in all of them."""
    figure = style.new_figure(2.9)
    for axes, (title, draw, view) in zip(figure.subplots(1, len(panels)), panels, strict=True):
        style.show_solid(axes, draw, around, view, shape=(250, 171), title=title)
    return figure


def _bases(*, bernstein: bool) -> tuple[Basis, Basis, Basis]:
    s, t, u = (clamped_basis(one, one - 1 if bernstein else 3) for one in COUNTS)
    return s, t, u


def _even_control() -> Floats:
    size = ELLIPSOID.size
    return upright_parallelepiped(-size, 2.0 * size).even_control(COUNTS)


def _deformed_control() -> Floats:
    """The lattice drawn out and tapered at the bottom, and shifted to and fro above."""
    control = _even_control()
    for number in range(COUNTS[2]):
        layer = control[:, :, number]
        if number < TAPERED:
            layer[..., :2] *= LEAST_SCALE + (1.0 - LEAST_SCALE) * number / TAPERED
            layer[..., 2] -= LOWERED * (TAPERED - number)
        else:
            layer[..., 0] += SHIFT if number % 2 else -SHIFT
    return control


def _deformed_grid(*, bernstein: bool) -> Floats:
    """Points of the deformed ellipsoid, rows from pole to pole."""
    bases = _bases(bernstein=bernstein)
    lattice = Lattice(
        SplineVolume(_deformed_control(), bases), SplineVolume(_even_control(), bases)
    )
    grid = _ellipsoid_grid()
    return lattice.deform(grid.reshape(-1, 3)).reshape(grid.shape)


def _ellipsoid_grid() -> Floats:
    eta = np.linspace(-0.5 * np.pi, 0.5 * np.pi, DEFORMED_ROWS)
    omega = np.linspace(-np.pi, np.pi, DEFORMED_COLUMNS + 1)
    places = (some.ravel() for some in np.meshgrid(eta, omega, indexing="ij"))
    return regular_points(ELLIPSOID, *places).points.reshape(len(eta), len(omega), 3)


def _sparse_lines(grid: Floats) -> list[Floats]:
    return [*grid[::STRIDE], *grid[:, ::STRIDE].transpose(1, 0, 2)]


def _lattice_lines(control: Floats) -> style.Draw:
    """What draws a lattice (l, m, n, 3): its shell dark, its core lighter."""
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
    """An object, and the contours that were traced of it; it stands for one that is only drawn."""

    radius: Callable[[Floats, Floats], Floats]  # Of heights, from -1 to 1, and azimuths, rad
    heights: Floats  # Of its contours, (m,), upwards
    around: int  # Points of a contour, the first again at the end
    first: int  # Number of the figure that shows the object: 5.9 or 5.15

    def contours(self) -> Floats:
        """What a perfect finger traces, (m, around, 3)."""
        return self._rings(self.heights, np.linspace(-np.pi, np.pi, self.around))

    def mesh(self) -> Mesh:
        """The object itself, with plane ends."""
        turns = 2.0 * np.pi * np.arange(MESH_COLUMNS) / MESH_COLUMNS
        rings = self._rings(np.linspace(-1.0, 1.0, MESH_ROWS), turns)
        return Mesh(*close_rings(rings[0].mean(axis=0), rings, rings[-1].mean(axis=0)))

    def _rings(self, heights: Floats, azimuths: Floats) -> Floats:
        z, t = (some.copy() for some in np.broadcast_arrays(heights[:, None], azimuths[None]))
        radius = self.radius(z, t)
        return np.stack([radius * np.cos(t), radius * np.sin(t), z], axis=-1)


def draw_example(example: Example) -> Figure:
    """The object, the lattice that was found, the solid with its points, and it shaded."""
    figure = style.new_figure(5.1)
    panels = figure.subplots(2, 3)
    solid, contours = rebuild_thesis(example.contours()), example.contours()
    points = contours.reshape(-1, 3)
    object_mesh, found = example.mesh(), solid.mesh(MESH_ROWS, MESH_COLUMNS)
    lined = style.together(
        style.shaded(found, (225, 233, 240)), style.lines(_model_lines(solid), LINE, 1.0)
    )
    crossed = style.together(lined, style.crosses(points, charts.VERMILION))
    around = np.concatenate([object_mesh.vertices, solid.lattice.control.reshape(-1, 3)])
    views = (style.OBLIQUE,) * 3, (style.FROM_TOP, style.FROM_SIDE, style.OBLIQUE)
    draws = (
        style.shaded(object_mesh),
        _lattice_lines(solid.lattice.control),
        *(crossed,) * 3,
        style.shaded(found),
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
        title = f"{name} (5.{example.first + number})"
        view = views[number // 3][number % 3]
        style.show_solid(axes, draw, around, view, shape=(238, 229), title=title)
    return figure


def _model_lines(solid: ThesisSolid) -> list[Floats]:
    """Lines of equal eta and of equal nu."""
    fine, turn = np.linspace(0.0, 1.0, 181), np.linspace(0.0, 1.0, 181)
    rows = solid.surface(np.linspace(0.0, 1.0, DRAWN_ROWS), turn)
    columns = solid.surface(fine, np.arange(DRAWN_COLUMNS) / DRAWN_COLUMNS)
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
