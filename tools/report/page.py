"""``report.html``: a run, or two side by side, as one file that needs no network.

The page consists of sections; a section without content is left out. Pictures, the data and the
program of the view are in the file. It opens from disk, prints, and shows a still without WebGL.
"""

from __future__ import annotations

import base64
import shlex
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from palpate.launch import charts
from palpate.launch.cost_chart import draw_panels
from palpate.launch.files.file_access import write_atomically
from palpate.launch.printing import millimetres
from palpate.launch.run_directory import versions_text
from palpate.launch.summary_text import headline_facts
from palpate.tools.drawables import LAYERS, SCALARS
from palpate.tools.graph_drawing import draw_svg
from palpate.tools.report.run_facts import (
    Place,
    RunFacts,
    ratio_rows,
    read_run,
)
from palpate.tools.report.view_data import PLAIN, view_data
from palpate.tools.surfaces import css_ramp
from palpate.tools.view.picture import png_bytes, still

REPORT = "report.html"
HERE = Path(__file__).parent
HIDDEN_AT_FIRST = ("touched", "finger")  # layers that would hide the solid
TILES = {
    "rms error": "rms_m",
    "error bound": "rms_bound_95_m",
    "untouched gap": "largest_untouched_m",
}
COSTS = {"robot_time_s": "robot time", "compute_s": "compute time", "wall_s": "elapsed time"}
Html = Iterator[str]


@dataclass(frozen=True, slots=True, kw_only=True)
class PageLayout:
    """Sizes of pictures on the page, and limits of its lists."""

    still_width: int = 720  # [pixels]
    still_height: int = 520  # [pixels]
    bar_width: float = 90.0  # [pixels] of the longest bar of a table
    max_places: int = 24  # of one kind that have a button; the rest is counted


LAYOUT = PageLayout()


def write_report(runs: Sequence[Path], path: Path) -> None:
    """Write the report of a run, or of two side by side.

    `runs` are directories or recordings. Raises InputError if one has no summary or a damaged
    recording, or the file cannot be written; an existing file is then left as it was.
    """
    text = report_text([read_run(run) for run in runs])
    write_atomically({path: lambda part: part.write_text(text, "utf-8", "replace")})


def report_text(runs: Sequence[RunFacts]) -> str:
    """The page of one run or two."""
    title = " and ".join(f"{run.summary['scene'] or run.folder.name}" for run in runs)
    body = [f"<h1>palpate: {escape(title)}</h1>"]
    for heading, write in SECTIONS.items():
        columns = [list(write(run, number)) for number, run in enumerate(runs)]
        if write is _headline:  # figures of one run are tiles, those of two a table
            if len(runs) == 2:
                body += _section("Side by side", list(_compared(runs)))
            else:
                columns[0] = [*_tiles(runs[0].summary), *columns[0]]
        body += _section(heading, *columns)
    return html_page(f"palpate: {title}", body, kind="two" if len(runs) > 1 else "one", view=True)


def html_page(title: str, body: Sequence[str], *, kind: str = "one", view: bool = False) -> str:
    """A page in the common style; `view`: with the program of the view."""
    lines = [
        '<!DOCTYPE html>\n<html lang="en">\n<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        '<link rel="icon" href="data:,">',  # otherwise a browser requests an icon
        f"<title>{escape(title)}</title>\n<style>\n{_read('page.css')}</style>",
        f'<body class="{kind}">\n<main>',
        *body,
        "</main>",
    ]
    if view:
        lines.append(f"<script>\n{_read('viewer/viewer.min.js')}</script>")
    return "\n".join([*lines, "</body>\n</html>\n"])


@cache
def _read(name: str) -> str:
    return (HERE / name).read_text("utf-8")


def _section(heading: str, *columns: list[str]) -> list[str]:
    """A section with a column for each run; empty if all columns are."""
    if not any(columns):
        return []
    lines = [f"<section>\n<h2>{heading}</h2>", '<div class="columns">']
    for column in columns:
        lines += ["<div>", *(column or ['<p class="dim">nothing recorded</p>']), "</div>"]
    return [*lines, "</div>\n</section>"]


