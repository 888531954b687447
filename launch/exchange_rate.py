"""What accuracy cost a run: error and bound of each model against touches, robot and compute time.

What the next halving of the error was foretold to cost stands beside what it then did cost; and
where the processor's time went, by step of the work.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from palpate.launch.progress import Progress
from palpate.messages.types import NodeStatus, PlanEstimate, Score

REST = "rest"  # Step of all that is none: starting, receiving and sending
COSTS = ("touches", "robot_time_s")  # What is foretold of a halving
Entry = dict[str, Any]


def cost_curve(progress: Progress, compute: float | None) -> list[Entry]:
    """An entry for each model that was scored or judged, in their order.

    `compute` is the processor time of all nodes at the end, s; None if it is not known.
    """
    estimates = {one.number: (wall, one) for wall, one in progress.estimates}
    scores = {one.number: (wall, one) for wall, one in progress.scores}
    curve = [
        _entry(progress, estimates.get(number), scores.get(number))
        for number in sorted(estimates | scores)
    ]
    if curve and compute is not None and progress.done is not None:
        curve[-1]["compute_s"] = compute
    measure = measure_of(curve)
    for place, one in enumerate(curve):
        halved = _halved(one, curve[place + 1 :], measure)
        foretold = one["forecast"]
        one["halved"], one["ratio"] = halved, None
        if halved is not None and foretold is not None and all(halved.values()):
            one["ratio"] = {key: foretold[key] / halved[key] for key in COSTS}
    return curve


def _entry(
    progress: Progress,
    judged: tuple[float, PlanEstimate] | None,
    scored: tuple[float, Score] | None,
) -> Entry:
    wall, model = scored or judged  # type: ignore[misc]  # one of them is there
    wall = progress.made.get(model.number, wall)  # others may come long after it
    score, known = scored and scored[1], judged and judged[1]
    forecast = None
    if known is not None and known.halving_touches is not None:
        forecast = {"touches": known.halving_touches, "robot_time_s": known.halving_seconds}
    return {
        "contours": model.contours,
        "touches": model.touches,
        "robot_time_s": model.robot_time,
        "compute_s": progress.compute_at(wall),
        "wall_s": wall,
        "chamfer_m": score and score.chamfer,
        "rms_m": score and score.rms,
        "rms_bound_95_m": known and known.rms_bound_95,
        "largest_untouched_m": known and known.largest_untouched,
        "forecast": forecast,
    }


def measure_of(curve: Sequence[Mapping[str, Any]]) -> str:
    """Key of the error by which a curve is judged: the bound where nobody knows the truth."""
    scored = any(one["rms_m"] is not None for one in curve)
    return "rms_m" if scored else "rms_bound_95_m"


def _halved(one: Entry, later: Sequence[Entry], measure: str) -> dict[str, float] | None:
    """What it took, from one model on, until the error was half as large; None if it never was."""
    error = one[measure]
    if error is None:
        return None
    for other in later:
        # The final mesh is finer than those before, and costs no touch.
        found = other[measure] is not None and other["touches"] > one["touches"]
        if found and other[measure] <= 0.5 * error:
            return {key: other[key] - one[key] for key in COSTS}
    return None


def time_by_step(statuses: Mapping[str, NodeStatus]) -> dict[str, float]:
    """Processor time of all nodes, s, by step of the work, the longest first."""
    total: dict[str, float] = {}
    for status in statuses.values():
        rest = max(status.cpu - sum(status.steps.values()), 0.0)
        for name, seconds in (*status.steps.items(), (REST, rest)):
            total[name] = total.get(name, 0.0) + seconds
    return dict(sorted(total.items(), key=lambda one: -one[1]))


def halving_lines(curve: Sequence[Mapping[str, Any]]) -> list[str]:
    """What the next halving of the error will cost, and what the last one did, in words."""
    if not curve:
        return []
    told = ["no further slice halves the error, as far as can be told"]
    if (forecast := curve[-1]["forecast"]) is not None:
        told = [f"next halving: about {_cost_text(forecast)}"]
    kept = [one for one in curve if one["ratio"] is not None]
    if kept:
        before, after = (_cost_text(kept[-1][key]) for key in ("forecast", "halved"))
        told.append(f"last halving: foretold {before}; took {after}")
    return told


def _cost_text(cost: Mapping[str, float]) -> str:
    return f"{cost['touches']:.0f} touches, {cost['robot_time_s']:.0f} s"
