"""Chapter 2 of the thesis: superquadrics, bases of splines, hyperquadrics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.core.arrays import Floats
from palpate.core.shapes import (
    Dent,
    Hyperquadric,
    Mesh,
    Superquadric,
    regular_points,
    trigonometric_points,
)
from palpate.core.splines import CUBIC, Basis, clamped_basis
from palpate.launch import charts
from palpate.tools.gallery import style

CUBE = Superquadric(np.ones(3), np.array([0.1, 0.1]))
KNOTS = {  # of seven cubic B-splines each
    "(a) clamped, uniform": np.array([0, 0, 0, 0, 1, 2, 3, 4, 4, 4, 4]) / 4.0,
    "(b) uniform": np.arange(11) / 10.0,
    "(c) clamped, not uniform": np.array([0, 0, 0, 0, 0.15, 0.3, 0.8, 1, 1, 1, 1]),
    "(d) a triple knot": np.array([0, 0, 0, 0, 0.5, 0.5, 0.5, 1, 1, 1, 1]),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class SuperquadricLayout:
    """Exponents and meshes of the drawn superquadrics."""

    exponents: tuple[float, ...] = (0.2, 1.0, 2.0, 3.0)  # e1 of a row of panels, e2 of a column
    n_rows: int = 65  # points of a mesh from pole to pole
    n_columns: int = 128  # points around
    n_lines: int = 16  # steps between drawn lines from pole to pole, and twice as many around
    line_refinement: int = 8  # steps of a drawn line between two crossing ones


DEFAULT_LAYOUT = SuperquadricLayout()


def draw_superellipses(
    exponents: Sequence[float] = (0.15, 0.5, 1.0, 1.5, 2.0, 3.0),
) -> Figure:
    """Figure 2.1: superellipses, and the part of them that the printed formula gives."""
    figure = style.new_figure(4.6)
    axes = figure.add_subplot()
    turn = np.linspace(0.0, 2.0 * np.pi, 1441)
    printed = turn <= 0.5 * np.pi
    for exponent, colour in zip(exponents, charts.SERIES, strict=False):
        x, y = (_powered(ratio, exponent) for ratio in (np.cos(turn), np.sin(turn)))
        axes.plot(x, y, colour, linewidth=1.2, label=f"{exponent:g}")
        axes.plot(x[printed], y[printed], colour, linewidth=3.2)
    axes.set(xlabel="x / a", ylabel="y / b", xlim=(-1.08, 1.08), ylim=(-1.08, 1.08))
    axes.set_aspect("equal")
    style.few_ticks(axes)
    axes.legend(title="exponent", loc="center left", bbox_to_anchor=(1.02, 0.5))
    return figure


def draw_superquadrics(layout: SuperquadricLayout = DEFAULT_LAYOUT) -> Figure:
    """Figure 2.2: superquadrics of one size, for all pairs of the exponents."""
    count = len(layout.exponents)
    figure = style.new_figure(6.6)
    panels = figure.subplots(count, count)
    largest = _powered_mesh(layout.exponents[0], layout.exponents[0], layout).vertices
    for row, e1 in enumerate(layout.exponents):
        for column, e2 in enumerate(layout.exponents):
            mesh = _powered_mesh(e1, e2, layout)
            title = f"$\\epsilon_1$ = {e1:g}, $\\epsilon_2$ = {e2:g}"
            style.show_solid(
                panels[row, column], style.shaded(mesh), largest, shape=(150, 175), title=title
            )
    return figure


def _powered_mesh(e1: float, e2: float, layout: SuperquadricLayout) -> Mesh:
    """(2.1) with signed powers; `Superquadric` does not take exponents above 2."""
    eta = np.linspace(-0.5 * np.pi, 0.5 * np.pi, layout.n_rows)[:, None]
    omega = np.linspace(-np.pi, np.pi, layout.n_columns + 1)[None, :]
    level, up = _powered(np.cos(eta), e1), _powered(np.sin(eta), e1)
    x, y = (level * _powered(ratio, e2) for ratio in (np.cos(omega), np.sin(omega)))
    return style.grid_mesh(np.stack([x, y, np.broadcast_to(up, x.shape)], axis=-1))


def _powered(values: Floats, exponent: float) -> Floats:
    return np.asarray(np.sign(values) * np.abs(values) ** exponent)


def solid_mesh(shape: Superquadric, layout: SuperquadricLayout = DEFAULT_LAYOUT) -> Mesh:
    """A mesh whose lines are denser where the surface bends, as the lines of (2.1) are."""
    return style.grid_mesh(_grid(shape, layout.n_rows, layout.n_columns, regular=False))


def _grid(shape: Superquadric, rows: int, columns: int, *, regular: bool) -> Floats:
    """Points (rows, columns + 1, 3) at even parameters, from pole to pole and once around."""
    eta, omega = np.meshgrid(
        np.linspace(-0.5 * np.pi, 0.5 * np.pi, rows),
        np.linspace(-np.pi, np.pi, columns + 1),
        indexing="ij",
    )
    points = regular_points if regular else trigonometric_points
    return points(shape, eta.ravel(), omega.ravel()).points.reshape(rows, columns + 1, 3)


def draw_parametrisations(layout: SuperquadricLayout = DEFAULT_LAYOUT) -> Figure:
    """Figure 2.3: the same cube, its lines at even steps of the parameters."""
    figure = style.new_figure(3.5)
    panels = figure.subplots(1, 2)
    solid = style.shaded(solid_mesh(CUBE, layout))
    n_lines, refinement = layout.n_lines, layout.line_refinement
    for axes, regular, title in zip(
        panels, (False, True), ("trigonometric (2.1)", "regular (2.4)"), strict=True
    ):
        grid = _grid(CUBE, n_lines + 1, 2 * n_lines, regular=regular)
        n_steps = refinement * n_lines
        fine = _grid(CUBE, n_steps + 1, 2 * n_steps, regular=regular)
        curves = [*fine[::refinement], *fine[:, ::refinement].transpose(1, 0, 2)]
        draw = style.together(solid, style.lines(curves, charts.BLUE, 1.0))
        style.show_solid(axes, draw, grid.reshape(-1, 3), shape=(330, 340), title=title)
    return figure


def draw_bernstein() -> Figure:
    """Figure 2.4: the Bernstein polynomials of degree 5."""
    figure = style.new_figure(3.2)
    axes = figure.add_subplot()
    places = np.linspace(0.0, 1.0, 301)
    values = clamped_basis(6, 5).matrix(places).toarray()
    for i, colour in enumerate(charts.SERIES[:6]):
        axes.plot(places, values[:, i], colour)
        peak = int(values[:, i].argmax())
        end = {0: 12, 300: -12}.get(peak, 0)  # beside the axes where it peaks at an end
        axes.annotate(
            f"$J_{{5,{i}}}$", (places[peak], values[peak, i]), (end, 3 - 6 * bool(end)),
            textcoords="offset points", color=colour, ha="center", fontsize=10,
        )  # fmt: skip
    axes.set(xlabel="parameter v", ylabel="value", xlim=(0.0, 1.0), ylim=(0.0, 1.05))
    return figure


def draw_b_splines() -> Figure:
    """Figure 2.7: cubic B-splines on four knot vectors."""
    figure = style.new_figure(4.6)
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, (title, knots) in zip(panels.flat, KNOTS.items(), strict=True):
        _draw_basis(axes, knots)
        axes.set(title=title, xlim=(0.0, 1.0), ylim=(0.0, 1.05))
    for axes in panels[1]:
        axes.set_xlabel("parameter t")
    for axes in panels[:, 0]:
        axes.set_ylabel("value")
    return figure


def _draw_basis(axes: Axes, knots: Floats) -> None:
    """All functions over all knots, grey where they do not sum to 1; knots as marks below."""
    # A function is zero beyond its own knots, so it does not depend on the knots added here.
    steps = np.arange(1, CUBIC + 1)
    longer = np.concatenate([knots[0] - 0.1 * steps[::-1], knots, knots[-1] + 0.1 * steps])
    places = np.linspace(0.0, 1.0, 501)
    values = Basis(longer, CUBIC).matrix(places).toarray()[:, CUBIC:-CUBIC]
    for column, colour in zip(values.T, charts.SERIES, strict=False):
        axes.plot(places, column, colour)
    low, high = Basis(knots, CUBIC).domain
    for start, end in ((0.0, low), (high, 1.0)):
        axes.axvspan(start, end, color="0.9", linewidth=0)
    axes.plot(knots, np.zeros(len(knots)), "|", color=charts.INK, clip_on=False, markersize=9)


def draw_hyperquadrics(level: int = 6) -> Figure:
    """Figure 2.8: without exponential terms above, with them below; `level` of their meshes."""
    figure = style.new_figure(4.9)
    panels = figure.subplots(2, 3)
    for axes, (title, solid) in zip(panels.flat, _hyperquadrics().items(), strict=True):
        mesh = solid.mesh(level)
        style.show_solid(axes, style.shaded(mesh), mesh.vertices, shape=(250, 233), title=title)
    return figure


def _hyperquadrics() -> dict[str, Hyperquadric]:
    upright = np.hstack([np.eye(3), np.zeros((3, 1))])
    tilted = np.array(
        [[0.55, 0.55, 0.5], [0.55, -0.55, 0.5], [-0.55, 0.55, 0.5], [-0.55, -0.55, 0.5]]
    )
    cut = np.vstack([upright, np.hstack([tilted, np.zeros((4, 1))])])
    oblique = np.array([[1.0, 0.2, 0, 0], [0, 1.0, 0.3, 0], [0.35, 0, 0.8, 0], [0.5, 0.5, 0, 0.2]])
    thumb = Dent(
        0.6, np.array([[1.6, 0, 0, -1.5], [0, 2.0, 0, 0], [0, 0, 2.0, 0]]), np.full(3, 2.0)
    )
    above = Dent(
        0.6, np.array([[2.0, 0, 0, 0], [0, 2.0, 0, 0], [0, 0, 1.6, -1.5]]), np.full(3, 2.0)
    )
    front = Dent(0.6, np.array([[2.0, 0, 0, 0], [0, 1.6, 0, 1.5], [0, 0, 2.0, 0]]), np.full(3, 2.0))
    waist = Dent(0.7, np.array([[0, 0, 3.0, 0]]), np.full(1, 2.0))
    knob = Dent(
        -3.0, np.array([[2.2, 0, 0, 0], [0, 2.2, 0, 0], [0, 0, 1.8, -2.2]]), np.full(3, 2.0)
    )
    round_box = np.full(3, 4.0)
    return {
        "box, corners cut": Hyperquadric(cut, np.full(7, 12.0)),
        "four oblique strips": Hyperquadric(oblique, np.full(4, 6.0)),
        "exponents below 1": Hyperquadric(upright, np.full(3, 0.7)),
        "three dents": Hyperquadric(upright, round_box, (thumb, above, front)),
        "a waist": Hyperquadric(upright, round_box, (waist,)),
        "a knob, term below 0": Hyperquadric(upright, round_box, (knob,)),
    }
