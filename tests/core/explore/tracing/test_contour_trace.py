from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Bools, Floats
from palpate.core.explore.tracing.contour_path import SliceArc, SliceSpec, TouchCommand
from palpate.core.explore.tracing.contour_trace import Trace, TraceGoal, after_touch, next_command
from palpate.core.shapes.protocol import Mesh, PosedShape, Shape
from palpate.core.shapes.superquadrics import Superquadric

MOST = 150


# Where only two rows are touched beside the slice, a straight line has to do; else 0.1 um.
EXACT = 5e-6
NEAR_RIM = 25e-6  # The same where the rounded edge of a box curves within 5 mm


def slice_at(height: float, most: int = MOST) -> TraceGoal:
    return TraceGoal(height, np.zeros(2), 0.1, most)


def off_surface(shape: Superquadric, points: Floats) -> Floats:
    """Radial distance of points (n, 3) from a superquadric, m."""
    return np.asarray(np.linalg.norm(points, axis=1) * (1 - 1 / shape.gauge(points)))


def length_of(points: Floats) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1).sum())


@pytest.mark.parametrize("share", [0.0, 0.6, -0.6, 0.93])
@pytest.mark.parametrize(
    # A touch on a ball adds some 12 points of 1 mm with a flat pad and 8 with a domed one; a
    # corner costs four more.
    ("name", "most_flat", "most_domed", "error"),
    [("ball", 20, 26, EXACT), ("box", 35, 35, NEAR_RIM), ("cylinder", 20, 25, NEAR_RIM)],
)
def test_a_contour_closes_on_the_surface_within_few_touches(
    name, most_flat, most_domed, error, share, finger, flat, domed, request
) -> None:
    shape = request.getfixturevalue(name)
    height = share * shape.size[2]
    for pad, most in ((flat, most_flat), (domed, most_domed)):
        trace, status = finger(shape, pad).contour(slice_at(height))
        assert status == "closed"
        assert trace.touches <= most
        assert trace.gaps == ()
        points = trace.path.points
        assert np.abs(off_surface(shape, points)).max() < error
        assert np.allclose(points[:, 2], height, rtol=0, atol=1e-16)
        steps = np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1)
        assert steps.max() <= SliceSpec(pad, height).joined
        azimuth = np.unwrap(np.arctan2(points[:, 1], points[:, 0]))
        assert azimuth[-1] - azimuth[0] == pytest.approx(2 * np.pi, abs=0.2)


@pytest.mark.parametrize("share", [0.0, 0.6, 0.93])
def test_the_length_of_a_contour_of_a_ball_is_that_of_its_circle(share, finger, flat, ball) -> None:
    trace, _ = finger(ball, flat).contour(slice_at(0.03 * share))
    circle = 2 * np.pi * 0.03 * np.sqrt(1 - share**2)
    assert length_of(trace.path.points) == pytest.approx(circle, rel=3e-3)


def test_normals_look_outwards_and_curvatures_are_those_across(finger, flat, ball) -> None:
    trace, _ = finger(ball, flat).contour(slice_at(0.018))
    path = trace.path
    assert len(path.normals) == len(path.across) == len(path.points)
    assert np.allclose(path.normals, path.points / 0.03, atol=0.02)
    assert np.median(path.across) == pytest.approx(1 / 0.03, rel=0.02)


@pytest.mark.parametrize("turn", [0.3, 0.9])
def test_a_contour_does_not_depend_on_where_it_starts_beyond_its_sampling(
    turn, finger, domed, box
) -> None:
    half = np.array([0, 0, np.sin(turn / 2), np.cos(turn / 2)])
    turned = PosedShape(box, np.concatenate([[0.004, -0.003, 0.0], half]))
    trace, status = finger(turned, domed).contour(slice_at(0.01))
    assert status == "closed"
    back = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    points = trace.path.points.copy()
    points[:, :2] = (points[:, :2] - [0.004, -0.003]) @ back.T
    assert np.abs(off_surface(box, points)).max() < NEAR_RIM
    assert length_of(points) == pytest.approx(0.195, abs=3e-3)


def test_stepping_a_trace_twice_gives_the_same_and_leaves_it_unchanged(finger, flat, box) -> None:
    hand, trace = finger(box, flat), Trace(slice_at(0.0))
    for _ in range(12):
        first, aim = next_command(flat, trace)
        second, same = next_command(flat, trace)
        assert isinstance(aim, TouchCommand)
        assert isinstance(same, TouchCommand)
        assert np.array_equal(aim.start(0.0), same.start(0.0))
        assert aim.posture == same.posture
        assert (first.touches, first.gaps) == (second.touches, second.gaps)
        assert (first.path is None) == (second.path is None)
        if first.path is not None and second.path is not None:
            assert np.array_equal(first.path.points, second.path.points)
        before = (first.touches, len(first.arcs_since))
        following = after_touch(first, hand.answer(aim, 0.0))
        assert before == (first.touches, len(first.arcs_since))
        assert following.touches == first.touches + 1
        trace = following