def _compared(runs: Sequence[RunFacts]) -> Html:
    """Figures of two runs, and their ratios."""
    heads = ["", *(f"{run.summary['scene']}, {run.folder.name}" for run in runs), "ratio"]
    rows = [[name, *cells] for name, cells in ratio_rows([run.summary for run in runs])]
    yield from table(heads, rows, right=range(1, 4))


def _headline(run: RunFacts, _: int) -> Html:
    """Reason of the end, doubts, and missed limits; figures are in tiles or in a table."""
    summary, facts = run.summary, headline_facts(run.summary)
    yield f"<p>{escape(summary['reason'])}</p>"
    yield '<dl class="facts">'
    # A tile already says whether its limit is kept.
    in_tiles = (*TILES, "no error bound")
    missed = [text for text in summary["missed"] if not text.startswith(in_tiles)]
    shown = {"found": facts["found"][:1], "doubt": facts["doubt"], "missed": missed}
    for title, parts in {**shown, "folder": [str(run.folder)]}.items():
        if parts:
            yield f"<dt>{title}</dt><dd>{escape('; '.join(parts))}</dd>"
    yield "</dl>"


def _tiles(summary: dict[str, Any]) -> Html:
    """Figures of a run as tiles."""
    yield '<div class="tiles">'
    for name, value, kind in _figures(summary):
        yield f'<div class="tile {kind}"><b>{escape(value)}</b><span>{escape(name)}</span></div>'
    yield "</div>"


