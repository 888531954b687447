"""Charts of what accuracy cost a run: errors and bounds against each cost, and processor times.

Costs and errors are on log scales, with a mark for each model; errors below the sampling floor
cannot be measured. The dashed line leads to the forecast of the next halving of the bound.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.launch import charts
from palpate.launch.colours import COLOURS
from palpate.launch.exchange_rate import AXES, BOUND, ERROR, Chart, chart_of
from palpate.launch.log_scale import MIN_VALUE, log_scale

TITLE = "What accuracy cost"


@dataclass(frozen=True, slots=True, kw_only=True)
class CostChartSettings:
    """Sizes of the charts of a run."""

    figure_size: tuple[float, float] = (980.0, 790.0)  # width and height of all charts [pixel]
    panel_size: tuple[float, float] = (320.0, 330.0)  # of a single chart of a page [pixel]
    legend_entry_width: float = 180.0  # [pixel]
    max_bars: int = 14  # of a bar chart; the last one is the sum of all shorter times


def cost_svg(summary: Mapping[str, Any]) -> str:
    """All charts of a run as the text of one SVG file, which says the run's figures as well."""
    return charts.svg_text(draw_cost(summary), TITLE)


@charts.styled
def draw_cost(
    summary: Mapping[str, Any],
    has_heading: bool = True,
    settings: CostChartSettings = CostChartSettings(),
) -> Figure:
    """All charts of a run: a panel for each cost, below them the times by step and by node."""
    figure = charts.new_figure(*settings.figure_size)
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=(1.15, 1.0))[:, 0]
    known, (title, facts) = _charts(summary), _heading(summary)
    for number, (axis, chart) in enumerate(known.items(), 1):
        axes = above.add_subplot(1, len(known), number)
        _draw_errors(axes, chart, axis, _levels(known))
        if number > 1:
            axes.set_ylabel("")
            axes.tick_params(labelleft=False)
    if known:
        entries = above.axes[0].get_legend_handles_labels()
        columns = int(settings.figure_size[0] / settings.legend_entry_width)
        legend = above.legend(*entries, loc="outside upper left", ncols=columns, alignment="left")
        legend.set_title(facts if has_heading else None)
    else:
        above.text(0.01, 0.5, f"no model was judged: {facts}")
    if has_heading:
        figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
    nodes = {name: node["cpu_s"] for name, node in summary["nodes"].items()}
    longest = max([*summary["steps"].values(), *nodes.values()], default=0.0)
    left, right = below.subplots(1, 2)
    _draw_bars(left, "Processor time by step", summary["steps"], longest, settings.max_bars)
    _draw_bars(right, "by node", nodes, longest, settings.max_bars)
    return figure


def _heading(summary: Mapping[str, Any]) -> tuple[str, str]:
    ended = summary["status"] + (", goal missed" if summary["missed"] else "")
    name = f": {summary['scene']}" if summary["scene"] else ""
    counts = [f"{summary['contours']} contours", f"{summary['touches']} touches"]
    counts.append(f"robot {summary['robot_time_s']:.0f} s")
    if summary["compute_s"] is not None:
        counts.append(f"compute {summary['compute_s']:.1f} s")
    if summary["largest_untouched_m"] is not None:
        counts.append(f"untouched gap {1e3 * summary['largest_untouched_m']:.3g} mm")
    return f"{TITLE}{name} ({ended})", ", ".join(counts)


@charts.styled
def draw_panels(
    summary: Mapping[str, Any], settings: CostChartSettings = CostChartSettings()
) -> dict[str, Figure]:
    """Each chart of a run as its own figure, by its title; a page sets them side by side."""
    figures, known = dict[str, Figure](), _charts(summary)
    for axis, chart in known.items():
        figure = charts.new_figure(*settings.panel_size)
        _draw_errors(figure.subplots(), chart, axis, _levels(known))
        figure.legend(loc="outside lower center", ncols=2)
        figures[f"True error and error bound against {AXES[axis][0]}"] = figure
    steps = summary["steps"]
    figure = charts.new_figure(*settings.panel_size)
    longest = max(steps.values(), default=0.0)
    _draw_bars(figure.subplots(), "Processor time by step", steps, longest, settings.max_bars)
    return {**figures, "Processor time by step of the work": figure}


