"""What a run says when it is over: the result in a few lines, and on request all figures.

The result stays in sight: what was found, which limits are kept, what it cost, what to doubt and
which file to open, in about 12 lines of 80 columns. Timings and diagnostics are for those who ask.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from palpate.launch.exchange_rate import draw_text, halving_lines
from palpate.launch.printing import TITLE_WIDTH, counted, millimetres, text_table, titled

WIDTH = 80  # Columns
LEAST_SHARE = 0.5  # Of the processor time, %: a step that took less is not printed
ENDED = {"finished": "done", "died": "died", "stalled": "stalled", "interrupted": "stopped"}
OPENED = (
    "report.html",
    "mesh.glb",
    "result.json",
    "topics.mcap",
    "log.jsonl",
)  # What to look at first
FULL = "all figures in summary.json"


def headline_text(summary: Mapping[str, Any], files: Sequence[str], folder: Path) -> str:
    """What was found and reached, what it cost, what to doubt and what to open: 80 columns.

    `files` are the names of what the run left in its `folder`. About 12 lines; nothing is cut off.
    """
    lines = []
    for title, parts in headline_facts(summary).items():
        if parts:
            lines += titled(title, *parts)
        if title == "found":
            lines += _procedure(summary)
    opened = next((one for one in OPENED if one in files), "summary.json")
    lines += titled(ENDED[summary["status"]], summary["reason"])
    lines += titled("open", str(folder / opened), f"({FULL})")
    return "\n".join(lines)


def headline_facts(summary: Mapping[str, Any]) -> dict[str, list[str]]:
    """What was found, which limits are kept and which are not, the cost and what to doubt."""
    return {
        "found": _found(summary),
        "reached": criteria_texts(summary, met=True),
        "missed": list(summary["missed"]),
        "cost": _time(summary),
        "doubt": _doubts(summary),
    }


def run_lines(summary: Mapping[str, Any]) -> list[str]:
    """What was found, how far it is to be trusted and what it cost, a line of 80 columns each."""
    facts, found = headline_facts(summary), []
    for title in ("found", "reached", "missed", "cost"):
        if title == "missed" and not facts[title]:
            continue
        told, parts = f"  {title:<7}", facts[title] or ["none"]
        for number, part in enumerate(parts):
            more = f"{told}, {part}" if number else f"{told} {part}"
            told = more if len(more) < WIDTH else told
        found.append(told)
    return found


def criteria_texts(summary: Mapping[str, Any], *, met: bool) -> list[str]:
    """The limits that are kept, or that are not, each with its figure.

    Of those that are kept, what the mesh must be like goes without saying.
    """
    judged = [one for one in summary["criteria"] if one["is_met"] == met]
    told = [one for one in judged if not met or (one["limit"] and one["unit"] != "#")]
    return [_criterion_text(one) for one in told]


def _criterion_text(one: Mapping[str, Any]) -> str:
    name, value, limit = one["name"], one["value"], one["limit"]
    if value is None:
        return f"no {name} can be stated (limit {_quantity(limit, one['unit'])})"
    if one["is_exact"]:
        return f"{name} {value:.0f} (the object's is {limit:.0f})"
    if one["unit"] == "#":
        return counted(int(value), name.removesuffix("s"))
    if name == "unentered hole":
        return f"perhaps a hole, {_quantity(value, 'm')} wide: no finger entered it"
    if not limit:
        return f"{name} {_quantity(value, one['unit'])} (none is allowed)"
    return f"{name} {_quantity(value, one['unit'])} (limit {_quantity(limit, one['unit'], 3)})"


def _quantity(value: float, unit: str, digits: int | None = None) -> str:
    """A length or a share with its unit; to a micrometre or a tenth, or to so many digits."""
    if unit == "m":
        return millimetres(value) if digits is None else f"{1e3 * value:.{digits}g} mm"
    if 0.0 < value < 5e-4:
        return "under 0.1 %"
    return f"{100.0 * value:.1f} %" if digits is None else f"{100.0 * value:.{digits}g} %"


def _found(summary: Mapping[str, Any]) -> list[str]:
    """The solid, and how far it is from the truth."""
    if summary["mesh_sha256"] is None:
        told = summary["procedure"] is not None and not summary["missed"]
        return [] if told else ["no solid"]
    kind = _surface_kind(summary)
    made_of = ("contours", "contour") if summary["contours"] else ("touches", "touch")
    if summary["chamfer_m"] is None:
        return [f"{kind} from {counted(summary[made_of[0]], made_of[1], made_of[0])}"]
    return [
        f"{kind}, {1e3 * summary['size_m']:.0f} mm high",
        f"rms error {millimetres(summary['rms_m'])}",
        f"sampling floor {millimetres(summary['sampling_floor_m'])}",
    ]


def _surface_kind(summary: Mapping[str, Any]) -> str:
    """What kind of surface the mesh is, as far as somebody looked."""
    if summary["watertight"] is None:
        return "a surface that was not checked"
    if not summary["watertight"]:
        return "a surface that is NOT closed"
    if summary["self_crossings"]:
        return "a surface that crosses itself"
    genus = summary["genus"]
    return "a closed solid" + (f" with {counted(genus, 'hole')} through it" if genus else "")


def _doubts(summary: Mapping[str, Any]) -> list[str]:
    """Why not to believe the solid everywhere, beside the limits that are not kept."""
    found = unknown_texts(summary)
    bound, error = summary["rms_bound_95_m"], summary["exposed_rms_m"]
    if bound is not None and error is not None and error > bound:
        found.append("the rms error is larger than the stated bound")
    found += [f"rejected: {one}" for one in summary["rejected"]]
    if summary["contours_failed"]:
        found.append(f"{counted(summary['contours_failed'], 'slice')} could not be traced")
    if summary["restarts"]:
        found.append(f"restarted: {', '.join(sorted(summary['restarts']))}")
    if summary["gaps"] or summary["duplicates"]:
        found.append(f"messages lost: {summary['gaps']}, received twice: {summary['duplicates']}")
    return found


def details_text(summary: Mapping[str, Any], files: Sequence[str]) -> str:
    """All figures, with what the run left behind, as lines of at most 80 columns."""
    lines = [*_result(summary), *_procedure(summary), *_cost(summary), *computing_lines(summary)]
    return "\n".join([*lines, *titled("outputs", *files)])


def computing_lines(summary: Mapping[str, Any]) -> list[str]:
    """Where computing time went, by node and by step, and the diagnostics of the last fit."""
    lines = [*_node_table(summary["nodes"]), *_steps(summary["steps"])]
    if summary["numerics"]:
        figures = (f"{name} {value:.3g}" for name, value in summary["numerics"].items())
        lines += titled("numerics", *figures)
    return lines


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
    texts = {"m": millimetres(value), "m3": f"{1e6 * value:.1f} cm3", "deg": f"{value:.3f} deg"}
    if unit not in texts:
        stem, texts[unit] = name, f"{value:.4g}"
    return f"{stem.replace('_', ' ')} {texts[unit]}"


def unknown_texts(summary: Mapping[str, Any]) -> list[str]:
    """Where nothing was touched, and what the object stands on, in words; nothing if unknown."""
    told = []
    if summary.get("open_share"):
        place = ", ".join(f"{1e3 * one:.0f}" for one in summary["open_places_m"][0])
        touches = math.ceil(summary["open_touches"])
        told.append(
            f"{_quantity(summary['open_share'], '1')} of the surface is unknown and may have "
            f"holes, the widest part {millimetres(summary['open_width_m'])} wide at ({place}) mm: "
            f"about {counted(touches, 'touch', 'touches')} if a finger reaches it"
        )
    told += [f"since it was turned over {one}" for one in summary.get("placement_faults", ())]
    if summary.get("under_share"):
        share = _quantity(summary["under_share"], "1")
        told.append(
            f"{share} of the surface is the underside: it may be hollow, and is not bounded"
        )
    return told


def _cost(summary: Mapping[str, Any]) -> list[str]:
    drawn = draw_text(summary)
    foretold = [] if summary.get("procedure") else halving_lines(summary["curve"])
    heads = ["curve", *[""] * len(drawn)]
    lines = [f"{head:<{TITLE_WIDTH}}{line}" for head, line in zip(heads, drawn, strict=False)]
    return lines + [piece for line in foretold for piece in titled("", line)]


def _time(summary: Mapping[str, Any]) -> list[str]:
    counts = (
        ("contacts", "contact"),
        ("turns", "turn"),
        ("contours", "contour"),
        ("touches", "touch"),
    )
    parts = [
        counted(summary[key], one, key)
        for key, one in counts
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
    for name, one in nodes.items():
        timing = f"{one['p50_us']:.0f}", f"{one['p99_us']:.0f}", f"{one['cpu_s']:.2f}"
        rows.append(("", name, str(one["messages"]), *timing))
    return text_table(rows, right=range(2, 6), min_widths=(TITLE_WIDTH - 2,))


def _steps(steps: Mapping[str, float]) -> list[str]:
    total = sum(steps.values())
    if not total > 0.0:
        return []
    shares = {name: 100.0 * seconds / total for name, seconds in steps.items()}
    told = [f"{name} {share:.0f} %" for name, share in shares.items() if share >= LEAST_SHARE]
    return titled("steps", *told, f"of {total:.1f} s")