def _figures(summary: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Name, value and kind of the main figures."""
    criteria = {criterion["name"]: criterion for criterion in summary["criteria"]}
    for name, key in TILES.items():
        text, kind = name, ""
        if name == "rms error" and summary[key] is not None:
            text += f"; sampling floor {millimetres(summary['sampling_floor_m'])}"
        if name in criteria:
            kind = "good" if criteria[name]["is_met"] else "bad"
            limit = "tolerance" if name == "error bound" else "limit"
            text += f"; {limit} {1e3 * criteria[name]['limit']:.3g} mm"
            text += " kept" if kind == "good" else " NOT kept"
        if summary[key] is not None:
            yield text, millimetres(summary[key]), kind
        elif name in criteria:
            yield text, "unknown", kind
    for key, name in (("contacts", "contacts of the hand"), ("contours", "contours")):
        if summary.get(key):
            yield name, str(summary[key]), ""
    yield "touches", str(summary["touches"]), ""
    for key, name in COSTS.items():
        if summary.get(key) is not None:
            yield name, f"{summary[key]:.1f} s", ""


def _view(run: RunFacts, number: int) -> Html:
    """The three-dimensional view, or a still of it."""
    if run.line is None or not (run.line.models or run.line.touches):
        return
    data = view_data(run.line, run.places)
    picture = base64.b64encode(
        png_bytes(still(run.line, LAYOUT.still_width, LAYOUT.still_height))
    ).decode()
    yield f'<div class="view3d" id="view{number}">\n<div class="stage">'
    yield f'<img class="still" alt="{_alt(run)}" src="data:image/png;base64,{picture}">'
    yield "</div>"
    yield from _scale(data.tops)
    yield '<div class="bar3d">'
    yield '<button data-control="play">Play</button>'
    yield (
        '<input type="range" min="0" max="1" step="0.001" value="1" data-control="time" '
        'aria-label="Time of the run">'
    )
    for name in data.layers:
        layer = LAYERS[name]
        checked = " checked" if layer.shown and name not in HIDDEN_AT_FIRST else ""
        yield (
            f'<label title="{layer.hint}"><input type="checkbox" data-control="{name}"{checked}> '
            f'<i class="swatch" style="background: {layer.colour}"></i> {layer.label}</label>'
        )
    yield '<label>colour <select data-control="colour">'
    yield from (f'<option value="{name}">{name}</option>' for name in (PLAIN, *data.tops))
    yield "</select></label>"
    yield '<button data-control="home">Reset view</button>'
    yield '<output class="fallback" data-control="readout" aria-live="polite"></output>\n</div>'
    yield f'<script type="application/json">{data.described}</script>'
    yield f'<script type="text/plain">{data.packed}</script>\n</div>'


def _alt(run: RunFacts) -> str:
    facts = ", ".join(headline_facts(run.summary)["found"])
    return escape(f"The rebuilt object with its contours: {facts}", quote=True)


def _scale(tops: dict[str, float]) -> Html:
    """The scale of each colouring."""
    ramp = css_ramp(of_surface=True)
    yield '<div class="scale">'
    for name, top in tops.items():
        yield (
            f'<div data-colouring="{name}"><div class="ramp" style="background: {ramp}">'
            f'</div><div class="ends"><span>0</span>'
            f"<span>{1e3 * top:g} and over</span></div><div>{SCALARS[name]}, mm</div></div>"
        )
    yield "</div>"


def _cost(run: RunFacts, _: int) -> Html:
    if not (run.summary["curve"] or run.summary["steps"]):
        return
    yield '<div class="charts">'
    for alt, figure in draw_panels(run.summary).items():
        yield _picture(charts.svg_text(figure, alt), alt)
    yield "</div>"


def _picture(svg: str, alt: str, kind: str = "") -> str:
    """A drawing as an image, so that its style sheet does not affect the page."""
    data = base64.b64encode(svg.encode("utf-8", "replace")).decode()
    return f'<img class="{kind}" alt="{alt}" src="data:image/svg+xml;base64,{data}">'


def _contours(run: RunFacts, number: int) -> Html:
    if run.line is None or not run.line.contours:
        return
    heads = ["contour", "height mm", "status", "touches", "points", "gaps", "rms mm", "p95 mm"]
    rows = []
    for contour in run.line.contours:
        deviations, errors = run.contour_deviations.get(contour.id, np.zeros(0)), ["", ""]
        if len(deviations):
            rms, p95 = np.sqrt(np.mean(deviations**2)), np.quantile(deviations, 0.95)
            errors = [f"{1e3 * rms:.3f}", f"{1e3 * p95:.3f}"]
        counts = [contour.touches, len(contour.points), len(contour.gap_starts)]
        facts = [f"{1e3 * contour.height:.1f}", contour.status, *map(str, counts)]
        rows.append([str(contour.id), *facts, *errors])
    yield from table(heads, rows, right=(0, 1, 3, 4, 5, 6, 7))
    yield '<p class="dim">In the order traced; rms and p95: of its points from the truth.</p>'


def _load(run: RunFacts, _: int) -> Html:
    nodes = run.summary["nodes"]
    if not nodes:
        return
    longest = max(node["cpu_s"] for node in nodes.values())
    rows = []
    for name, node in nodes.items():
        timing = [f"{1e-3 * node[key]:.2f}" for key in ("p50_us", "p99_us")]
        figures = [str(node["messages"]), *timing, f"{node['cpu_s']:.2f}"]
        rows.append([name, *figures, _bar(node["cpu_s"], longest)])
    heads = ["node", "messages", "p50 ms", "p99 ms", "CPU s", ""]
    yield from table(heads, rows, right=range(1, 5))


def _effects(run: RunFacts, _: int) -> Html:
    if run.effects is None:
        return
    if not run.effects:
        yield "<p>Exact contact; no effect was simulated.</p>"
        return
    longest = max(cost.seconds for cost in run.effects)
    rows = []
    for cost in run.effects:
        bar = _bar(cost.seconds, longest)
        rows.append([cost.name, f"{1e6 * cost.seconds:.0f}", bar, cost.parameters])
    yield from table(["stage", "µs a touch", "", "parameters"], rows, right=(1,))
    yield '<p class="dim">Median processor time, measured when this page was written.</p>'


def _bar(value: float, longest: float) -> Markup:
    """A bar for a value, in a table whose longest bar stands for `longest`."""
    width = LAYOUT.bar_width * value / (longest or 1.0)
    return Markup(f'<span class="bar" style="width: {width:.0f}px"></span>')


def _diagnostics(run: RunFacts, number: int) -> Html:
    """Places with faults, with buttons that show them, and the figures of the fit."""
    kinds: dict[str, list[tuple[int, Place]]] = {}
    for i, place in enumerate(run.places):
        kinds.setdefault(place.kind, []).append((i, place))
    for kind, some in kinds.items():
        yield f"<h3>{escape(kind)}: {len(some)}</h3>\n<p>"
        for i, place in some[: LAYOUT.max_places]:
            yield (
                f'<button class="place" data-view="view{number}" data-place="{i}">'
                f"{escape(place.text)}</button>"
            )
        rest = len(some) - LAYOUT.max_places
        yield "</p>" if rest <= 0 else f'<span class="dim">and {rest} more</span></p>'
    if not kinds and run.line is not None:
        yield "<p>No gap, no fallback, and no opening.</p>"
    for record in run.log:
        level, node, text = (escape(record[key]) for key in ("level", "node", "text"))
        yield f"<p>{level}, {node}: {text}</p>"
    if run.summary["numerics"]:
        rows = [[name, f"{value:.3g}"] for name, value in run.summary["numerics"].items()]
        yield "<details><summary>Figures of the last fit</summary>"
        yield from table(["figure", "value"], rows, right=(1,))
        yield "</details>"


def _graph(run: RunFacts, _: int) -> Html:
    if run.graph is None:
        return
    yield _picture(
        draw_svg(run.graph, "Nodes and topics of the run"),
        "Nodes of the run, and the topics between them",
        "wide",
    )
    yield '<div class="narrow"><dl class="facts">'
    names = [box.name for box in run.graph.boxes]
    for wire in run.graph.wires:
        targets = ", ".join(names[target] for target in wire.targets)
        yield f"<dt>{escape(names[wire.source])}</dt>"
        yield f"<dd>{escape(', '.join(wire.labels))} to {escape(targets or 'no node')}</dd>"
    yield "</dl></div>"


def _reproduce(run: RunFacts, _: int) -> Html:
    path = shlex.quote(str(run.folder / "launch.yaml"))
    yield f"<pre>palpate launch {escape(path)}</pre>"
    facts = {key: run.summary[key] for key in ("palpate", "seed", "mesh_sha256")}
    yield '<dl class="facts">'
    yield from (
        f"<dt>{key}</dt><dd>{escape(str(value))}</dd>" for key, value in facts.items() if value
    )
    yield f"<dt>versions</dt><dd>{escape(versions_text())}</dd></dl>"
    for name, text in run.files.items():
        yield f"<details><summary>{name}</summary><pre>{escape(text)}</pre></details>"


class Markup(str):
    """Text of a cell that is HTML already."""


def table(
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    right: Sequence[int],
    marks: Sequence[str] = (),
) -> Html:
    """A table with right-aligned columns `right`; `marks` are attributes of its rows."""
    kinds = ['class="n"' if i in right else "" for i in range(len(heads))]
    yield '<div class="table"><table>\n<tr>'
    yield "".join(
        f"<th {kind}>{escape(head)}</th>" for head, kind in zip(heads, kinds, strict=True)
    )
    yield "</tr>"
    for row, mark in zip_longest(rows, marks, fillvalue=""):
        texts = (cell if isinstance(cell, Markup) else escape(cell) for cell in row)
        cells = "".join(f"<td {kind}>{text}</td>" for text, kind in zip(texts, kinds, strict=True))
        yield f"<tr{mark}>{cells}</tr>"
    yield "</table></div>"


SECTIONS: dict[str, Callable[[RunFacts, int], Html]] = {
    "The object": _view,
    "What was found": _headline,
    "What accuracy cost": _cost,
    "Contours": _contours,
    "Load and latency": _load,
    "Effects": _effects,
    "Diagnostics of the fit": _diagnostics,
    "Graph": _graph,
    "How to run it again": _reproduce,
}
