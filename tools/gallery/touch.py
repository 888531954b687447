"""Chapter 3 of the thesis: filters on a tactile frame, and the function that sets the steps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from palpate.core import touch
from palpate.core.arrays import Floats
from palpate.core.explore.planners import TEMPLATES, Thesis, polyline_of
from palpate.core.splines import CUBIC, Basis, averaged_knots, evaluate_grid, interpolate_grid
from palpate.launch import charts
from palpate.tools.gallery import style
from palpate.tools.surfaces import viridis
from palpate.tools.view.rasteriser import Canvas

VIEW = style.View(azimuth=-60.0, elevation=38.0)
PAD = touch.Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterSettings:
    """Noise that is added to a frame, and the relief that it is drawn as."""

    noise: float = 40e-6  # [m] standard deviation of a taxel
    impulse_share: float = 0.05  # fraction of taxels: half of these read 0, the others `impulse`
    impulse: float = 2.4e-3  # [m] compression
    min_compression: float = 200e-6  # [m] of a taxel in contact
    seed: int = 0
    max_compression: float = 1.6e-3  # [m] at which the colours end
    height_scale: float = 3.0  # drawn height / compression
    n_fine: int = 91  # points along a side of an interpolating surface
    n_lines: int = 15  # steps between drawn lines along a side of it


@dataclass(frozen=True, slots=True, kw_only=True)
class StepLayout:
    """Domain on which the step between contours is drawn."""

    n_segments: int = 5  # of the polylines, as in the thesis
    max_argument: float = 12.0  # largest drawn argument: rate times curvature times height
    polyline_reach: float = 40.0  # largest argument that the polylines of `Thesis` cover
    max_bend: float = 25.0  # largest drawn mean curvature times the height
    max_change: float = 12.5  # largest drawn change of the mean curvature, times the height


FILTERS, STEP = FilterSettings(), StepLayout()


class Frame(NamedTuple):
    """A tactile frame after a filter."""

    title: str
    image: Floats  # (rows, cols) compression [m]
    is_smooth: bool  # drawn as the B-spline surface through it, else taxel by taxel


def draw_filters(settings: FilterSettings = FILTERS) -> Figure:
    """Figures 3.3 to 3.6: the corner of a box, raw and after filters, and as palpate mends it."""
    truth = _corner()
    figure = style.new_figure(5.0)
    panels = figure.subplots(2, 3)
    x, y = PAD.grid()
    frames = _frames(truth, settings)
    raw = np.stack([x, y, settings.height_scale * frames[0].image], axis=-1).reshape(-1, 3)
    for axes, frame in zip(panels.flat, frames, strict=True):
        style.show_solid(axes, partial(_draw_relief, frame, settings), raw, VIEW, shape=(180, 233))
        error = 1e6 * math.sqrt(float(np.mean((frame.image - truth) ** 2)))
        axes.set_title(f"{frame.title}\nrms error {error:.0f} $\\mu$m")
    scale = ScalarMappable(Normalize(0.0, 1e3 * settings.max_compression), "viridis")
    figure.colorbar(
        scale, ax=panels, location="bottom", shrink=0.6, aspect=40, label="compression, mm"
    )
    return figure


def _corner() -> Floats:
    """Compression under the corner of a box's flat top, pressed by 1.2 mm, a little askew."""
    x, y = PAD.grid()
    turn = math.radians(12.0)
    along = x * math.cos(turn) + y * math.sin(turn) + 3.3e-3
    across = y * math.cos(turn) - x * math.sin(turn) + 2.6e-3
    return np.where((along > 0.0) & (across > 0.0), 1.2e-3 + 0.01 * x, 0.0)


def _frames(truth: Floats, settings: FilterSettings) -> list[Frame]:
    """The frame with noise, and after each filter."""
    rng = np.random.default_rng(settings.seed)
    raw = truth + settings.noise * rng.normal(size=truth.shape)
    hit, up = rng.random((2, *truth.shape))
    impulses = np.where(up < 0.5, 0.0, settings.impulse)
    raw = np.where(hit < settings.impulse_share, impulses, raw)
    noise = _noise_variance(raw)
    median = touch.median_filter(raw)
    then_wiener = touch.median_then_wiener(raw, _noise_variance(median))
    mended = touch.remove_impulses(PAD, raw, settings.min_compression, settings.noise).image
    return [
        Frame("raw (3.3)", raw, False),
        Frame("Wiener (3.4)", touch.adaptive_wiener(raw, noise), False),
        Frame("median (3.4)", median, False),
        Frame("Wiener, median (3.5)", touch.wiener_then_median(raw, noise), True),
        Frame("median, Wiener (3.6)", then_wiener, True),
        Frame("palpate: impulses mended", mended, False),
    ]


