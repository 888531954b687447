"""Three fingers beside one: the time of tracing, and the error."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from palpate.launch.bench_explore_scene import NOISY, Demand
from palpate.launch.bench_explore_trial import Explored, explore_object
from palpate.launch.bench_row import Row
from palpate.launch.explore_objects import OBJECTS
from palpate.launch.one_thread import one_thread

FINGERS = 3
NAMES, QUICK = ("ellipsoid", "box", "vase", "bottle", "twist"), ("vase",)
MOST_TIME = 0.42
"""Of one finger's."""
MOST_OFF = 0.05


def finger_rows(quick: bool) -> Iterable[Row]:
    """Objects explored by three fingers at once and by one.

    Parameters
    ----------
    quick : bool
        Fewer objects.
    """
    single, joint = [], []
    with one_thread():
        for name in QUICK if quick else NAMES:
            one = explore_object(OBJECTS[name], NOISY, Demand())
            several = explore_object(OBJECTS[name], NOISY, Demand(), fingers=FINGERS)
            ratio = tracing_seconds(several) / tracing_seconds(one)
            title = f"{name}: {FINGERS} fingers, tracing after the first contour"
            yield Row(title, f"{ratio:.2f} x", f"<= {MOST_TIME:g} x", ratio <= MOST_TIME)
            total = several.score.robot_time / one.score.robot_time
            contours = f"{several.score.contours} for {one.score.contours}"
            yield Row(f"{name}: whole robot time, contours", f"{total:.2f} x, {contours}", "", True)
            single.append(one.percent)
            joint.append(several.percent)
            yield Row(f"{name}: error", f"{joint[-1]:.3f} for {single[-1]:.3f} %", "", True)
    error = pooled(joint) / pooled(single)
    close = error <= 1.0 + MOST_OFF
    yield Row("all: error, root mean square", f"{error:.2f} x", "<= 1.05 x", close)


def pooled(errors: Sequence[float]) -> float:
    """Root mean square of errors."""
    return math.sqrt(sum(error**2 for error in errors) / len(errors))


def tracing_seconds(one: Explored) -> float:
    """Robot time from the end of the first contour to the end of the last, s."""
    ends = sorted(contour.robot_time for contour in one.contours)
    return ends[-1] - ends[0]
