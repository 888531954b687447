"""The panel beside the scene: what is to be shown, where in time one is, and figures as plots."""

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
from palpate.tools.surfaces import css_ramp, scale_top, viridis
from palpate.tools.view.browser import Scale, Scene, Wishes
from palpate.tools.view.picture import png_bytes
from palpate.tools.view.timeline import Moment, Timeline, Touch, curve_of

SPEEDS = {"1x": 1.0, "4x": 4.0, "16x": 16.0, "64x": 64.0}  # Robot seconds in a second
BACK, FORWARD = "◀ touch", "touch ▶"
WIDTH = 270  # Of the panel of figures, pixels
IMAGE = 132  # Side of the tactile image, pixels
UNTOUCHED = 236  # Grey of a taxel that touches nothing
PLOT_INTERVAL, MOST_PLOTTED = 0.5, 800  # Least time between two drawings, s; points of a plot
PALE, STRONG = "#c3c8d0", "#59636e"
AXIS: Any = {"ticks": {"show": False}, "grid": {"stroke": "#eceef1", "width": 1}}
UNKNOWN = {  # Why a solid has no colours
    "plain": "",
    "deviation": "the true solid is not known",
    "uncertainty": "the model states none",
}
Series = tuple[Floats, ...]


@dataclass(slots=True)
class Panel:
    """Controls and figures of one view, the same for all who look."""

    gui: viser.GuiApi
    recorded: bool  # Else the graph still runs
    following: bool  # Whether it shows the latest at first
    play: Any = field(init=False)
    steps: Any = field(init=False)
    slider: Any = field(init=False)
    speed: Any = field(init=False)
    follow: Any = field(init=False)
    _state: Any = field(init=False)
    _legend: Any = field(init=False)
    _wishes: dict[str, Any] = field(init=False)
    _touch: Any = field(init=False)
    _plots: dict[str, Any] = field(init=False)
    _plotted: tuple[float, Any] = (0.0, None)  # When, and what of
    _told: float = 0.0  # What the slider stood at when it was last set or obeyed, s
    _decades: tuple[float, float] = (0.0, 0.0)  # Of the plot of errors
    _shown: Touch | None = None  # Whose image is shown

    def __post_init__(self) -> None:
        gui = self.gui
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(49, 104, 142))
        gui.main_panel.dock_right()
        self._state = gui.add_html("")
        self.slider = gui.add_slider("robot time, s", 0.0, 1.0, 0.1, 0.0)
        self.play = gui.add_button("Pause")
        # On a telephone a panel of its own is a section that is closed until somebody opens it.
        more = gui.add_panel()
        more.dock_below(gui.main_panel)
        with more.add_tab("Steps and colours"):
            self._add_choices()
        beside = gui.add_panel()
        beside.dock_left()
        beside.set_width(WIDTH)
        with beside.add_tab("Against robot time, s"):
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
        """Controls that few need at first: steps, speed, and what is to be seen."""
        gui = self.gui
        self.steps = gui.add_button_group("step", (BACK, FORWARD))
        self.speed = gui.add_dropdown("speed", [*SPEEDS], initial_value="16x")
        self.follow = gui.add_checkbox(
            "follow the graph", self.following, visible=not self.recorded
        )
        colourings = ("plain", "deviation", "uncertainty")
        self._wishes = {"colouring": gui.add_dropdown("colour", colourings)}
        self._legend = gui.add_html("")
        gui.add_html(_key_html())
        for name, layer in LAYERS.items():
            self._wishes[name] = gui.add_checkbox(layer.label, layer.shown, hint=layer.hint)

    def _add_plot(self, title: str, colours: tuple[str, ...], *, log: bool = False) -> Any:
        lines: Any = [{"stroke": one, "width": 2, "points": {"show": False}} for one in colours]
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

    def wishes(self) -> Wishes:
        """What is wanted to be seen."""
        layers = frozenset(name for name in LAYERS if self._wishes[name].value)
        return Wishes(self._wishes["colouring"].value, layers)

    def on_wish(self, act: Callable[[Any], None]) -> None:
        """Have something done when another thing is wanted to be seen."""
        for one in self._wishes.values():
            one.on_update(act)

    def scrubbed(self) -> float:
        """Robot time to which somebody has moved the slider, s."""
        self._told = float(self.slider.value)
        return self._told

    def show(self, line: Timeline, when: float, moment: Moment, scene: Scene) -> None:
        """Show figures of a robot time."""
        self._reach(max(line.end, 1.0))
        if self.slider.value == self._told:  # else somebody has just moved it
            self._told = float(min(round(when, 1), self.slider.max))
            self.slider.value = self._told
        self._state.content = _state_html(line, when, moment)
        self._legend.content = _legend_html(self.wishes(), scene.scale, scene.triangles)
        self._show_touch(line, moment)

    def _reach(self, end: float) -> None:
        """Let the slider go to the end, of a running graph in strides."""
        most = np.ceil(10.0 * end) / 10.0 if self.recorded else 30.0 * np.ceil(end / 30.0)
        if self.slider.max != most:
            self.slider.max = float(most)

    def _show_touch(self, line: Timeline, moment: Moment) -> None:
        last = line.touches[moment.touches - 1] if moment.touches else None
        if last is self._shown:
            return
        self._shown, top = last, scale_top(np.array([line.deepest]))
        self._touch.content = "" if last is None else _touch_html(last, top)

    def plot(self, line: Timeline, moment: Moment, *, now: bool) -> None:
        """Draw the plots, what is past in colours; not too often, unless it shall be `now`."""
        what = (moment, len(line.touches), len(line.models), len(line.scores), len(line.estimates))
        when, before = self._plotted
        if what == before or not (now or time.monotonic() > when + PLOT_INTERVAL):
            return
        self._plotted = time.monotonic(), what
        passed = line.touches[moment.touches - 1].time if moment.touches else -1.0
        times, rate = line.touch_rate()
        force = np.array([one.force for one in line.touches])
        self._plots["force"].data = _split(times, (force,), passed)
        self._plots["rate"].data = _split(times, (rate,), passed)
        _, times, error, bound = curve_of(line)
        passed = line.models[moment.models - 1].robot_time if moment.models else -1.0
        curves = 1e3 * error, 1e3 * bound
        self._span(np.concatenate(curves))
        self._plots["error"].data = _split(times, curves, passed, hidden=np.inf)

    def _span(self, values: Floats) -> None:
        """Let the plot of errors reach over all values, in whole powers of ten."""
        known = np.log10(values[np.isfinite(values) & (values > 0.0)])
        span = (np.floor(known.min()), np.ceil(known.max())) if len(known) else (-2.0, 1.0)
        if span != self._decades:
            self._decades = span
            reach = (10.0 ** span[0], 10.0 ** max(span[1], span[0] + 1.0))
            self._plots["error"].scales = {"x": {"time": False}, "y": {"distr": 3, "range": reach}}


