"""The panel beside the scene: choice of what is shown, the time, and figures as plots."""

from __future__ import annotations

import time
from base64 import b64encode
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import viser

from palpate.core.arrays import Floats
from palpate.launch.colours import COLOURS
from palpate.tools.drawables import LAYERS, SCALARS
from palpate.tools.surfaces import css_ramp, scale_top, tactile_colours
from palpate.tools.view.browser import Scale, Scene, ViewOptions
from palpate.tools.view.picture import png_bytes
from palpate.tools.view.timeline import Moment, Timeline, Touch, curve_of

SPEEDS = {"1x": 1.0, "4x": 4.0, "16x": 16.0, "64x": 64.0}  # robot time over clock time
BACK, FORWARD = "◀ touch", "touch ▶"
PALE, STRONG = "#c3c8d0", "#59636e"
AXIS: Any = {"ticks": {"show": False}, "grid": {"stroke": "#eceef1", "width": 1}}
UNKNOWN = {  # why a solid has no colours
    "plain": "",
    "deviation": "the true solid is not known",
    "uncertainty": "the model states none",
}
Series = tuple[Floats, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelLayout:
    """Sizes of the panel of figures, and how often its plots are drawn."""

    width: int = 270  # [pixels]
    image_side: int = 132  # [pixels] of the tactile image
    plot_interval: float = 0.5  # [s] at least, between two drawings of the plots
    max_plotted: int = 800  # points of a plot, about


DEFAULT_LAYOUT = PanelLayout()


@dataclass(slots=True)
class Panel:
    """Controls and figures of one view, the same for all who look."""

    gui: viser.GuiApi
    recorded: bool  # else the graph still runs
    following: bool  # whether it shows the latest moment at first
    layout: PanelLayout = DEFAULT_LAYOUT
    play: Any = field(init=False)
    steps: Any = field(init=False)
    slider: Any = field(init=False)
    speed: Any = field(init=False)
    follow: Any = field(init=False)
    _state: Any = field(init=False)
    _legend: Any = field(init=False)
    _options: dict[str, Any] = field(init=False)
    _touch: Any = field(init=False)
    _plots: dict[str, Any] = field(init=False)
    _plotted: tuple[float, Any] = (0.0, None)  # when, and of what
    _set_time: float = 0.0  # [s] of the slider when it was last set or read
    _error_range: tuple[float, float] = (0.0, 0.0)  # powers of ten in the plot of errors
    _shown: Touch | None = None  # whose image is shown

    def __post_init__(self) -> None:
        gui = self.gui
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(49, 104, 142))
        gui.main_panel.dock_right()
        self._state = gui.add_html("")
        self.slider = gui.add_slider("robot time, s", 0.0, 1.0, 0.1, 0.0)
        self.play = gui.add_button("Pause")
        # On a telephone a second panel is a section that is closed at first.
        choices = gui.add_panel()
        choices.dock_below(gui.main_panel)
        with choices.add_tab("Steps and colours"):
            self._add_choices()
        plots = gui.add_panel()
        plots.dock_left()
        plots.set_width(self.layout.width)
        with plots.add_tab("Against robot time, s"):
            self._touch = gui.add_html("")
            self._plots = {
                "force": self._add_plot("force on the pad, N", (PALE, STRONG)),
                "rate": self._add_plot("touches in a second", (PALE, STRONG)),
                "error": self._add_plot(
                    "error (dark) and error bound (orange), mm",
                    (PALE, COLOURS["error"], PALE, COLOURS["bound"]),
                    log=True,
                ),
            }

    def _add_choices(self) -> None:
        """Add the controls that few need at first: steps, speed, and what is shown."""
        gui = self.gui
        self.steps = gui.add_button_group("step", (BACK, FORWARD))
        self.speed = gui.add_dropdown("speed", [*SPEEDS], initial_value="16x")
        self.follow = gui.add_checkbox(
            "follow the graph", self.following, visible=not self.recorded
        )
        colourings = ("plain", "deviation", "uncertainty")
        self._options = {"colouring": gui.add_dropdown("colour", colourings)}
        self._legend = gui.add_html("")
        gui.add_html(_key_html())
        for name, layer in LAYERS.items():
            self._options[name] = gui.add_checkbox(layer.label, layer.shown, hint=layer.hint)

    def _add_plot(self, title: str, colours: tuple[str, ...], *, log: bool = False) -> Any:
        lines: Any = [
            {"stroke": colour, "width": 2, "points": {"show": False}} for colour in colours
        ]
        axes: Any = [{"size": size, **AXIS} for size in (26, 46)]  # along x, along y
        return self.gui.add_uplot(
            (np.zeros(0),) * (len(colours) + 1),
            ({}, *lines),
            title=title,
            scales={"x": {"time": False}, "y": {"distr": 3 if log else 1}},
            axes=(*axes,),
            legend={"show": False},
            padding=(12, 12, 0, 0),
            height=150 if log else 136,
        )

    def options(self) -> ViewOptions:
        """What is chosen to be seen."""
        layers = frozenset(name for name in LAYERS if self._options[name].value)
        return ViewOptions(self._options["colouring"].value, layers)

    def on_change(self, act: Callable[[Any], None]) -> None:
        """Call `act` whenever another option is chosen."""
        for control in self._options.values():
            control.on_update(act)

    def scrubbed(self) -> float:
        """Robot time to which a user has moved the slider [s]."""
        self._set_time = float(self.slider.value)
        return self._set_time

    def show(self, line: Timeline, when: float, moment: Moment, scene: Scene) -> None:
        """Show the figures of a robot time `when` [s]."""
        self._extend_slider(max(line.end, 1.0))
        if self.slider.value == self._set_time:  # else a user has just moved it
            self._set_time = float(min(round(when, 1), self.slider.max))
            self.slider.value = self._set_time
        self._state.content = _state_html(line, when, moment)
        self._legend.content = _legend_html(self.options(), scene.scale, scene.triangles)
        self._show_touch(line, moment)

    def _extend_slider(self, end: float) -> None:
        """Extend the slider to the end [s], for a running graph by 30 s at a time."""
        limit = np.ceil(10.0 * end) / 10.0 if self.recorded else 30.0 * np.ceil(end / 30.0)
        if self.slider.max != limit:
            self.slider.max = float(limit)

    def _show_touch(self, line: Timeline, moment: Moment) -> None:
        last = line.touches[moment.touches - 1] if moment.touches else None
        if last is self._shown:
            return
        self._shown, top = last, scale_top(np.array([line.max_compression]))
        self._touch.content = "" if last is None else _touch_html(last, top, self.layout.image_side)

    def plot(self, line: Timeline, moment: Moment, *, now: bool) -> None:
        """Draw the plots, the past in colours; at most once in `plot_interval`, unless `now`."""
        state = (moment, len(line.touches), len(line.models), len(line.scores), len(line.estimates))
        last, before = self._plotted
        if state == before or not (now or time.monotonic() > last + self.layout.plot_interval):
            return
        self._plotted, n = (time.monotonic(), state), self.layout.max_plotted
        passed = line.touches[moment.touches - 1].time if moment.touches else -1.0
        times, rate = line.touch_rate()
        force = np.array([touch.force for touch in line.touches])
        self._plots["force"].data = _split(times, (force,), passed, n)
        self._plots["rate"].data = _split(times, (rate,), passed, n)
        _, times, error, bound = curve_of(line)
        passed = line.models[moment.models - 1].robot_time if moment.models else -1.0
        curves = 1e3 * error, 1e3 * bound
        self._set_error_range(np.concatenate(curves))
        self._plots["error"].data = _split(times, curves, passed, n, hidden=np.inf)

    def _set_error_range(self, values: Floats) -> None:
        """Set the range of the plot of errors to whole powers of ten around all values."""
        known = np.log10(values[np.isfinite(values) & (values > 0.0)])
        span = (np.floor(known.min()), np.ceil(known.max())) if len(known) else (-2.0, 1.0)
        if span != self._error_range:
            self._error_range = span
            reach = (10.0 ** span[0], 10.0 ** max(span[1], span[0] + 1.0))
            self._plots["error"].scales = {"x": {"time": False}, "y": {"distr": 3, "range": reach}}


