"""Sketches of the thesis: the sensor, its frame, preprocessing, and two constructions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.core.arrays import Floats
from palpate.core.splines import upright_parallelepiped
from palpate.launch import charts
from palpate.tools.gallery import style

STAGES = (
    ("raw frame", "times or forces\n/touch/raw"),
    ("transformation", "to compressions\n3.4.1, calibration"),
    ("noise filters", "Wiener, median\n3.4.2, /touch/image"),
    ("surface", "B-spline or jet\n3.5"),
    ("geometry", "normal, curvatures\n/touch/patch"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PadSketch:
    """A ball pressed into a pad over a row of elements that are 1 mm apart."""

    thickness: float = 3.0  # [mm] of the pad
    indentation: float = 1.0  # [mm] of the ball
    ball_radius: float = 9.0  # [mm]
    n_elements: int = 16
    free_element: int = 2  # index of the element beside the ball whose pulse is drawn
    pressed_element: int = 7  # index of the one under the ball

    def elements(self) -> Floats:
        """Positions (n_elements,) along the row, about its middle [mm]."""
        return np.asarray(np.arange(self.n_elements) - 0.5 * (self.n_elements - 1), np.float64)


PAD = PadSketch()


def draw_array(pad: PadSketch = PAD) -> Figure:
    """Figure 1.1: a row of ultrasonic elements under a pad, into which a ball is pressed."""
    figure = style.new_figure(2.9)
    axes = figure.add_subplot()
    x = np.linspace(-8.0, 8.0, 641)
    radius, elements = pad.ball_radius, pad.elements()
    ball = pad.thickness - pad.indentation + radius - np.sqrt(radius**2 - x**2)
    face = np.minimum(ball, pad.thickness)
    axes.fill_between(x, 0.0, face, color="0.88", linewidth=0.0)
    axes.plot(x, face, charts.INK)
    axes.plot(x[ball < 4.4], ball[ball < 4.4], charts.BLUE)
    axes.bar(elements, 0.35, 0.7, bottom=-0.4, color="0.55")
    for index, name in ((pad.free_element, "1"), (pad.pressed_element, "2")):
        at, top = elements[index], float(np.interp(elements[index], x, face))
        _arrow(axes, (at - 0.12, 0.0), (at - 0.12, top), charts.ORANGE)
        _arrow(axes, (at + 0.12, top), (at + 0.12, 0.0), charts.ORANGE)
        axes.text(at + 0.35, 0.5 * top, f"$d_{name} = c\\,t_{name} / 2$", va="center")
    axes.text(3.2, 3.75, "object", color=charts.BLUE)
    axes.text(4.6, 1.4, "rubber pad")
    axes.text(-7.9, -0.95, "transmitters and receivers")
    axes.set(xlim=(-8.2, 8.2), ylim=(-1.2, 4.5), aspect="equal")
    axes.set_axis_off()
    return figure


def draw_de_casteljau(parameter: float = 1.0 / 3.0) -> Figure:
    """Figure 2.5: the point of a cubic curve at a parameter, by dividing its polygon repeatedly."""
    figure = style.new_figure(3.2)
    axes = figure.add_subplot()
    t = np.linspace(0.0, 1.0, 201)[:, None]
    polygon = np.array([[0.0, 0.0], [0.25, 1.0], [0.85, 0.95], [1.0, 0.1]])
    axes.plot(*_divided(np.broadcast_to(polygon[:, None], (4, 201, 2)), t)[-1][0].T, charts.INK)
    levels = _divided(polygon, parameter)
    for level, (points, colour) in enumerate(zip(levels, charts.SERIES, strict=False)):
        axes.plot(*points.T, "o-", color=colour, markersize=5, linewidth=1.0)
        for i, (x, y) in enumerate(points):
            axes.annotate(
                f"$b_{i}^{level}$", (x, y), (0, 9), textcoords="offset points", color=colour,
                ha="center",
            )  # fmt: skip
    axes.set(xlim=(-0.08, 1.1), ylim=(-0.1, 1.2))
    axes.set_axis_off()
    return figure


def _divided(points: Floats, t: Floats | float) -> list[Floats]:
    """Polygons: the given one, then each with corners that divide the sides of the last at t."""
    levels = [points]
    while len(levels[-1]) > 1:
        levels.append((1.0 - t) * levels[-1][:-1] + t * levels[-1][1:])
    return levels


def draw_parallelepiped() -> Figure:
    """Figure 2.6: the box of a free-form deformation, its axes and its control points."""
    figure = style.new_figure(3.4)
    low, size = np.zeros(3), np.array([1.5, 1.0, 1.1])
    box = upright_parallelepiped(low, size)
    steps = [np.linspace(0.0, 1.0, count) for count in (4, 3, 4)]
    triples = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1)
    control = low + triples * size
    ends = {"S": 1.25 * box.edges[0], "T": 1.35 * box.edges[1], "U": 1.25 * box.edges[2]}
    curves = [line for layer in control for line in style.grid_lines(layer)]
    curves += [line for layer in control.transpose(1, 0, 2, 3) for line in layer.transpose(1, 0, 2)]
    draw = style.together(
        style.lines(curves, "#b0b8c0"),
        style.lines([np.array([low, end]) for end in ends.values()], charts.ORANGE, 2.5),
        style.crosses(control.reshape(-1, 3), charts.BLUE, 3.0),
    )
    axes = figure.add_subplot()
    around = np.concatenate([control.reshape(-1, 3), *(end[None] for end in ends.values())])
    canvas = style.show_solid(axes, draw, around, shape=(330, 660))
    labels = {name: (1.06 * end).tolist() for name, end in ends.items()}
    style.label_points(axes, canvas, {**labels, "$X_0$": [-0.06, -0.06, -0.06]})
    return figure


def draw_winged_edge() -> Figure:
    """Figure 2.9: neighbours of an edge in the winged edge model."""
    figure = style.new_figure(3.0)
    axes = figure.add_subplot()
    start, end = np.array([0.0, -0.5]), np.array([0.0, 0.5])
    wings = {
        "next of the left face": (start, (-0.8, -0.85)), "before it": (end, (-0.8, 0.85)),
        "next of the right face": (end, (0.8, 0.85)), "before that": (start, (0.8, -0.85)),
    }  # fmt: skip
    for name, (place, outer) in wings.items():
        axes.plot(*np.array([place, outer]).T, charts.BLUE)
        side = "left" if outer[0] > 0.0 else "right"
        axes.text(1.05 * outer[0], outer[1], name, color=charts.BLUE, ha=side, va="center")
    _arrow(axes, (start[0], start[1]), (end[0], end[1]), charts.INK)
    axes.plot(*np.array([start, end]).T, "o", color=charts.INK)
    axes.text(0.05, 0.0, "edge")
    axes.text(0.0, -0.58, "start", ha="center", va="top")
    axes.text(0.0, 0.58, "end", ha="center", va="bottom")
    axes.text(-0.9, 0.0, "left face", color=charts.ORANGE)
    axes.text(0.6, 0.0, "right face", color=charts.ORANGE)
    axes.set(xlim=(-2.2, 2.2), ylim=(-1.0, 1.0))
    axes.set_axis_off()
    return figure


def draw_preprocessing() -> Figure:
    """Figure 3.1: from a raw frame to curvatures, with the topics between our nodes."""
    figure = style.new_figure(1.6)
    axes = figure.add_subplot()
    frame = {"boxstyle": "round,pad=0.4", "facecolor": "0.94", "edgecolor": charts.INK}
    for number, (title, words) in enumerate(STAGES):
        axes.text(number, 0.32, title, ha="center", va="center", fontsize=9, bbox=frame)
        axes.text(number, -0.35, words, ha="center", va="center", fontsize=8)
        if number:
            _arrow(axes, (number - 0.54, 0.32), (number - 0.44, 0.32), charts.INK)
    axes.set(xlim=(-0.6, len(STAGES) - 0.4), ylim=(-0.8, 0.8))
    axes.set_axis_off()
    return figure


def draw_array_frame(pad: PadSketch = PAD) -> Figure:
    """Figure 3.2: the frame of the array, and the pad's face over it, heights doubled."""
    figure = style.new_figure(3.4)
    x, y = np.meshgrid(pad.elements(), pad.elements())
    depth = np.maximum(pad.indentation - (x**2 + y**2) / (2.0 * pad.ball_radius), 0.0)
    face = pad.thickness - depth
    below, above = np.stack([x, y, 0.0 * x], -1), np.stack([x, y, 2.0 * face], -1)
    ends = {"x": np.array([11.0, 0, 0]), "y": np.array([0, 11.0, 0]), "z": np.array([0, 0, 9.5])}
    corners = (grid[::15, ::15].reshape(-1, 3) for grid in (below, above))
    upright = [np.array(pair) for pair in zip(*corners, strict=True)]
    draw = style.together(
        style.lines(style.grid_lines(below), "#b0b8c0"),
        style.crosses(below.reshape(-1, 3), charts.INK, 1.5),
        style.lines(style.grid_lines(above), charts.BLUE, 1.0),
        style.lines(upright, "#b0b8c0"),
        style.lines([np.array([np.zeros(3), end]) for end in ends.values()], charts.ORANGE, 2.5),
    )
    axes = figure.add_subplot()
    around = np.concatenate([below.reshape(-1, 3), *(end[None] for end in ends.values())])
    canvas = style.show_solid(axes, draw, around, shape=(330, 660))
    style.label_points(axes, canvas, {name: (1.07 * end).tolist() for name, end in ends.items()})
    return figure


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], colour: str) -> None:
    axes.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": colour})
