"""Figures that the thesis does not have: runs of palpate, their errors and costs."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from palpate.core.arrays import Floats
from palpate.launch import charts, cost_chart
from palpate.launch.colours import rgb
from palpate.launch.printing import counted
from palpate.launch.run_directory import read_summary
from palpate.messages.types import Contour
from palpate.tools.exploration import explore
from palpate.tools.gallery import style
from palpate.tools.surfaces import scale_top, shades
from palpate.tools.view.picture import finger_mesh
from palpate.tools.view.rasteriser import Canvas
from palpate.tools.view.timeline import Timeline, read_timeline

SCENE, MESH_SCENE = "vase", "from_mesh"
VIEW = style.View(azimuth=-50.0, elevation=14.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunLayout:
    """Moments of a run that are drawn, and how."""

    shares: tuple[float, ...] = (0.1, 0.25, 0.4, 0.6, 0.8)  # of the touches; the end comes last
    truth_opacity: float = 0.14
    contour_width: float = 2.0  # [pixels]
    touch_radius: float = 0.8  # [pixels]


RUN = RunLayout()


class Explored(NamedTuple):
    """A run of a shipped scene."""

    timeline: Timeline
    summary: Mapping[str, Any]


@cache
def explored(scene: str) -> Explored:
    """A run of a shipped scene, explored once and kept in memory."""
    with tempfile.TemporaryDirectory(prefix="palpate-gallery-") as folder:
        run = Path(folder) / scene
        explore(scene, composed=True, out=run)
        return Explored(read_timeline(run), read_summary(run))


def draw_run(layout: RunLayout = RUN) -> Figure:
    """Moments of a run: touches, contours, and the solid as far as it was known."""
    line = explored(SCENE).timeline
    figure = style.new_figure(5.7)
    shown = [line.touches[round(share * len(line.touches)) - 1] for share in layout.shares]
    corners = np.concatenate(
        [*style.box_edges(*line.bounds()), *(finger_mesh(touch.pose)[0] for touch in shown)]
    )
    times = [*(touch.time for touch in shown), line.end]
    for axes, time in zip(figure.subplots(2, 3).flat, times, strict=True):
        style.show_solid(
            axes, partial(_draw_moment, line, time, layout), corners,
            VIEW, shape=(270, 229), title=_moment_title(line, time),
        )  # fmt: skip
    return figure


def _moment_title(line: Timeline, time: float) -> str:
    moment = line.at(time)
    numbers = (model.number for model in line.models[: moment.models])
    scores = [line.scores[number] for number in numbers if number in line.scores]
    error = f"error {1e3 * scores[-1].rms:.2g} mm" if scores else "nothing rebuilt yet"
    touches = counted(moment.touches, "touch", "touches")
    traced = counted(line.traced(moment), "contour")
    return f"{time:.0f} s: {touches}, {traced}\n{error}"


def _draw_moment(line: Timeline, time: float, layout: RunLayout, canvas: Canvas) -> None:
    moment = line.at(time)
    touches = line.touches[: moment.touches]
    if moment.models:
        model = line.models[moment.models - 1]
        canvas.draw_mesh(model.vertices, model.faces, np.array(style.SOLID))
    _draw_contours(line.contours[: moment.contours], layout, canvas)
    points = [touch.points for touch in touches]
    points += [grasp.points for grasp in line.grasps[: moment.grasps]]
    _draw_touches(points, layout, canvas)
    if touches and moment.touches < len(line.touches):
        canvas.draw_mesh(*finger_mesh(touches[-1].pose), np.array(rgb("finger")))
    if line.truth is not None:
        ghost = Canvas(canvas.width, canvas.height, canvas.camera)
        ghost.draw_mesh(line.truth.vertices, line.truth.faces, np.array(rgb("truth")))
        canvas.blend(ghost, layout.truth_opacity)


def _draw_contours(contours: Sequence[Contour], layout: RunLayout, canvas: Canvas) -> None:
    colour, width = np.array(rgb("contour")), layout.contour_width
    for contour in contours:
        canvas.draw_line(contour.points, colour, width, closed=contour.status == "closed")


def _draw_touches(points: Sequence[Floats], layout: RunLayout, canvas: Canvas) -> None:
    canvas.draw_points(np.concatenate(points), np.array(rgb("touch")), layout.touch_radius)


def draw_deviation(layout: RunLayout = RUN) -> Figure:
    """An explored mesh: the rebuilt solid, and its distance from the truth on two sides."""
    line = explored(MESH_SCENE).timeline
    model, surface = line.models[-1], line.surface
    assert surface is not None
    deviations = surface.deviations(model.vertices)
    top = scale_top(deviations)
    figure = style.new_figure(3.3)
    panels = figure.subplots(1, 3)

    def rebuilt(canvas: Canvas) -> None:
        canvas.draw_mesh(model.vertices, model.faces, np.array(style.SOLID))
        _draw_contours(line.contours, layout, canvas)
        _draw_touches([touch.points for touch in line.touches], layout, canvas)

    def coloured(canvas: Canvas) -> None:
        colours = shades(deviations, top).astype(np.float64)
        canvas.draw_mesh(model.vertices, model.faces, colours)

    for axes, draw, azimuth, title in zip(
        panels,
        (rebuilt, coloured, coloured),
        (-50.0, -50.0, 130.0),
        ("rebuilt, with touches", "deviation", "deviation, from behind"),
        strict=True,
    ):
        view = style.View(azimuth, 18.0)
        style.show_solid(axes, draw, model.vertices, view, shape=(290, 205), title=title)
    scale = ScalarMappable(Normalize(0.0, 1e3 * top), "viridis_r")
    label = "distance from the true surface, mm"
    figure.colorbar(scale, ax=panels, shrink=0.8, aspect=30, extend="max", label=label)
    return figure


def draw_cost(height: float = 560.0) -> Figure:
    """Error and bound of each model against touches and times, and the use of processor time.

    `height` of the figure [pixels].
    """
    width = style.LAYOUT.width * charts.PIXELS_PER_INCH
    settings = cost_chart.CostChartSettings(figure_size=(width, height))
    return cost_chart.draw_cost(explored(SCENE).summary, has_heading=False, settings=settings)