def _charts(summary: Mapping[str, Any]) -> dict[str, Chart]:
    return {axis: chart for axis in AXES if (chart := chart_of(summary, axis)) is not None}


def _levels(known: Mapping[str, Chart]) -> list[float]:
    """All errors that the error axis has to contain [m]."""
    errors = [error for chart in known.values() for _, error in chart.points]
    levels = [level for chart in known.values() for level in (chart.floor, chart.tolerance)]
    return [*errors, *(level for level in levels if level is not None)]


def _draw_errors(axes: Axes, chart: Chart, axis: str, errors: Sequence[float]) -> None:
    costs, heights = log_scale([cost for cost, _ in chart.points]), log_scale(errors)
    axes.set(xscale="log", yscale="log", xlabel=AXES[axis][0], ylabel="rms error, mm")
    axes.set(xlim=(costs.low, costs.high), ylim=(1e3 * heights.low, 1e3 * heights.high))
    axes.grid()
    charts.log_ticks(axes)
    for key, label, style in (
        (ERROR, "true error (rms)", {"marker": "o", "color": COLOURS["error"], "zorder": 4.0}),
        (BOUND, "error bound (95 %)", {"marker": "s", "color": COLOURS["bound"], "zorder": 3.0}),
        ("", "next halving of the bound", {"marker": "D", "color": charts.DIM, "ls": "--"}),
    ):
        points = chart.series[key] if key else chart.forecast or ()
        if points:
            x, y = zip(*points, strict=True)
            filled = charts.INK if key == ERROR else charts.PAGE
            shown = None if key else [1]  # the forecast starts at the mark of the last model
            drawn = [1e3 * max(error, MIN_VALUE) for error in y]
            axes.plot(x, drawn, label=label, markersize=5.0,
                      markerfacecolor=filled, markevery=shown, clip_on=False, **style)  # fmt: skip
    if chart.floor is not None:
        level = 1e3 * chart.floor
        axes.axhspan(axes.get_ylim()[0], level, color=charts.GREY, alpha=0.12, linewidth=0.0)
        label = f"sampling floor {level:.2g} mm"
        axes.axhline(level, color=charts.GREY, linestyle=":", label=label)
    if chart.tolerance is not None:
        level = 1e3 * chart.tolerance
        label = f"tolerance {level:.3g} mm"
        axes.axhline(level, color=COLOURS["tolerance"], linestyle=(0.0, (6.0, 2.0)), label=label)


def _draw_bars(
    axes: Axes, title: str, times: Mapping[str, float], longest: float, max_bars: int
) -> None:
    """Times as bars, the longest first; beyond `max_bars` the shortest share the last bar."""
    rows, total = sorted(times.items(), key=lambda item: -item[1]), sum(times.values())
    if len(rows) > max_bars:
        rest = sum(seconds for _, seconds in rows[max_bars - 1 :])
        rows = [*rows[: max_bars - 1], (f"{len(rows) - max_bars + 1} others", rest)]
    bars = axes.barh([name for name, _ in rows], [seconds for _, seconds in rows], color=charts.BAR)
    shares = (f" ({seconds / total:.0%})" if seconds > 0.01 * total else "" for _, seconds in rows)
    labels = [f"{s:.2f} s{share}" for (_, s), share in zip(rows, shares, strict=True)]
    axes.bar_label(bars, labels, padding=4.0)
    axes.set(xlim=(0.0, 1.5 * longest or 1.0), ylim=(max_bars - 0.5, -0.5))  # room for the labels
    axes.set_title(f"{title}, {total:.1f} s", loc="left", fontweight="bold")
    axes.xaxis.set_visible(False)
    axes.spines[["bottom", "left"]].set_visible(False)
    axes.tick_params(length=0.0)
