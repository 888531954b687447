"""What is printed: aligned tables, titled blocks of 80 columns, figures with units, and a run.

All of it is plain text, on a terminal as in a pipe. Rich is imported when a table is made.
"""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from palpate.launch.exchange_rate import draw_text, halving_lines

TEXT_WIDTH = 80  # Columns of what is printed; tables may be wider, so that no cell is broken
TITLE_WIDTH = 11  # Columns before the parts of a block
LEAST_SHARE = 0.5  # Of the processor time, %: a step that took less is not printed
GAP = "  "  # Between two columns, and between two parts of a block
ENDED = {"finished": "done", "died": "died", "stalled": "stalled", "interrupted": "stopped"}


def text_table(
    rows: Sequence[Sequence[str]], right: Collection[int] = (), least: Sequence[int] = ()
) -> list[str]:
    """Rows of cells, the heads first, as lines in which columns are aligned.

    Columns whose numbers are in `right` stand to the right, as numbers do; `least` is the least
    width of each. What a row lacks at its end is empty.
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    grid = Table.grid(padding=(0, len(GAP), 0, 0))
    for column, width in enumerate([*least, *[0] * (max(map(len, rows)) - len(least))]):
        side: Literal["left", "right"] = "right" if column in right else "left"
        grid.add_column(justify=side, min_width=width, no_wrap=True)
    for row in rows:
        grid.add_row(*(Text(cell.replace("\t", " ")) for cell in row))
    console = Console(width=1_000_000, no_color=True, force_terminal=False)
    with console.capture() as printed:
        console.print(grid)
    return [line.rstrip() for line in printed.get().splitlines()]


def titled(title: str, *parts: str, width: int = TITLE_WIDTH) -> list[str]:
    """Parts behind a title, in lines of 80 columns that break between parts where they can.

    A part longer than a line is broken between its words; `width` columns stand before them.
    """
    lines = [""]
    for part in parts:
        joined = f"{lines[-1]}{GAP}{part}" if lines[-1] else part
        if len(joined) <= TEXT_WIDTH - width or not lines[-1]:
            lines[-1] = joined
        else:
            lines.append(part)
    broken = [
        piece
        for line in lines
        for piece in textwrap.wrap(
            line, TEXT_WIDTH - width, break_long_words=False, break_on_hyphens=False
        )
    ]
    heads = [title, *[""] * len(broken)]
    return [f"{head:<{width}}{piece}" for head, piece in zip(heads, broken or [""], strict=False)]


def counted(count: int, one: str, more: str = "") -> str:
    """A number of things: ``1 touch``, ``3 touches``."""
    return f"{count} {one if count == 1 else more or f'{one}s'}"


def millimetres(metres: float) -> str:
    """A length to a micrometre, in mm."""
    return f"{1000.0 * metres:.3f} mm"


def size_text(size: int) -> str:
    """A number of bytes in the unit that suits it."""
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= factor:
            return f"{size / factor:.1f} {unit}"
    return f"{size} B"


def summary_text(summary: Mapping[str, Any], files: Sequence[str], folder: Path) -> str:
    """The figures as lines of at most 80 columns, with the names of what the run left behind."""
    lines = [*_result(summary), *_procedure(summary), *_promise(summary)]
    lines += [*_cost(summary), *_time(summary), *_node_table(summary["nodes"])]
    lines += _steps(summary["steps"])
    if summary["numerics"]:
        figures = (f"{name} {value:.3g}" for name, value in summary["numerics"].items())
        lines += titled("numerics", *figures)
    lines += titled("outputs", *files)
    lines += titled("missed", *summary["missed"]) if summary["missed"] else []
    lines += titled(ENDED[summary["status"]], summary["reason"])
    return "\n".join((*lines, *titled("run", str(folder))))


def _result(summary: Mapping[str, Any]) -> list[str]:
    if summary["chamfer_m"] is None:
        return titled("result", "no model was measured")
    share = 100.0 * summary["chamfer_m"] / summary["size_m"]
    near = [
        f"chamfer {millimetres(summary['chamfer_m'])} ({share:.2f} % of the height)",
        f"p95 {millimetres(summary['p95_m'])}",
        f"worst {millimetres(summary['hausdorff_m'])}",
    ]
    rest = [
        f"sampling floor {millimetres(summary['sampling_floor_m'])}",
        f"normals {summary['normal_deg']:.1f} deg",
        f"volume {100.0 * summary['volume_error']:+.2f} %",
        f"watertight {'yes' if summary['watertight'] else 'NO'}",
    ]
    return [*titled("result", *near), *titled("", *rest)]


def _procedure(summary: Mapping[str, Any]) -> list[str]:
    """What an exploratory procedure found, its figures in mm, degrees and counts."""
    found = summary.get("procedure")
    if found is None:
        return []
    figures = [
        _figure_text(name, value)
        for name, value in found.items()
        if name not in ("name", "status", "reason")
    ]
    return titled(found["name"], f"{found['status']}: {found['reason']}", *figures, width=12)


def _figure_text(name: str, value: float) -> str:
    """A figure whose unit ends its name."""
    stem, _, unit = name.rpartition("_")
    if unit == "m":
        return f"{stem.replace('_', ' ')} {millimetres(value)}"
    if unit == "m3":
        return f"{stem.replace('_', ' ')} {1e6 * value:.1f} cm3"
    if unit == "deg":
        return f"{stem.replace('_', ' ')} {value:.3f} deg"
    return f"{name.replace('_', ' ')} {value:.4g}"


def _promise(summary: Mapping[str, Any]) -> list[str]:
    if summary["rms_bound_95_m"] is None and summary["largest_untouched_m"] is None:
        return []
    stated, *untouched = known_texts(summary)
    if summary["rms_m"] is not None:
        stated += f", in truth {millimetres(summary['rms_m'])}"
    unknown = unknown_texts(summary)
    lines = titled("promise", stated, *untouched)
    return [*lines, *titled("unknown", *unknown)] if unknown else lines


def unknown_texts(summary: Mapping[str, Any]) -> list[str]:
    """What nobody touched, where, and what the object stands on, in words; nothing if unknown."""
    told = []
    if summary.get("open_share"):
        place = ", ".join(f"{1e3 * one:.0f}" for one in summary["open_place_m"])
        told.append(
            f"{100.0 * summary['open_share']:.1f} % of the surface lies over 5 mm from any touch, "
            f"the widest opening {millimetres(summary['open_width_m'])} at ({place}) mm"
        )
    if summary.get("under_share"):
        told.append(
            f"{100.0 * summary['under_share']:.1f} % stands on the platform and is taken for flat"
        )
    return told


def known_texts(summary: Mapping[str, Any]) -> list[str]:
    """How good the solid is and what is left unknown, as far as it was told, in words."""
    bound, untouched = summary["rms_bound_95_m"], summary["largest_untouched_m"]
    known = ["no error can be stated"]
    if bound is not None:
        known = [f"rms below {millimetres(bound)} (95 %)"]
    if untouched is not None:
        known.append(f"untouched at most {millimetres(untouched)}")
    return known


def _cost(summary: Mapping[str, Any]) -> list[str]:
    drawn = draw_text(summary)
    foretold = [] if summary.get("procedure") else halving_lines(summary["curve"])
    heads = ["cost", *[""] * len(drawn)]
    lines = [f"{head:<{TITLE_WIDTH}}{line}" for head, line in zip(heads, drawn, strict=False)]
    return lines + [piece for line in foretold for piece in titled("", line)]


def _time(summary: Mapping[str, Any]) -> list[str]:
    parts = [
        f"{summary['contacts']} contacts",
        f"{summary['contours']} contours",
        f"{summary['touches']} touches",
        f"robot {summary['robot_time_s']:.1f} s",
        f"wall {summary['wall_s']:.1f} s",
    ]
    if summary["compute_s"] is not None:
        parts.append(f"compute {summary['compute_s']:.1f} s")
    if summary["touches_per_s"]:
        parts.append(f"{summary['touches_per_s']:.0f} touches/s")
    return titled("time", *parts)


def _node_table(nodes: Mapping[str, Mapping[str, Any]]) -> list[str]:
    if not nodes:
        return []
    rows = [("nodes", "node", "messages", "p50 us", "p99 us", "CPU s")]
    for name, one in nodes.items():
        timing = f"{one['p50_us']:.0f}", f"{one['p99_us']:.0f}", f"{one['cpu_s']:.2f}"
        rows.append(("", name, str(one["messages"]), *timing))
    return text_table(rows, right=range(2, 6), least=(TITLE_WIDTH - 2,))


def _steps(steps: Mapping[str, float]) -> list[str]:
    total = sum(steps.values())
    if not total > 0.0:
        return []
    shares = {name: 100.0 * seconds / total for name, seconds in steps.items()}
    told = [f"{name} {share:.0f} %" for name, share in shares.items() if share >= LEAST_SHARE]
    return titled("steps", *told, f"of {total:.1f} s")
