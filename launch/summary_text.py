"""Text of a finished run: the result in a few lines, and on request all figures.

The result has about 12 lines of 80 columns: the solid, which limits are met, the cost, doubts and
which file to open. Timings and diagnostics are in the details.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from palpate.launch.exchange_rate import draw_text, halving_lines
from palpate.launch.printing import (
    TEXT_WIDTH,
    TITLE_WIDTH,
    counted,
    millimetres,
    text_table,
    titled,
)

STATUS_TITLES = {"finished": "done", "died": "died", "stalled": "stalled", "interrupted": "stopped"}
# Files to look at, the most telling first.
MAIN_FILES = ("report.html", "mesh.glb", "result.json", "topics.mcap", "log.jsonl")


def headline_text(summary: Mapping[str, Any], files: Sequence[str], folder: Path) -> str:
    """The solid, the limits that are met and missed, the cost, doubts and the file to open.

    `files` are the names of the files in the run's `folder`. About 12 lines of 80 columns, in which
    nothing is cut off.
    """
    lines = []
    for title, parts in headline_facts(summary).items():
        if parts:
            lines += titled(title, *parts)
        if title == "found":
            lines += _procedure(summary)
    main_file = next((name for name in MAIN_FILES if name in files), "summary.json")
    lines += titled(STATUS_TITLES[summary["status"]], summary["reason"])
    lines += titled("open", str(folder / main_file), "(all figures in summary.json)")
    return "\n".join(lines)


def headline_facts(summary: Mapping[str, Any]) -> dict[str, list[str]]:
    """The solid, the limits that are met, those that are missed, the cost and doubts."""
    return {
        "found": _found(summary),
        "reached": criteria_texts(summary, met=True),
        "missed": list(summary["missed"]),
        "cost": _time(summary),
        "doubt": _doubts(summary),
    }


def run_lines(summary: Mapping[str, Any]) -> list[str]:
    """The solid, the limits that are met and missed, and the cost, a line of 80 columns each."""
    facts, lines = headline_facts(summary), []
    for title in ("found", "reached", "missed", "cost"):
        if title == "missed" and not facts[title]:
            continue
        line, parts = f"  {title:<7}", facts[title] or ["none"]
        for number, part in enumerate(parts):
            longer = f"{line}, {part}" if number else f"{line} {part}"
            line = longer if len(longer) < TEXT_WIDTH else line
        lines.append(line)
    return lines


def criteria_texts(summary: Mapping[str, Any], *, met: bool) -> list[str]:
    """The limits that are met, or those that are missed, each with its figure.

    Of the limits that are met, only those of lengths and shares are listed.
    """
    judged = [criterion for criterion in summary["criteria"] if criterion["is_met"] == met]
    return [
        _criterion_text(criterion)
        for criterion in judged
        if not met or (criterion["limit"] and criterion["unit"] != "#")
    ]


def _criterion_text(criterion: Mapping[str, Any]) -> str:
    name, value = criterion["name"], criterion["value"]
    limit, unit = criterion["limit"], criterion["unit"]
    if value is None:
        return f"no {name} can be stated (limit {_quantity(limit, unit)})"
    if criterion["is_exact"]:
        return f"{name} {value:.0f} (the object's is {limit:.0f})"
    if unit == "#":
        return counted(int(value), name.removesuffix("s"))
    if name == "unentered hole":
        return f"perhaps a hole, {_quantity(value, 'm')} wide: no finger entered it"
    if not limit:
        return f"{name} {_quantity(value, unit)} (none is allowed)"
    return f"{name} {_quantity(value, unit)} (limit {_quantity(limit, unit, 3)})"


def _quantity(value: float, unit: str, digits: int | None = None) -> str:
    """A length or a share with its unit, to a micrometre or 0.1 %, or to `digits` digits."""
    if unit == "m":
        return millimetres(value) if digits is None else f"{1e3 * value:.{digits}g} mm"
    if 0.0 < value < 5e-4:
        return "under 0.1 %"
    return f"{100.0 * value:.1f} %" if digits is None else f"{100.0 * value:.{digits}g} %"


def _found(summary: Mapping[str, Any]) -> list[str]:
    """The kind of the solid, and its error."""
    if summary["mesh_sha256"] is None:
        is_procedure_done = summary["procedure"] is not None and not summary["missed"]
        return [] if is_procedure_done else ["no solid"]
    kind = _surface_kind(summary)
    plural, singular = ("contours", "contour") if summary["contours"] else ("touches", "touch")
    if summary["chamfer_m"] is None:
        return [f"{kind} from {counted(summary[plural], singular, plural)}"]
    return [
        f"{kind}, {1e3 * summary['size_m']:.0f} mm high",
        f"rms error {millimetres(summary['rms_m'])}",
        f"sampling floor {millimetres(summary['sampling_floor_m'])}",
    ]


def _surface_kind(summary: Mapping[str, Any]) -> str:
    """The kind of surface that the mesh is, as far as it was checked."""
    if summary["watertight"] is None:
        return "a surface that was not checked"
    if not summary["watertight"]:
        return "a surface that is NOT closed"
    if summary["self_crossings"]:
        return "a surface that crosses itself"
    genus = summary["genus"]
    return "a closed solid" + (f" with {counted(genus, 'hole')} through it" if genus else "")


def _doubts(summary: Mapping[str, Any]) -> list[str]:
    """Reasons to doubt the solid, besides the limits that are missed."""
    doubts = unknown_texts(summary)
    bound, error = summary["rms_bound_95_m"], summary["exposed_rms_m"]
    if bound is not None and error is not None and error > bound:
        doubts.append("the rms error is larger than the stated bound")
    doubts += [f"rejected: {reason}" for reason in summary["rejected"]]
    if summary["contours_failed"]:
        doubts.append(f"{counted(summary['contours_failed'], 'slice')} could not be traced")
    if summary["restarts"]:
        doubts.append(f"restarted: {', '.join(sorted(summary['restarts']))}")
    if summary["gaps"] or summary["duplicates"]:
        doubts.append(f"messages lost: {summary['gaps']}, received twice: {summary['duplicates']}")
    return doubts


def details_text(summary: Mapping[str, Any], files: Sequence[str]) -> str:
    """All figures and the names of the files, as lines of at most 80 columns."""
    lines = [*_result(summary), *_procedure(summary), *_cost(summary), *computing_lines(summary)]
    return "\n".join([*lines, *titled("outputs", *files)])


def computing_lines(summary: Mapping[str, Any]) -> list[str]:
    """Processor time by node and by step, and the diagnostics of the last fit."""
    lines = [*_node_table(summary["nodes"]), *_steps(summary["steps"])]
    if summary["numerics"]:
        figures = (f"{name} {value:.3g}" for name, value in summary["numerics"].items())
        lines += titled("numerics", *figures)
    return lines


def _result(summary: Mapping[str, Any]) -> list[str]:
    if summary["chamfer_m"] is None:
        return titled("result", "no model was measured")
    share = 100.0 * summary["chamfer_m"] / summary["size_m"]
    distances = [
        f"chamfer {millimetres(summary['chamfer_m'])} ({share:.2f} % of the height)",
        f"p95 {millimetres(summary['p95_m'])}",
        f"worst {millimetres(summary['hausdorff_m'])}",
    ]
    properties = [
        f"sampling floor {millimetres(summary['sampling_floor_m'])}",
        f"normals {summary['normal_deg']:.1f} deg",
        f"volume {100.0 * summary['volume_error']:+.2f} %",
        f"watertight {'yes' if summary['watertight'] else 'NO'}",
    ]
    return [*titled("result", *distances), *titled("", *properties)]


def _procedure(summary: Mapping[str, Any]) -> list[str]:
    """The result of an exploratory procedure, its figures in mm, degrees and counts."""
    result = summary.get("procedure")
    if result is None:
        return []
    figures = [
        _figure_text(name, value)
        for name, value in result.items()
        if name not in ("name", "status", "reason")
    ]
    return titled(result["name"], f"{result['status']}: {result['reason']}", *figures, width=12)


def _figure_text(name: str, value: float) -> str:
    """A figure with the unit at the end of its name, as `m`, `m3` or `deg`."""
    stem, _, unit = name.rpartition("_")
    texts = {"m": millimetres(value), "m3": f"{1e6 * value:.1f} cm3", "deg": f"{value:.3f} deg"}
    if unit not in texts:
        stem, texts[unit] = name, f"{value:.4g}"
    return f"{stem.replace('_', ' ')} {texts[unit]}"


def unknown_texts(summary: Mapping[str, Any]) -> list[str]:
    """What is unknown of the surface: untouched parts, turned placements and the underside."""
    texts = []
    if summary.get("open_share"):
        place = ", ".join(f"{1e3 * x:.0f}" for x in summary["open_places_m"][0])
        touches = math.ceil(summary["open_touches"])
        texts.append(
            f"{_quantity(summary['open_share'], '1')} of the surface is unknown and may have "
            f"holes, the widest part {millimetres(summary['open_width_m'])} wide at ({place}) mm: "
            f"about {counted(touches, 'touch', 'touches')} if a finger reaches it"
        )
    texts += [f"since it was turned over {fault}" for fault in summary.get("placement_faults", ())]
    if summary.get("under_share"):
        share = _quantity(summary["under_share"], "1")
        texts.append(
            f"{share} of the surface is the underside: it may be hollow, and is not bounded"
        )
    return texts


def _cost(summary: Mapping[str, Any]) -> list[str]:
    chart = draw_text(summary)
    halvings = [] if summary.get("procedure") else halving_lines(summary["curve"])
    heads = ["curve", *[""] * len(chart)]
    lines = [f"{head:<{TITLE_WIDTH}}{line}" for head, line in zip(heads, chart, strict=False)]
    return lines + [piece for line in halvings for piece in titled("", line)]


def _time(summary: Mapping[str, Any]) -> list[str]:
    counts = (
        ("contacts", "contact"),
        ("turns", "turn"),
        ("contours", "contour"),
        ("touches", "touch"),
    )
    parts = [
        counted(summary[key], singular, key)
        for key, singular in counts
        if summary.get(key) or key == "touches"
    ]
    parts += [f"robot {summary['robot_time_s']:.1f} s", f"wall {summary['wall_s']:.1f} s"]
    if summary["compute_s"] is not None:
        parts.append(f"compute {summary['compute_s']:.1f} s")
    if summary["touches_per_s"]:
        parts.append(f"{summary['touches_per_s']:.0f} touches/s")
    return parts


def _node_table(nodes: Mapping[str, Mapping[str, Any]]) -> list[str]:
    if not nodes:
        return []
    rows = [("nodes", "node", "messages", "p50 us", "p99 us", "CPU s")]
    for name, node in nodes.items():
        timing = f"{node['p50_us']:.0f}", f"{node['p99_us']:.0f}", f"{node['cpu_s']:.2f}"
        rows.append(("", name, str(node["messages"]), *timing))
    return text_table(rows, right=range(2, 6), min_widths=(TITLE_WIDTH - 2,))


def _steps(steps: Mapping[str, float], min_share: float = 0.5) -> list[str]:
    """Shares of the processor time of steps that took at least `min_share` [%]."""
    total = sum(steps.values())
    if not total > 0.0:
        return []
    shares = {name: 100.0 * seconds / total for name, seconds in steps.items()}
    texts = [f"{name} {share:.0f} %" for name, share in shares.items() if share >= min_share]
    return titled("steps", *texts, f"of {total:.1f} s")
