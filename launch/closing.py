"""The last words of a run: its figures on a screen of 80 columns."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

WIDTH = 80
INDENT = " " * 9
ENDED = {"finished": "done", "died": "died", "stalled": "stalled", "interrupted": "stopped"}


def closing_text(summary: Mapping[str, Any], files: Sequence[str], folder: Path) -> str:
    """The figures as lines of at most 80 columns.

    Parameters
    ----------
    summary : map
        The run's figures.
    files : texts
        Names of what the run left behind.
    folder : Path
        Where it lies.
    """
    lines = [*_result(summary), *_time(summary), *_nodes(summary["nodes"])]
    lines += _row("numerics", [f"{k} {v:.3g}" for k, v in summary["numerics"].items()])
    lines += _row("outputs", list(files))
    lines += _row(ENDED[summary["status"]], [summary["reason"]])
    return "\n".join((*lines, f"{'run':<9}{folder}"))


def _result(summary: Mapping[str, Any]) -> list[str]:
    if summary["chamfer_m"] is None:
        return _row("result", ["no model was measured"])
    share = 100.0 * summary["chamfer_m"] / summary["size_m"]
    near = [
        f"chamfer {_mm(summary['chamfer_m'])} ({share:.2f} % of the height)",
        f"p95 {_mm(summary['p95_m'])}",
        f"worst {_mm(summary['hausdorff_m'])}",
    ]
    rest = [
        f"sampling floor {_mm(summary['sampling_floor_m'])}",
        f"normals {summary['normal_deg']:.1f} deg",
        f"volume {100.0 * summary['volume_error']:+.2f} %",
        f"watertight {'yes' if summary['watertight'] else 'NO'}",
    ]
    return [*_row("result", near), *_row("", rest), *_promise(summary)]


def _promise(summary: Mapping[str, Any]) -> list[str]:
    """What the run says of its own error, beside the truth."""
    if summary["bound_m"] is None:
        return []
    parts = [f"rms below {_mm(summary['bound_m'])} (95 %), in truth {_mm(summary['rms_m'])}"]
    if summary["unfelt_m"] is not None:
        parts.append(f"unfelt at most {_mm(summary['unfelt_m'])}")
    return _row("promise", parts)


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
    return _row("time", parts)


def _nodes(nodes: Mapping[str, Mapping[str, Any]]) -> list[str]:
    if not nodes:
        return []
    lines = [f"{'nodes':<9}{'node':<20}{'messages':>9}{'p50 us':>9}{'p99 us':>9}{'CPU s':>8}"]
    for name, figures in nodes.items():
        lines.append(
            f"{INDENT}{name:<20}{figures['messages']:>9}{figures['p50_us']:>9.0f}"
            f"{figures['p99_us']:>9.0f}{figures['cpu_s']:>8.2f}"
        )
    return lines


def _row(title: str, parts: Sequence[str]) -> list[str]:
    """Parts behind a title, broken between parts where they can be."""
    lines = [""]
    for part in parts:
        joined = f"{lines[-1]}  {part}" if lines[-1] else part
        if len(joined) <= WIDTH - len(INDENT) or not lines[-1]:
            lines[-1] = joined
        else:
            lines.append(part)
    broken = [piece for line in lines for piece in textwrap.wrap(line, WIDTH - len(INDENT))]
    heads = [f"{title:<9}", *[INDENT] * len(broken)]
    return [head + piece for head, piece in zip(heads, broken, strict=False)]


def _mm(metres: float) -> str:
    return f"{1000.0 * metres:.3f} mm"
