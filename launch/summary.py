"""A run in figures: ``summary.json``, and the same as text of 80 columns.

Keys are stable and hold their unit. What is not known is null, never zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from palpate import __version__
from palpate.launch.files import mesh_sha256
from palpate.launch.printing import millimetres, text_table, titled
from palpate.launch.progress import Progress
from palpate.messages.types import NodeStatus, PlanDone, Score
from palpate.nodes.runtime import Ending

Summary = dict[str, Any]
TITLE_WIDTH = 11
ENDED = {"finished": "done", "died": "died", "stalled": "stalled", "interrupted": "stopped"}


def summarise(ending: Ending, progress: Progress, scene: str | None, seed: int | None) -> Summary:
    """The figures of a run.

    Parameters
    ----------
    ending : Ending
        How the graph ended.
    progress : Progress
        What was heard on the way.
    scene : str or None
        Name of the scene.
    seed : int or None
        The run's seed.

    Returns
    -------
    dict
        Ready for JSON.
    """
    model, wall = progress.model, progress.wall
    compute = sum(status.cpu for status in ending.statuses.values())
    return {
        "palpate": __version__,
        "status": ending.status,
        "reason": ending.reason if progress.done is None else _reason(ending, progress.done),
        "scene": scene,
        "seed": seed,
        **_distances(progress.score),
        "rms_bound_95_m": None if progress.done is None else progress.done.rms_bound_95,
        "tolerance_met": None if progress.done is None else progress.done.tolerance_met,
        "largest_untouched_m": None if progress.done is None else progress.done.largest_untouched,
        "contacts": progress.contacts,
        "contours": progress.contours,
        "contours_failed": progress.failed,
        "uncovered_m": None if progress.done is None else progress.done.uncovered,
        "touches": progress.touches,
        "robot_time_s": progress.robot_time,
        "ready_s": progress.ready,
        "wall_s": wall,
        "compute_s": compute if compute > 0.0 else None,
        "touches_per_s": progress.touches_per_s,
        "mesh_sha256": mesh_sha256(model) if model is not None and len(model.faces) else None,
        "final": model is not None and model.final,
        "gaps": ending.gaps,
        "duplicates": ending.duplicates,
        "restarts": dict(ending.restarts),
        "nodes": {name: _node(status) for name, status in sorted(ending.statuses.items())},
        "numerics": {} if model is None else dict(sorted(model.health.items())),
        "curve": [_point(seconds, score) for seconds, score in progress.scores],
    }


def _reason(ending: Ending, done: PlanDone) -> str:
    return f"{done.reason}; {ending.reason}"


def _distances(score: Score | None) -> Summary:
    names = {
        "chamfer_m": "chamfer",
        "rms_m": "rms",
        "hausdorff_m": "hausdorff",
        "p95_m": "p95",
        "normal_deg": "normal",
        "volume_error": "volume_error",
        "sampling_floor_m": "sampling_floor",
        "size_m": "size",
        "watertight": "watertight",
        "genus": "genus",
    }
    found = {key: None if score is None else getattr(score, name) for key, name in names.items()}
    if found["genus"] is not None and found["genus"] < 0:
        found["genus"] = None  # an open surface has no handles to count
    return found


def _node(status: NodeStatus) -> Summary:
    return {
        "messages": status.messages,
        "sent": status.sent,
        "p50_us": status.p50,
        "p99_us": status.p99,
        "cpu_s": status.cpu,
    }


def _point(seconds: float, score: Score) -> Summary:
    return {
        "contours": score.contours,
        "touches": score.touches,
        "robot_time_s": score.robot_time,
        "wall_s": seconds,
        "chamfer_m": score.chamfer,
        "rms_m": score.rms,
    }


def exit_code(summary: Mapping[str, Any], *, rebuilds: bool) -> int:
    """Exit code of a run.

    Parameters
    ----------
    summary : map
        The run's figures.
    rebuilds : bool
        Whether the graph has a node that rebuilds: then a run without a final, watertight model
        has missed its goal, and so has one that left a part of the object untraced.

    Returns
    -------
    int
        0 done, 1 the goal was missed, 3 a node died or all stood still, 130 interrupted.
    """
    if summary["status"] == "interrupted":
        return 130
    if summary["status"] != "finished":
        return 3
    solid = summary["mesh_sha256"] is not None and summary["watertight"] is not False
    covered = not summary["uncovered_m"]
    missed = rebuilds and not (summary["final"] and solid and covered)
    return 1 if missed else 0


def summary_text(summary: Mapping[str, Any], files: Sequence[str], folder: Path) -> str:
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
    lines = [*_result(summary), *_time(summary), *_node_table(summary["nodes"])]
    lines += titled("numerics", *[f"{k} {v:.3g}" for k, v in summary["numerics"].items()])
    lines += titled("outputs", *files)
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
    return [*titled("result", *near), *titled("", *rest), *_error_bound(summary)]


def _error_bound(summary: Mapping[str, Any]) -> list[str]:
    """What the run says of its own error, beside the truth."""
    if summary["rms_bound_95_m"] is None:
        return []
    bound, truth = millimetres(summary["rms_bound_95_m"]), millimetres(summary["rms_m"])
    parts = [f"rms below {bound} (95 %), in truth {truth}"]
    if summary["largest_untouched_m"] is not None:
        parts.append(f"untouched at most {millimetres(summary['unfelt_m'])}")
    return titled("promise", *parts)


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
