"""A run in figures: ``summary.json`` with stable keys, the unit in each name.

What is not known is null, never zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from palpate import __version__
from palpate.launch.export import mesh_sha256
from palpate.launch.progress import Progress
from palpate.messages.types import NodeStatus, PlanDone, Score
from palpate.nodes.ending import Ending

Summary = dict[str, Any]


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
        "bound_m": None if progress.done is None else progress.done.bound,
        "within": None if progress.done is None else progress.done.within,
        "unfelt_m": None if progress.done is None else progress.done.unfelt,
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
