"""What the thesis could not show: palpate's own runs, the errors of one, and what it cost."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

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
SHARES = (0.1, 0.25, 0.4, 0.6, 0.8)  # Of the touches, at the moments before the end
GHOST = 0.14  # Opacity of the true surface
COST_HEIGHT = 560.0  # pixels


class Explored(NamedTuple):
    """A run of a shipped scene."""

    line: Timeline
    summary: Mapping[str, Any]


@cache
def explored(scene: str) -> Explored:
    """A run of a shipped scene, made once; its folder is not kept."""
    with tempfile.TemporaryDirectory(prefix="palpate-gallery-") as folder:
        run = Path(folder) / scene
        explore(scene, composed=True, out=run)
        return Explored(read_timeline(run), read_summary(run))


def draw_run() -> Figure:
    """Six moments of a run: touches, contours, and the solid as far as it was known."""
    line = explored(SCENE).line
    figure = style.new_figure(5.7)
    shown = [line.touches[round(share * len(line.touches)) - 1] for share in SHARES]
    corners = np.concatenate(
        [*style.box_edges(*line.bounds()), *(finger_mesh(one.pose)[0] for one in shown)]
    )
    times = [*(one.time for one in shown), line.end]
    for axes, time in zip(figure.subplots(2, 3).flat, times, strict=True):
        style.show_solid(
            axes, partial(_draw_moment, line, time), corners,
            (-50.0, 14.0), shape=(270, 229), title=_moment_title(line, time),
        )  # fmt: skip
    return figure


def _moment_title(line: Timeline, time: float) -> str:
    moment = line.at(time)
    scores = [
        line.scores[one.number] for one in line.models[: moment.models] if one.number in line.scores
    ]
    told = f"error {1e3 * scores[-1].rms:.2g} mm" if scores else "nothing rebuilt yet"
    touches, traced = (
        counted(moment.touches, "touch", "touches"),
        counted(line.traced(moment), "contour"),
    )
    return f"{time:.0f} s: {touches}, {traced}\n{told}"


def _draw_moment(line: Timeline, time: float, canvas: Canvas) -> None:
    moment = line.at(time)
    touches = line.touches[: moment.touches]
    if moment.models:
        model = line.models[moment.models - 1]
        canvas.draw_mesh(model.vertices, model.faces, np.array(style.SOLID))
    _draw_contours(line.contours[: moment.contours], canvas)
    points = [one.points for one in touches]
    points += [one.points for one in line.grasps[: moment.grasps]]
    canvas.draw_points(np.concatenate(points), np.array(rgb("touch")), 0.8)
    if touches and moment.touches < len(line.touches):
        canvas.draw_mesh(*finger_mesh(touches[-1].pose), np.array(rgb("finger")))
    if line.truth is not None:
        ghost = Canvas(canvas.width, canvas.height, canvas.camera)
        ghost.draw_mesh(line.truth.vertices, line.truth.faces, np.array(rgb("truth")))
        canvas.blend(ghost, GHOST)


def _draw_contours(contours: Sequence[Contour], canvas: Canvas) -> None:
    for one in contours:
        canvas.draw_line(one.points, np.array(rgb("contour")), 2.0, closed=one.status == "closed")


def draw_deviation() -> Figure:
    """A mesh that was explored: what was rebuilt, and its distance from the truth on two sides."""
    line = explored(MESH_SCENE).line
    model, surface = line.models[-1], line.surface
    assert surface is not None
    far = surface.deviations(model.vertices)
    top = scale_top(far)
    figure = style.new_figure(3.3)
    panels = figure.subplots(1, 3)

    def rebuilt(canvas: Canvas) -> None:
        canvas.draw_mesh(model.vertices, model.faces, np.array(style.SOLID))
        _draw_contours(line.contours, canvas)
        points = np.concatenate([one.points for one in line.touches])
        canvas.draw_points(points, np.array(rgb("touch")), 0.8)

    def coloured(canvas: Canvas) -> None:
        colours = shades(far, top).astype(np.float64)
        canvas.draw_mesh(model.vertices, model.faces, colours)

    for axes, draw, azimuth, title in zip(
        panels,
        (rebuilt, coloured, coloured),
        (-50.0, -50.0, 130.0),
        ("rebuilt, with touches", "deviation", "deviation, from behind"),
        strict=True,
    ):
        style.show_solid(axes, draw, model.vertices, (azimuth, 18.0), shape=(290, 205), title=title)
    scale = ScalarMappable(Normalize(0.0, 1e3 * top), "viridis_r")
    label = "distance from the true surface, mm"
    figure.colorbar(scale, ax=panels, shrink=0.8, aspect=30, extend="max", label=label)
    return figure


def draw_cost() -> Figure:
    """Error and bound of each model against touches and times, and where the processor's went."""
    width = style.WIDTH * charts.PIXELS_PER_INCH
    settings = cost_chart.CostChartSettings(figure_size=(width, COST_HEIGHT))
    return cost_chart.draw_cost(explored(SCENE).summary, has_heading=False, settings=settings)
