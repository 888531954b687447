"""What a run says when it is over: the result in a few lines, and on request all figures.

The result stays in sight: what was found, what it cost, what to doubt and which file to open fill
at most 12 lines of a terminal of 80 columns. Timings and diagnostics are for those who ask.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from palpate.launch.exchange_rate import draw_text, halving_lines
from palpate.launch.printing import TITLE_WIDTH, counted, millimetres, text_table, titled

HEADLINE, WIDTH = 12, 80  # Lines at most, and columns
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
    """What was found, what it cost, what to doubt and what to open: at most 12 lines of 80 columns.

    `files` are the names of what the run left in its `folder`.
    """
    facts = headline_facts(summary)
    found = [line for key in ("found", "bound") if facts[key] for line in titled(key, *facts[key])]
    if not summary["missed"]:
        found += _short(_procedure(summary), 2)
    cost = _short(titled("cost", *facts["cost"]), 2)
    opened = next((one for one in OPENED if one in files), "summary.json")
    ended = _short(titled(ENDED[summary["status"]], summary["reason"]), 2)
    ended += titled("open", str(folder / opened), f"({FULL})")
    missed = titled("missed", *summary["missed"]) if summary["missed"] else []
    doubts = titled("doubt", *told) if (told := facts["doubt"]) else []
    room = HEADLINE - len(found) - len(cost) - len(ended)
    missed = _short(missed, room)
    return "\n".join([*found, *cost, *missed, *_short(doubts, room - len(missed)), *ended])


def headline_facts(summary: Mapping[str, Any]) -> dict[str, list[str]]:
    """What was found, what is stated of its error, what it cost and what to doubt, in words."""
    return {
        "found": _found(summary),
        "bound": _asked(summary),
        "cost": _time(summary),
        "doubt": _doubts(summary),
    }


def run_lines(summary: Mapping[str, Any]) -> list[str]:
    """What was found, how far it is to be trusted and what it cost, a line of 80 columns each."""
    facts, found = headline_facts(summary), []
    for title in ("found", "bound", "cost"):
        told, parts = f"  {title:<6}", facts[title] or ["none"]
        for number, part in enumerate(parts):
            more = f"{told}, {part}" if number else f"{told} {part}"
            told = more if len(more) < WIDTH else told
        found.append(told)
    return found


def _short(lines: list[str], most: int) -> list[str]:
    """Lines, of which no more are kept; that there were more is told."""
    if len(lines) <= most:
        return lines
    if most < 1:
        return []
    return [*lines[: most - 1], f"{lines[most - 1][:76]} ..."]


def _found(summary: Mapping[str, Any]) -> list[str]:
    """The solid, and how far it is from the truth."""
    if summary["mesh_sha256"] is None:
        told = summary["procedure"] is not None and not summary["missed"]
        return [] if told else ["no solid"]
    closed = "a surface that is NOT closed" if summary["watertight"] is False else "a closed solid"
    made_of = ("contours", "contour") if summary["contours"] else ("touches", "touch")
    parts = [f"{closed} from {counted(summary[made_of[0]], made_of[1], made_of[0])}"]
    if summary["chamfer_m"] is not None:
        parts = [f"{closed}, {1e3 * summary['size_m']:.0f} mm high"]
        parts.append(f"rms error {millimetres(summary['rms_m'])}")
        parts.append(f"sampling floor {millimetres(summary['sampling_floor_m'])}")
    return parts


def _asked(summary: Mapping[str, Any]) -> list[str]:
    """What is stated of the error, against what was asked for."""
    bound, asked = summary["rms_bound_95_m"], summary["tolerance_m"]
    if bound is None and (asked is None or summary["tolerance_met"] is None):
        return []
    stated = "no error bound" if bound is None else f"95 % error bound {millimetres(bound)}"
    parts = [stated]
    if asked is not None:
        reached = {True: "reached", False: "NOT reached", None: "not judged"}
        parts.append(f"tolerance {1e3 * asked:.3g} mm {reached[summary['tolerance_met']]}")
    if summary["largest_untouched_m"] is not None:
        parts.append(f"untouched at most {1e3 * summary['largest_untouched_m']:.1f} mm")
    return parts


def _doubts(summary: Mapping[str, Any]) -> list[str]:
    """Why not to believe the solid everywhere, as far as it is no missed goal."""
    told = " ".join(summary["missed"])
    found = [one for one in unknown_texts(summary) if one not in told]
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
    """What nobody touched, where, and what the object stands on, in words; nothing if unknown."""
    told = []
    if summary.get("open_share"):
        share = f"{100.0 * summary['open_share']:.1f} %"
        share = "less than 0.1 %" if share == "0.0 %" else share
        place = ", ".join(f"{1e3 * one:.0f}" for one in summary["open_places_m"][0])
        told.append(
            f"{share} of the surface lies over 5 mm from any touch, "
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
    stated = bound is not None
    known = [f"rms below {millimetres(bound)} (95 %)" if stated else "no error can be stated"]
    return known + ([] if untouched is None else [f"untouched at most {millimetres(untouched)}"])


def _cost(summary: Mapping[str, Any]) -> list[str]:
    drawn = draw_text(summary)
    foretold = [] if summary.get("procedure") else halving_lines(summary["curve"])
    heads = ["curve", *[""] * len(drawn)]
    lines = [f"{head:<{TITLE_WIDTH}}{line}" for head, line in zip(heads, drawn, strict=False)]
    return lines + [piece for line in foretold for piece in titled("", line)]


def _time(summary: Mapping[str, Any]) -> list[str]:
    counts = ("contacts", "contact"), ("contours", "contour"), ("touches", "touch")
    parts = [
        counted(summary[key], one, key) for key, one in counts if summary[key] or key == "touches"
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
    return text_table(rows, right=range(2, 6), least=(TITLE_WIDTH - 2,))


def _steps(steps: Mapping[str, float]) -> list[str]:
    total = sum(steps.values())
    if not total > 0.0:
        return []
    shares = {name: 100.0 * seconds / total for name, seconds in steps.items()}
    told = [f"{name} {share:.0f} %" for name, share in shares.items() if share >= LEAST_SHARE]
    return titled("steps", *told, f"of {total:.1f} s")