def _split(times: Floats, curves: Series, passed: float, n: int, hidden: float = np.nan) -> Series:
    """Times, and each curve, whole and only its past, thinned to about `n` points.

    `hidden` replaces future values; a logarithmic scale draws NaN as 0, but leaves out infinity.
    """
    stride = max(1, len(times) // n)
    past = times[::stride] <= passed
    pairs = ((curve[::stride], np.where(past, curve[::stride], hidden)) for curve in curves)
    return (times[::stride], *(values for pair in pairs for values in pair))


def _touch_html(touch: Touch, top: float, image_side: int) -> str:
    """The tactile image in colours, its y axis upwards, and the facts of the touch."""
    facts = [f"finger {touch.finger}", touch.outcome, touch.kind]
    if not np.isnan(touch.force):
        facts.append(f"{touch.force:.1f} N")
    words = "".join(f"<div>{fact}</div>" for fact in facts)
    if not touch.compression.size:
        return _html(words)
    colours = tactile_colours(touch.compression, top)
    source = "data:image/png;base64," + b64encode(png_bytes(colours[::-1])).decode()
    image = f'<img src="{source}" style="width:{image_side}px;image-rendering:pixelated">'
    row = f'<div style="display:flex;gap:0.6rem">{image}<div>{words}</div></div>'
    return _html(row, _bar(f"compression, mm: 0 to {1e3 * top:g}", of_surface=False))


def _state_html(line: Timeline, when: float, moment: Moment) -> str:
    touch = f"touch {moment.touches} of {len(line.touches)}"
    rows = [f"<b>robot time {when:.1f} s, {touch}</b>"]
    rows.append(f"{line.traced(moment)} of {line.traced(line.at(np.inf))} contours traced")
    if moment.models:
        number = line.models[moment.models - 1].number
        score, estimate = line.scores.get(number), line.estimates.get(number)
        text = f"solid {moment.models} of {len(line.models)}"
        if score is not None:
            text += f", error {1e3 * score.rms:.3g} mm"
        if estimate is not None and estimate.rms_bound_95 is not None:
            text += f", bound {1e3 * estimate.rms_bound_95:.3g} mm"
        rows.append(text)
    if line.done is not None and when >= line.end:
        rows.append(f"over: {line.done.reason}")
    return _html(*rows)


def _key_html() -> str:
    """Names of the layers beside their colours."""
    box = "display:inline-block;width:0.8em;height:0.8em;border:1px solid #8c959f;background:"
    parts = (
        f'<span style="white-space:nowrap"><i style="{box}{layer.colour}"></i> {layer.label}</span>'
        for layer in LAYERS.values()
    )
    return _html(" ".join(parts))


def _legend_html(options: ViewOptions, scale: Scale | None, triangles: tuple[int, int]) -> str:
    shown, whole = triangles
    coarse = f"drawn with {shown:,} of its {whole:,} triangles" if shown < whole else ""
    if scale is None:
        why = UNKNOWN[options.colouring] if whole else ""
        return _html(why, coarse)
    return _html(
        _bar(f"{SCALARS[scale.name]}, mm: 0 to {1e3 * scale.top:g}", of_surface=True), coarse
    )


def _bar(text: str, *, of_surface: bool) -> str:
    """A bar of all colours, with the quantity and its ends."""
    bar = f"height:10px;border-radius:3px;background:{css_ramp(of_surface=of_surface)}"
    low, _, high = text.rpartition(": ")[2].partition(" to ")
    ends = f"<span>{low}</span><span>{text.rpartition(': ')[0]}</span><span>{high}</span>"
    return (
        f'<div style="{bar}"></div>'
        f'<div style="display:flex;justify-content:space-between">{ends}</div>'
    )


def _html(*lines: str) -> str:
    body = "".join(f"<div>{line}</div>" for line in lines if line)
    return f'<div style="font-size:0.8rem;line-height:1.5;padding:0 0.7rem 0.3rem">{body}</div>'
