"""Style of all charts, and writing them to files with matplotlib.

A figure is measured in CSS pixels and drawn in the colours of a light page. In an SVG file, text
uses the font of the page, equal figures give equal files, and dark pages show the colours of
`ON_DARK`. Importing matplotlib takes half a second: modules that seldom draw import this late.

Series have the colours of Okabe and Ito (2008), which colour-blind readers tell apart.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import matplotlib
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.rcsetup import cycler
from matplotlib.textpath import text_to_path
from matplotlib.ticker import MaxNLocator

from palpate.launch.colours import COLOURS, ERROR_ON_DARK
from palpate.launch.files.file_access import write_atomically
from palpate.launch.log_scale import LogScale

PIXELS_PER_INCH = 96  # definition of the CSS pixel
MIN_TICK_SPACING = {"x": 44.0, "y": 28.0}  # mean distance of neighbouring ticks [pixel]
INK, DIM, GRID, PAGE, PANEL = "#1f2328", "#59636e", "#d0d7de", "#ffffff", "#eef2f7"
BAR, GOOD = "#6e93c9", "#1a7f37"
BLUE, VERMILION, GREEN, ORANGE = "#0072b2", "#d55e00", "#009e73", "#e69f00"
PURPLE, SKY, OLIVE, GREY = "#cc79a7", "#56b4e9", "#999933", "#8c8c8c"
SERIES = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, OLIVE, INK)
ON_DARK = {
    **{INK: "#e6edf3", DIM: "#9da7b3", GRID: "#30363d", PAGE: "#0d1117", PANEL: "#1c2430"},
    **{BAR: "#3d6399", GOOD: "#3fb950", BLUE: "#58a6ff", VERMILION: "#f0883e"},
    COLOURS["error"]: ERROR_ON_DARK,
}
STYLE: dict[Any, Any] = {
    "savefig.dpi": "figure",
    "font.family": "DejaVu Sans",  # comes with matplotlib, and is wider than most
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.prop_cycle": cycler(color=SERIES),
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "legend.title_fontsize": 8.0,
    "legend.handlelength": 1.6,
    "legend.columnspacing": 1.2,
    "lines.linewidth": 1.6,
    "axes.edgecolor": GREY,
    **dict.fromkeys(("text.color", "axes.labelcolor", "xtick.color", "ytick.color"), INK),
    "svg.fonttype": "none",
    "text.parse_math": False,  # a name may contain two dollar signs
}
styled = matplotlib.rc_context(STYLE)  # decorator of functions that draw
_FONT = 'system-ui, "Segoe UI", Helvetica, Arial, "DejaVu Sans", sans-serif'
_NOT_XML = re.compile("[^\t\n\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_SUPERFLUOUS = re.compile(
    r"""<metadata>.*?</metadata>\n*|<!--.*?-->\n*|(?<=\n) +| ?\n(?=[MLCQz"])""", re.DOTALL
)


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of a size in CSS pixels."""
    size = width / PIXELS_PER_INCH, height / PIXELS_PER_INCH
    return Figure(figsize=size, dpi=PIXELS_PER_INCH, layout="constrained")


def log_ticks(axes: Axes, which: str = "xy") -> None:
    """Label the log scales of a drawn panel with round numbers, as 0.5 or 20."""
    panel = axes.get_window_extent()
    for name, pixels in (("x", panel.width), ("y", panel.height)):
        if name in which:
            axis: Axis = getattr(axes, f"{name}axis")
            scale = LogScale(*axis.get_view_interval())
            max_ticks = max(2, int(pixels / MIN_TICK_SPACING[name]))
            ticks = scale.ticks(max_ticks)
            if len(ticks) < 2:  # a narrow part of a decade
                ticks = [*MaxNLocator(min(max_ticks, 4)).tick_values(*scale)][1:-1]
            axis.set_ticks([], minor=True)
            axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])


@contextmanager
def _missing_glyphs_ignored() -> Iterator[None]:
    """Ignore warnings of glyphs that matplotlib's font lacks: the page's font may have them."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")
        yield


@_missing_glyphs_ignored()
def text_width(text: str, size: float, weight: str = "normal") -> float:
    """Width of a text in points, of a size in points."""
    font = FontProperties(family=STYLE["font.family"], size=size, weight=weight)
    width: float = text_to_path.get_text_width_height_descent(text, font, ismath=False)[0]
    return width


@_missing_glyphs_ignored()
@styled
def svg_text(figure: Figure, title: str, notes: Mapping[str, str] | None = None) -> str:
    """Text of an SVG file of a figure, with `title` as its accessible name.

    `notes` maps the ``gid`` of an artist to the tooltip that is shown over it.
    """
    file, title = io.StringIO(), xml_text(title)
    salt = f"{title}, {figure.get_size_inches()}"  # ids differ within a page
    with matplotlib.rc_context({"svg.hashsalt": salt}):
        figure.savefig(file, format="svg", metadata=dict.fromkeys(("Date", "Creator")))

    def titled(group: re.Match[str]) -> str:
        note = (notes or {}).get(group[1])
        return "<g>" if note is None else f"<g>\n<title>{escape(xml_text(note))}</title>"

    text = re.sub('<g id="([^"]*)">', titled, _SUPERFLUOUS.sub("", file.getvalue()))
    head, body = text[text.index("<svg") :].split(">", 1)
    head += f' role="img" aria-label={quoteattr(title)}>\n<title>{escape(title)}</title>\n'
    return head + _style(body) + body


def xml_text(text: str) -> str:
    """Text in which characters that XML forbids are replaced by question marks."""
    return _NOT_XML.sub("?", text)


def _style(body: str) -> str:
    """Style sheet of an SVG file: the font, and the colours on a dark page."""
    rules = [
        f'[style*="{what}: {light}"] {{ {what}: {dark} !important; }}'
        for light, dark in ON_DARK.items()
        for what in ("fill", "stroke")
        if f"{what}: {light}" in body
    ]
    dark = "\n".join(["@media (prefers-color-scheme: dark) {", *rules, "}"])
    return f"<style>\ntext {{ font-family: {_FONT} !important; }}\n{dark}\n</style>"


@_missing_glyphs_ignored()
@styled
def write_figure(figure: Figure, path: Path, title: str = "") -> Path:
    """Write a figure whole or not at all, as ``.svg`` or ``.png``; its folder is made if missing.

    Raises InputError if the file cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".svg":
        text = svg_text(figure, title)
        write_atomically({path: lambda part: part.write_text(text, "utf-8")})
    else:
        write_atomically({path: partial(figure.savefig, format="png")})
    return path
