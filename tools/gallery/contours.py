"""Chapter 4 of the thesis: which point of the model belongs to which touched point."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.core.arrays import Floats
from palpate.core.shapes import Superquadric, regular_points
from palpate.core.thesis import match_contour, ray_azimuths, rebuild_thesis
from palpate.launch import charts
from palpate.tools.gallery import style
from palpate.tools.gallery.reconstructions import FIRST, SECOND
from palpate.tools.surfaces import viridis
from palpate.tools.view.rasteriser import Canvas

MODEL = Superquadric(np.ones(3), np.array([0.15, 0.15]))  # The thesis's box
# Points at which the axes of the unit cube are named
AXIS_LABELS = {"s": (0.5, -0.06, 0.0), "t": (1.06, 0.5, 0.0), "u": (-0.05, 0.0, 0.5)}


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchLayout:
    """Slices and rays by which the drawn object and model are matched."""

    n_slices: int = 9  # matched by height
    object_offset: float = 2.6  # [half height of the object] from the model
    contour: int = 12  # index of the first example's contour that is matched by azimuth
    n_rays: int = 24
    n_curve_rays: int = 400  # that a drawn outline is sampled with


DEFAULT_LAYOUT = MatchLayout()


def draw_correspondence(layout: MatchLayout = DEFAULT_LAYOUT) -> Figure:
    """Figures 4.1 and 4.2: contours matched by height, their points by azimuth."""
    figure = style.new_figure(3.0)
    side, above = figure.subplots(1, 2, width_ratios=(2.1, 1.0))
    _draw_match_by_height(side, layout)
    _draw_match_by_azimuth(above, layout)
    figure.legend(*above.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _draw_match_by_height(axes: Axes, layout: MatchLayout) -> None:
    """Profiles of the model, left, and of the object; a line joins each pair of slices."""
    eta = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 401)
    model = regular_points(
        MODEL, np.concatenate([eta, eta[::-1]]), np.repeat([0.0, np.pi], len(eta))
    ).points
    heights = np.linspace(-1.0, 1.0, 401)
    sides = FIRST.radius(heights[:, None], np.array([[0.0, np.pi]])) * [1.0, -1.0]
    axes.plot(model[:, 0], model[:, 2], charts.BLUE)
    right, left = sides.T
    outline = np.concatenate([right, left[::-1], right[:1]])
    axes.plot(
        layout.object_offset + outline,
        np.concatenate([heights, heights[::-1], heights[:1]]),
        charts.VERMILION,
    )
    for z in np.linspace(-1.0, 1.0, layout.n_slices + 2)[1:-1]:
        half_width = np.interp(z, model[: len(eta), 2], model[: len(eta), 0])
        low, high = (layout.object_offset + np.interp(z, heights, side) for side in (left, right))
        axes.plot([-half_width, half_width], [z, z], charts.BLUE, linewidth=1.0)
        axes.plot([low, high], [z, z], charts.VERMILION, linewidth=1.0)
        axes.plot([half_width, low], [z, z], charts.GREY, linestyle=":", linewidth=1.0)
    axes.set(title="contours by height (4.1)", xticks=[], ylabel="height, normalised")
    axes.spines.bottom.set_visible(False)
    axes.set_aspect("equal")


def _draw_match_by_azimuth(axes: Axes, layout: MatchLayout) -> None:
    """A section of each, and the points where rays of the same azimuth from the middle meet it."""
    contour = FIRST.contours()[layout.contour][:-1, :2]
    azimuths = ray_azimuths(layout.n_rays)
    fine = ray_azimuths(layout.n_curve_rays)
    match, curve = match_contour(contour, azimuths), match_contour(contour, fine).points
    model, outline = (
        regular_points(MODEL, np.zeros(len(some)), some).points[:, :2] for some in (azimuths, fine)
    )
    for closed, points, colour, label in (
        (outline, model, charts.BLUE, "model"), (curve, match.points, charts.VERMILION, "contour"),
    ):  # fmt: skip
        axes.plot(*np.vstack([closed, closed[:1]]).T, colour, label=label)
        axes.plot(*points.T, "o", color=colour, markersize=3.5)
    for start, end in zip(match.points, model, strict=True):
        axes.plot(*np.stack([match.middle, start]).T, charts.GREY, linewidth=0.5)
        axes.plot(*np.stack([start, end]).T, charts.GREY, linestyle=":", linewidth=1.0)
    axes.plot([], [], charts.GREY, linestyle=":", label="matched")
    axes.set(title="points by azimuth (4.2)", xlabel="x, normalised", ylabel="y, normalised")
    axes.set_aspect("equal")
    style.few_ticks(axes)


def draw_parameter_space() -> Figure:
    """Figure 4.3: s, t, u of the matched points, as printed and corrected, coloured by height."""
    figure = style.new_figure(3.9)
    panels = figure.subplots(1, 2)
    edges = style.box_edges(np.zeros(3), np.ones(3))
    for axes, faithful, title in zip(
        panels, (True, False), ("as printed", "corrected"), strict=True
    ):
        triples = rebuild_thesis(SECOND.contours(), faithful=faithful).parameters
        canvas = style.show_solid(
            axes, partial(_draw_triples, triples),
            np.concatenate(edges), shape=(350, 342), title=title,
        )  # fmt: skip
        style.label_points(axes, canvas, AXIS_LABELS)
    return figure


def _draw_triples(triples: Floats, canvas: Canvas) -> None:
    for edge in style.box_edges(np.zeros(3), np.ones(3)):
        canvas.draw_line(edge, style.rgb(charts.GREY), 1.0)
    colours = viridis(np.linspace(0.0, 1.0, len(triples)), 1.0).astype(np.float64)
    for row, colour in zip(triples, colours, strict=True):
        canvas.draw_line(row, colour, 1.2)
        canvas.draw_points(row, colour, 2.0)
