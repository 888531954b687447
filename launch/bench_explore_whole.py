"""Whole explorations, ended by the planner itself: error, cost, and what the run says of itself."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from palpate.launch.bench_explore_scene import NOISES, Demand
from palpate.launch.bench_explore_trial import Explored, explore_object
from palpate.launch.bench_row import Row
from palpate.launch.explore_objects import HEIGHT, OBJECTS
from palpate.launch.one_thread import one_thread

DEMANDED = {"exact": 0.10, "noise": 0.20}
"""Root mean square error, % of the height: what is asked for, and what must be had."""
MOST_CONTOURS, MOST_TOUCHES = 12, 420
QUICK = ("sphere", "box", "vase", "groove")


def whole_rows(quick: bool) -> Iterable[Row]:
    """Every object to the end that the planner chooses, without noise and with it.

    Parameters
    ----------
    quick : bool
        Fewer objects.
    """
    with one_thread():
        for noise, percent in DEMANDED.items():
            found = []
            for name in QUICK if quick else OBJECTS:
                demand = Demand(tolerance=0.01 * percent * HEIGHT)
                one = explore_object(OBJECTS[name], NOISES[noise], demand)
                found.append(one)
                yield from _rows(f"{name}, {noise}", one, percent)
            yield from _sums(noise, found, percent)


def _rows(title: str, one: Explored, percent: float) -> Iterator[Row]:
    rms, contours = one.percent, one.score.contours
    yield Row(f"{title}: rms", f"{rms:.3f} %", f"<= {percent:.2f} %", rms <= percent)
    enough = contours <= MOST_CONTOURS and one.touches <= MOST_TOUCHES
    target = f"<= {MOST_CONTOURS}, {MOST_TOUCHES}"
    yield Row(f"{title}: contours, touches", f"{contours}, {one.touches}", target, enough)
    yield Row(f"{title}: stated bound, largest unfelt", _said(one), "", True)
    floor = 100.0 * one.score.sampling_floor / one.score.size
    times = f"{one.score.robot_time:.0f}, {one.wall:.1f} s, {floor:.3f} %"
    yield Row(f"{title}: robot, computer, sampling floor", times, "", True)
    if not one.done.within:
        yield Row(f"{title}: ended, because", one.done.reason, "", True)


def _said(one: Explored) -> str:
    bound = "none" if one.bound is None else f"{one.bound:.3f} % {'' if one.held else 'NOT '}held"
    unfelt = "-" if one.done.unfelt is None else f"{1e3 * one.done.unfelt:.1f} mm"
    return f"{bound}, {unfelt}"


def _sums(noise: str, found: list[Explored], percent: float) -> Iterator[Row]:
    good = sum(one.percent <= percent for one in found)
    shown = f"{good} of {len(found)}"
    yield Row(f"objects, {noise}: within {percent:.2f} %", shown, "all", good == len(found))
    contours = sum(one.score.contours for one in found) / len(found)
    touches = sum(one.touches for one in found) / len(found)
    yield Row(
        f"objects, {noise}: contours, touches, mean", f"{contours:.1f}, {touches:.0f}", "", True
    )
    held = sum(one.held is True for one in found)
    yield Row(f"objects, {noise}: bound holds", f"{held} of {len(found)}", "", True)
