from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.aim import PRESS, UPRIGHT, Aim
from palpate.core.explore.course import course_at_end
from palpate.core.explore.cut import Cut
from palpate.core.explore.felt import Felt
from palpate.core.explore.march import AROUND_A_CORNER, OVER_A_GAP, Stride, extend
from palpate.core.explore.path import Path
from palpate.core.explore.routine import Done, resume
from palpate.core.touch.pad import Pad


def arc(radius: float, begin: float, end: float, count: int) -> Path:
    """Points of a circle about the origin, counter-clockwise, with their normals."""
    azimuth = np.linspace(begin, end, count)
    away = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(count)])
    flat = np.zeros(count)
    return Path(radius * away, away, flat, flat, flat)


def line(begin: Floats, end: Floats, count: int) -> Path:
    points = np.linspace([*begin, 0.0], [*end, 0.0], count)
    along = (points[-1] - points[0]) / np.linalg.norm(points[-1] - points[0])
    flat = np.zeros(count)
    return Path(points, np.tile([along[1], -along[0], 0.0], (count, 1)), flat, flat, flat)


def stride(
    pad: Pad, path: Path, heading: float, felt: Sequence[Felt | None]
) -> Aim | Stride | None:
    """Where the march from the path's end goes after it has felt this, or what it found."""
    cut = Cut(pad, 0.0)
    course = course_at_end(path, heading, cut.width)
    found = resume(lambda: extend(cut, path, course, UPRIGHT), felt)
    return found.result if isinstance(found, Done) else found


def felt_on(path: Path) -> Felt:
    return Felt(*path, 0.0, path.points[0], path.points[0], 5, 5)


def test_steps_are_as_long_as_contact_and_pad_allow(flat: Pad, domed: Pad) -> None:
    ways = []
    for pad, radius in ((flat, 0.003), (flat, 0.006), (domed, 10.0), (flat, 10.0)):
        path = arc(radius, -0.009 / radius, 0.0, 40)
        aim = stride(pad, path, 0.0, ())
        assert isinstance(aim, Aim)
        ways.append(abs(float(aim.place[1])))
    # The contact of a press of depth d on a contour of radius r is sqrt(2 r d) wide.
    assert ways[0] == pytest.approx(1.05 * math.sqrt(2.0 * PRESS * 0.003), rel=0.1)
    assert ways[1] == pytest.approx(1.05 * math.sqrt(2.0 * PRESS * 0.006), rel=0.1)
    assert ways[2] == ways[3] == pytest.approx(0.69 * 7.5e-3)


def test_an_arc_that_joins_the_path_is_taken_without_what_lies_behind(flat: Pad) -> None:
    found = stride(flat, arc(0.03, 0.0, 0.5, 16), 0.5, [felt_on(arc(0.03, 0.4, 0.8, 13))])
    assert isinstance(found, Stride)
    azimuth = np.arctan2(found.new.points[:, 1], found.new.points[:, 0])
    assert azimuth.min() > 0.5
    assert azimuth.max() == pytest.approx(0.8)
    assert len(azimuth) == 9


def test_a_miss_leads_around_the_corner_and_through_the_whole_list(flat: Pad) -> None:
    path = line(np.array([0.03, 0.0]), np.array([0.03, 0.02]), 16)
    counts = range(1, 2 + len(AROUND_A_CORNER))
    tried = [stride(flat, path, 0.0, [None] * count) for count in counts]
    headings = [aim.heading for aim in tried if isinstance(aim, Aim)]
    assert headings == pytest.approx([attempt.turn for attempt in AROUND_A_CORNER])
    assert tried[-1] is None


def test_a_face_beyond_the_corner_is_joined_by_the_turned_touch(flat: Pad) -> None:
    path = line(np.array([0.03, 0.0]), np.array([0.03, 0.02]), 16)
    top = line(np.array([0.0295, 0.0205]), np.array([0.02, 0.0205]), 10)
    found = stride(flat, path, 0.0, [None, felt_on(top)])
    assert isinstance(found, Stride)
    assert found.heading == pytest.approx(AROUND_A_CORNER[0].turn)


def test_an_arc_beyond_a_gap_is_taken_last_with_a_touch_in_the_gaps_middle(flat: Pad) -> None:
    path = line(np.array([0.03, 0.0]), np.array([0.03, 0.01]), 11)
    beyond = felt_on(line(np.array([0.03, 0.015]), np.array([0.03, 0.02]), 6))
    missed = [beyond, *[None] * len(OVER_A_GAP)]
    aim = stride(flat, path, 0.0, missed)
    assert isinstance(aim, Aim)
    assert np.allclose(aim.place, [0.03, 0.0125], atol=1e-12)
    between = felt_on(line(np.array([0.0299, 0.011]), np.array([0.0299, 0.014]), 4))
    for filling, count in ((between, 4 + 6), (None, 6)):
        found = stride(flat, path, 0.0, [*missed, filling])
        assert isinstance(found, Stride)
        assert len(found.new.points) == count