def _noise_variance(image: Floats) -> float:
    """Mean of the variances around each taxel [m^2], which stands for an unknown noise."""
    return float(touch.neighbourhoods(image).var(axis=-1).mean())


def _draw_relief(frame: Frame, settings: FilterSettings, canvas: Canvas) -> None:
    x, y = PAD.grid()
    grid, stride = np.stack([x, y, frame.image], axis=-1), 1
    if frame.is_smooth:
        grid, stride = _interpolated(grid, settings.n_fine), settings.n_fine // settings.n_lines
    colours = viridis(grid[..., 2].ravel(), settings.max_compression)
    scale = [1.0, 1.0, settings.height_scale]
    mesh = style.grid_mesh(grid * scale)
    canvas.draw_mesh(mesh.vertices, mesh.faces, colours.astype(np.float64), lit=False)
    for curve in style.grid_lines(grid[::stride, ::stride] * scale):
        canvas.draw_line(curve, style.rgb("#50606c"), 1.0)


def _interpolated(grid: Floats, n_fine: int) -> Floats:
    """Points (n_fine, n_fine, 3) of the bicubic B-spline surface through a grid of points."""
    sites = [np.linspace(0.0, 1.0, count) for count in grid.shape[:2]]
    bases = [Basis(averaged_knots(along), CUBIC) for along in sites]
    fine = np.linspace(0.0, 1.0, n_fine)
    return evaluate_grid(bases, interpolate_grid(bases, sites, grid).control, (fine, fine))


def draw_step_components(layout: StepLayout = STEP) -> Figure:
    """Figures 3.7 and 3.8: both components of the step, and five straight pieces for each."""
    figure = style.new_figure(2.9)
    panels = figure.subplots(1, 2, sharey=True)
    names = (
        ("$s_1$", "$\\bar{\\kappa}\\,h$", Thesis().bend_rate),
        ("$s_2$", "$\\Delta\\bar{\\kappa}\\,h$", Thesis().change_rate),
    )
    for axes, (name, along, rate) in zip(panels, names, strict=True):
        _draw_component(axes, rate, layout)
        axes.set(xlabel=f"{along} (curvature times height, 1)", title=f"component {name}")
    panels[0].set_ylabel("value, 1")
    panels[0].legend()
    return figure


def _draw_component(axes: Axes, rate: float, layout: StepLayout) -> None:
    template = TEMPLATES["exponential"]
    polyline = polyline_of(lambda x: template(x, 1.0), layout.polyline_reach, layout.n_segments)
    end = layout.max_argument
    x = np.linspace(0.0, end, 400)
    axes.plot(x / rate, template(x, 1.0), charts.BLUE, linewidth=3.0, alpha=0.5, label="original")
    shown = polyline.knots <= end
    axes.plot(x / rate, np.interp(x, *polyline), charts.VERMILION, label="five pieces")
    axes.plot(polyline.knots[shown] / rate, polyline.values[shown], "o", color=charts.VERMILION)
    axes.set(xlim=(0.0, end / rate), ylim=(0.0, 1.05))


def draw_step_function(layout: StepLayout = STEP) -> Figure:
    """Figures 3.9 and 3.10: the step over curvature and change, and what straight pieces alter."""
    figure = style.new_figure(2.9)
    panels = figure.subplots(1, 3, sharey=True)
    bends, changes = (np.linspace(0.0, end, 81) for end in (layout.max_bend, layout.max_change))
    original, pieces = (
        np.array([[100.0 * rule.later(bend, change, 0) for bend in bends] for change in changes])
        for rule in (Thesis(), Thesis(segments=layout.n_segments))
    )
    titles = "original (3.10)", "five pieces each (3.9)", "difference (3.10)"
    for axes, values, title in zip(
        panels, (original, pieces, pieces - original), titles, strict=True
    ):
        difference = values.min() < 0.0
        most = 0.6 if difference else 100.0 * Thesis().most
        shown = axes.pcolormesh(
            bends, changes, values, vmin=-most if difference else 0.0, vmax=most,
            cmap="PuOr" if difference else "viridis", shading="gouraud", rasterized=True,
        )  # fmt: skip
        if not difference:
            levels = axes.contour(
                bends, changes, values, (5.0, 10.0, 15.0), colors="white", linewidths=0.7
            )
            axes.clabel(levels, fmt="%g %%", fontsize=7)
        axes.set(title=title, xlabel="$\\bar{\\kappa}\\,h$, 1")
        ticks = np.linspace(-most if difference else 0.0, most, 5)
        figure.colorbar(
            shown, ax=axes, location="bottom", ticks=ticks, label="step, % of the height"
        )
    panels[0].set_ylabel("$\\Delta\\bar{\\kappa}\\,h$, 1")
    return figure