def _split(times: Floats, curves: Series, passed: float, hidden: float = np.nan) -> Series:
    """Times, and of each curve all of it and what is past, thinned so that it can be drawn.

    What is `hidden` has no place: on a scale of logarithms NaN has one, which is zero's.
    """
    every = max(1, len(times) // MOST_PLOTTED)
    past = times[::every] <= passed
    pairs = ((one[::every], np.where(past, one[::every], hidden)) for one in curves)
    return (times[::every], *(one for pair in pairs for one in pair))


def _touch_html(touch: Touch, top: float) -> str:
    """The tactile image in colours, its y axis upwards, and what the touch was."""
    told = [f"finger {touch.finger}", touch.outcome, touch.kind]
    if not np.isnan(touch.force):
        told.append(f"{touch.force:.1f} N")
    words = "".join(f"<div>{one}</div>" for one in told)
    if not touch.compression.size:
        return _html(words)
    colours = viridis(touch.compression.ravel(), top).reshape(*touch.compression.shape, 3)
    colours[touch.compression <= 0.0] = UNTOUCHED
    source = "data:image/png;base64," + b64encode(png_bytes(colours[::-1])).decode()
    image = f'<img src="{source}" style="width:{IMAGE}px;image-rendering:pixelated">'
    row = f'<div style="display:flex;gap:0.6rem">{image}<div>{words}</div></div>'
    return _html(row, _bar(f"compression, mm: 0 to {1e3 * top:g}", of_surface=False))


def _state_html(line: Timeline, when: float, moment: Moment) -> str:
    touch = f"touch {moment.touches} of {len(line.touches)}"
    told = [f"<b>robot time {when:.1f} s, {touch}</b>"]
    told.append(f"{line.traced(moment)} of {line.traced(line.at(np.inf))} contours traced")
    if moment.models:
        number = line.models[moment.models - 1].number
        score, known = line.scores.get(number), line.estimates.get(number)
        text = f"solid {moment.models} of {len(line.models)}"
        if score is not None:
            text += f", error {1e3 * score.rms:.3g} mm"
        if known is not None and known.rms_bound_95 is not None:
            text += f", bound {1e3 * known.rms_bound_95:.3g} mm"
        told.append(text)
    if line.done is not None and when >= line.end:
        told.append(f"over: {line.done.reason}")
    return _html(*told)


def _key_html() -> str:
    """Which colour is what."""
    box = "display:inline-block;width:0.8em;height:0.8em;border:1px solid #8c959f;background:"
    parts = (
        f'<span style="white-space:nowrap"><i style="{box}{layer.colour}"></i> {layer.label}</span>'
        for layer in LAYERS.values()
    )
    return _html(" ".join(parts))


def _legend_html(wishes: Wishes, scale: Scale | None, triangles: tuple[int, int]) -> str:
    shown, whole = triangles
    coarse = f"drawn with {shown:,} of its {whole:,} triangles" if shown < whole else ""
    if scale is None:
        why = UNKNOWN[wishes.colouring] if whole else ""
        return _html(why, coarse)
    return _html(
        _bar(f"{SCALARS[scale.name]}, mm: 0 to {1e3 * scale.top:g}", of_surface=True), coarse
    )


def _bar(text: str, *, of_surface: bool) -> str:
    """A bar of all colours, and what they mean."""
    bar = f"height:10px;border-radius:3px;background:{css_ramp(of_surface=of_surface)}"
    low, _, high = text.rpartition(": ")[2].partition(" to ")
    ends = f"<span>{low}</span><span>{text.rpartition(': ')[0]}</span><span>{high}</span>"
    return (
        f'<div style="{bar}"></div>'
        f'<div style="display:flex;justify-content:space-between">{ends}</div>'
    )


def _html(*lines: str) -> str:
    body = "".join(f"<div>{one}</div>" for one in lines if one)
    return f'<div style="font-size:0.8rem;line-height:1.5;padding:0 0.7rem 0.3rem">{body}</div>'
