from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from palpate.core.explore.aim import DEEP_PRESS, UPRIGHT, Aim
from palpate.core.explore.creep import WAYS, creeping
from palpate.core.explore.cut import Cut
from palpate.core.explore.felt import Felt
from palpate.core.explore.fill import fill
from palpate.core.explore.path import Gap, Path
from palpate.core.explore.routine import Done, resume
from palpate.core.touch.pad import Pad

PROBES = 2 + 2 * len(WAYS)
"""Of a gap that stays: a plain one, a deep one, and each way at both ends."""
Filled = tuple[Path, tuple[Gap, ...]]


def chain(*places: float) -> Path:
    """Points along y on a wall that looks along x."""
    points = np.array([[0.03, place, 0.0] for place in places])
    flat = np.zeros(len(points))
    return Path(points, np.tile([1.0, 0.0, 0.0], (len(points), 1)), flat, flat, flat)


def felt_at(*places: float) -> Felt:
    return Felt(*chain(*places), 0.0, np.zeros(3), np.zeros(3), 5, 5)


def filled(pad: Pad, path: Path, felt: Sequence[Felt | None]) -> Aim | Done[Filled]:
    return resume(lambda: fill(Cut(pad, 0.0), path, UPRIGHT), felt)


def test_points_that_join_are_left_alone(flat: Pad) -> None:
    found = filled(flat, chain(0.0, 0.001, 0.0028), ())
    assert isinstance(found, Done)
    path, gaps = found.result
    assert len(path.points) == 3
    assert gaps == ()


def test_a_gap_is_probed_in_its_middle_across_its_chord(flat: Pad) -> None:
    aim = filled(flat, chain(0.0, 0.006), ())
    assert isinstance(aim, Aim)
    assert np.allclose(aim.place, [0.03, 0.003])
    assert aim.heading == pytest.approx(0.0)


def test_what_is_felt_between_is_put_in_and_what_is_not_stays_a_gap(flat: Pad) -> None:
    path = chain(0.0, 0.006, 0.016)
    nothing: list[Felt | None] = [felt_at(0.0, 0.016)] * PROBES
    found = filled(flat, path, [*nothing, felt_at(-0.001, 0.0015, 0.003, 0.0045, 0.0075)])
    assert isinstance(found, Done)
    whole, [gap] = found.result
    assert whole.points[:, 1].tolist() == [0.0, 0.0015, 0.003, 0.0045, 0.006, 0.016]
    assert (gap.start[1], gap.end[1], gap.why) == (0.006, 0.016, "bridged")
    assert gap.extent == pytest.approx(0.010)


def test_a_gap_that_a_probe_has_shortened_is_probed_again(flat: Pad) -> None:
    aim = filled(flat, chain(0.0, 0.010), [felt_at(0.001, 0.002)])
    assert isinstance(aim, Aim)
    assert np.allclose(aim.place, [0.03, 0.006])


def test_a_bridge_is_pressed_deeper_and_then_its_walls_are_followed_from_both_ends(
    flat: Pad,
) -> None:
    bridged: list[Felt | None] = [felt_at(0.0, 0.010)]
    aims = [filled(flat, chain(0.0, 0.010), bridged * count) for count in range(1, PROBES)]
    assert filled(flat, chain(0.0, 0.010), bridged * PROBES) not in aims
    deep, *walls = aims
    assert isinstance(deep, Aim)
    assert np.allclose(deep.place, [0.03, 0.005])
    expected = creeping(Cut(flat, 0.0), chain(0.0, 0.010).points, chain(0.0, 0.010).normals)
    for aim, wanted in zip(walls, expected, strict=True):
        assert isinstance(aim, Aim)
        assert aim.stance == wanted.stance
        assert np.array_equal(aim.place, wanted.place)
    assert all(isinstance(aim, Aim) and aim.stance.depth == DEEP_PRESS for aim in aims)


def test_where_nothing_is_touched_one_probe_is_enough(flat: Pad) -> None:
    found = filled(flat, chain(0.0, 0.006), [None])
    assert isinstance(found, Done)
    [gap] = found.result[1]
    assert gap.why == "missed"


def test_a_probe_that_feels_no_more_than_the_ends_has_not_helped(flat: Pad) -> None:
    path = chain(0.0, 0.006)
    found = filled(flat, path, [felt_at(0.0001, 0.0059)] * PROBES)
    assert isinstance(found, Done)
    assert len(found.result[0].points) == 2
