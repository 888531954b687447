from __future__ import annotations

from typing import Any

from tests.studies.accuracy.runs import Point, Run

SIZE = 0.1


def point(touches: int, rms: float, bound: float | None = None) -> Point:
    costs = {"touches": touches, "robot_time_s": 2.0 * touches, "compute_s": 0.1 * touches}
    return Point(**costs, rms_m=rms, chamfer_m=0.8 * rms, bound_m=bound)


def run_of(*, share: float | None = None, curve: Any = None, **more: Any) -> Run:
    given: dict[str, Any] = {
        **{"method": "mine", "object": "egg", "seed": 0, "size_m": SIZE},
        **{"sampling_floor_m": 1e-6, "final": None},
        "curve": (point(10, 1e-3), point(20, 1e-4)) if curve is None else curve,
        "tolerance_m": None if share is None else share * SIZE,
        **more,
    }
    return Run(**given)