def test_a_trace_asked_again_goes_on_from_where_it_was(finger, flat, box) -> None:
    hand, trace = finger(box, flat), Trace(slice_at(0.0))
    for _ in range(6):
        trace, aim = next_command(flat, trace)
        again, same = next_command(flat, trace)
        assert isinstance(aim, TouchCommand)
        assert isinstance(same, TouchCommand)
        assert np.array_equal(aim.start(0.0), same.start(0.0))
        trace = after_touch(again, hand.answer(same, 0.0))


def test_a_slice_above_the_object_has_no_contact(finger, flat, ball) -> None:
    trace, status = finger(ball, flat).contour(slice_at(0.2))
    assert status == "no_contact"
    assert trace.path is None


def test_a_slice_over_the_top_ends_at_the_pole(finger, flat, box) -> None:
    trace, status = finger(box, flat).contour(slice_at(0.043))
    assert status == "pole"
    assert trace.path is None


@pytest.mark.parametrize("most", [1, 5, 12])
def test_a_trace_gives_up_after_its_touches(most, finger, flat, ball) -> None:
    trace, status = finger(ball, flat).contour(slice_at(0.0, most))
    assert status == "budget"
    assert trace.touches == most


class Partly:
    """A ball of which only those places can be felt that a rule allows."""

    def __init__(self, ball: Superquadric, rule: Callable[[Floats], Bools]) -> None:
        self._ball, self._rule = ball, rule

    def bounds(self) -> Floats:
        return self._ball.bounds()

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        found = self._ball.cast(origins, direction, reach)
        place = origins + np.where(np.isfinite(found), found, 0.0)[:, None] * direction
        return np.where(self._rule(place), found, np.inf)

    def mesh(self, level: int) -> Mesh:
        return self._ball.mesh(level)


@pytest.mark.parametrize("azimuth", [180.0, 90.0, -22.0])
def test_a_stretch_that_cannot_be_felt_is_a_gap_of_its_length(azimuth, finger, flat, ball) -> None:
    middle = 0.03 * np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth))])

    def outside(place: Floats) -> Bools:
        return np.asarray(np.linalg.norm(place[:, :2] - middle, axis=1) > 2.5e-3)

    trace, status = finger(Partly(ball, outside), flat).contour(slice_at(0.0))
    assert status == "occluded"
    [gap] = trace.gaps
    assert 5e-3 - 2e-4 < gap.extent < 6e-3  # half a pitch longer at either end
    assert np.linalg.norm(0.5 * (gap.start + gap.end)[:2] - middle) < 0.6e-3


def test_a_side_that_cannot_be_felt_is_leapt_over_and_is_a_gap(finger, flat, ball) -> None:
    shape: Shape = Partly(ball, lambda place: np.asarray(place[:, 1] > -0.01))
    trace, status = finger(shape, flat).contour(slice_at(0.0))
    assert status == "occluded"
    [gap] = trace.gaps
    chord = 2 * math.sqrt(0.03**2 - 0.01**2)
    assert gap.extent == pytest.approx(chord, abs=1e-3)
    assert gap.start[0] < 0.0 < gap.end[0]
    assert gap.reason == "missed"


def test_a_contour_without_a_way_on_is_stuck(flat) -> None:
    trace = after_touch(next_command(flat, Trace(slice_at(0.0)))[0], arc(0.0, 0.5))
    while isinstance((stepped := next_command(flat, trace))[1], TouchCommand):
        trace = after_touch(stepped[0], None)
        assert trace.touches < 40
    assert stepped[1] == "stuck"
    assert stepped[0].path is not None


def arc(begin: float, end: float, growth: float = 0.0) -> SliceArc:
    """A touch that felt part of a circle of 20 mm about the origin, or of a spiral."""
    azimuth = np.linspace(begin, end, 12)
    away = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(12)])
    points = (0.02 + growth * azimuth)[:, None] * away
    flat = np.zeros(12)
    return SliceArc(points, away, flat, flat, flat, 0.0, points[0], points[0], 5, 5)


def test_a_gap_that_ends_at_the_start_is_a_gap(flat) -> None:
    ends = np.linspace(0.0, 2 * np.pi - 0.2, 16)
    arcs = [arc(begin, end) for begin, end in itertools.pairwise(ends)]
    arcs.append(arc(2 * np.pi + 0.02, 2 * np.pi + 0.4))
    trace = Trace(slice_at(0.0))
    while isinstance((stepped := next_command(flat, trace))[1], TouchCommand):
        trace = stepped[0]
        # A plain step feels the next arc; what is tried over the gap feels nothing.
        trace = after_touch(trace, None if trace.arcs_since else arcs.pop(0))
    assert stepped[1] == "occluded"
    [gap] = stepped[0].gaps
    assert gap.extent == pytest.approx(2 * 0.02 * np.sin(0.1))


def test_a_path_that_circles_without_closing_is_overrun(flat) -> None:
    trace, azimuth = Trace(slice_at(0.0)), 0.0
    while True:
        trace, found = next_command(flat, trace)
        if not isinstance(found, TouchCommand):
            break
        felt, azimuth = arc(azimuth, azimuth + 0.4, growth=0.0005), azimuth + 0.4
        trace = after_touch(trace, felt)
        assert trace.touches < 40
    assert found == "overrun"
    assert azimuth > 2 * np.pi
