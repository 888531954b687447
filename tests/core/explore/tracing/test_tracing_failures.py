"""The ways in which tracing has failed, and what becomes of each."""

import math

import numpy as np
import pytest

from palpate.core.explore.tracing.contour_path import SliceSpec, TouchCommand
from palpate.core.explore.tracing.contour_trace import Trace, TraceGoal, after_touch, next_command
from palpate.core.shapes.generalised_cylinders import GeneralisedCylinder, SplineSection
from palpate.core.shapes.protocol import PosedShape
from palpate.core.shapes.superquadrics import Superquadric
from palpate.core.touch.pad import Pad


def wanted(height=0.0, centre=(0.0, 0.0), most=150):
    return TraceGoal(height, np.array(centre), 0.1, most)


def upright(radius, count=48):
    """A column of that section."""
    azimuth = 2 * math.pi * np.arange(count) / count
    return GeneralisedCylinder(
        SplineSection(radius(azimuth)), np.array([-0.04, 0.04]), np.ones(2), smooth=False
    )


def bottle(shoulder):
    sweep = [(-0.05, 1.0), (-0.02, 1.0), (0.0, 1.0), (shoulder, 0.45), (0.035, 0.45), (0.05, 0.45)]
    heights, scales = np.array(sweep).T
    return GeneralisedCylinder(SplineSection(np.full(8, 0.03)), heights, scales)


class Beside:
    """Two solids."""

    def __init__(self, first, second):
        self._both = first, second

    def bounds(self):
        low, high = np.stack([one.bounds() for one in self._both], axis=1)
        return np.stack([low.min(axis=0), high.max(axis=0)])

    def cast(self, origins, direction, reach):
        found = [one.cast(origins, direction, reach) for one in self._both]
        return np.asarray(np.minimum(*found))

    def mesh(self, level):
        raise NotImplementedError


class Partly:
    """A ball that gives way beyond y = -10 mm: nothing is measured there."""

    def __init__(self, ball):
        self._ball = ball

    def bounds(self):
        return self._ball.bounds()

    def cast(self, origins, direction, reach):
        found = self._ball.cast(origins, direction, reach)
        place = origins + np.where(np.isfinite(found), found, 0.0)[:, None] * direction
        return np.where(place[:, 1] > -0.01, found, np.inf)

    def mesh(self, level):
        raise NotImplementedError


@pytest.mark.parametrize("height", [0.018, -0.018, 0.0285, -0.0285])
def test_a_pad_that_meets_the_object_far_from_the_slice_tilts_towards_it(
    height, finger, flat, domed, ball
):
    for pad in (flat, domed):
        trace, status = finger(ball, pad).contour(wanted(height))
        assert status == "closed"
        assert np.median(trace.path.normals[:, 2]) == pytest.approx(height / 0.03, abs=0.01)
        assert np.sign(trace.posture.tilt) == np.sign(height)


def test_a_corner_is_marched_around_without_a_hole(finger, flat, domed, box):
    for pad in (flat, domed):
        trace, status = finger(box, pad).contour(wanted())
        points = trace.path.points
        steps = np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1)
        assert (status, trace.gaps) == ("closed", ())
        assert steps.max() <= SliceSpec(pad, 0.0).joined


def test_past_a_corner_the_heading_is_that_of_the_new_face(finger, flat, domed, box):
    for pad, most in ((flat, 2.0), (domed, 4.5)):  # degrees
        hand, trace, headings = finger(box, pad), Trace(wanted()), []
        while isinstance((stepped := next_command(pad, trace))[1], TouchCommand):
            trace = after_touch(stepped[0], hand.answer(stepped[1], 0.0))
            course = stepped[0].end_heading
            if course is not None and abs(stepped[0].path.points[-1, 0]) < 0.02:
                headings.append(abs(math.sin(course.normal_azimuth)))
        assert len(headings) > 4
        assert min(headings) > math.cos(math.radians(most))


@pytest.mark.parametrize("share", [0.06, 0.12])
def test_a_hollow_that_the_domed_pad_can_enter_is_followed(share, finger, domed):
    star = upright(lambda azimuth: 0.028 * (1 + share * np.cos(4 * azimuth)))
    trace, status = finger(star, domed).contour(wanted())
    assert (status, trace.gaps) == ("closed", ())
    assert trace.touches <= 30 if share == 0.06 else 60


def test_a_hollow_that_no_pad_can_enter_is_gap_there_and_nowhere_else(finger, flat, domed):
    slot = upright(lambda azimuth: np.where(np.abs(azimuth - math.pi) < 0.14, 0.02, 0.028), 64)
    for pad in (flat, domed):
        trace, status = finger(slot, pad).contour(wanted())
        assert status == "occluded"
        for gap in trace.gaps:
            assert gap.reason == "bridged"
            assert gap.start[0] < -0.018
            assert gap.end[0] < -0.018
            assert max(abs(gap.start[1]), abs(gap.end[1])) < 0.006
        points = trace.path.points
        steps = np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1)
        assert (steps > SliceSpec(pad, 0.0).joined).sum() == len(trace.gaps)


@pytest.mark.parametrize("height", [0.013, 0.016, 0.02])
def test_a_shoulder_holds_no_pad_off_the_neck(height, finger, flat, domed):
    for pad in (flat, domed):
        trace, status = finger(bottle(0.012), pad).contour(wanted(height))
        assert status == "closed"
        radius = np.linalg.norm(trace.path.points[:, :2], axis=1)
        assert np.allclose(radius, 0.0135, atol=50e-6)


def test_the_bottom_of_a_groove_too_narrow_for_the_pad_is_occluded(finger, flat):
    sweep = [(-0.04, 1.0), (-0.0031, 1.0), (-0.003, 0.8), (0.003, 0.8), (0.0031, 1.0), (0.04, 1.0)]
    heights, scales = np.array(sweep).T
    groove = GeneralisedCylinder(SplineSection(np.full(8, 0.03)), heights, scales)
    trace, status = finger(groove, flat).contour(wanted())
    assert (status, trace.path) == ("occluded", None)


@pytest.mark.parametrize("above", [0.3e-3, 2e-3, 6e-3])
def test_a_slice_that_leaves_the_object_ends_at_the_pole(above, finger, flat, domed, ball):
    for pad in (flat, domed):
        trace, status = finger(ball, pad).contour(wanted(0.03 + above))
        assert (status, trace.path) == ("pole", None)
        assert trace.touches <= 20


def test_another_part_of_the_slice_is_not_mixed_in(finger, flat, domed):
    ball, aside = Superquadric(np.full(3, 0.02), np.ones(2)), np.array([0.07, 0, 0, 0, 0, 0, 1.0])
    for pad in (flat, domed):
        two = Beside(ball, PosedShape(ball, aside))
        trace, status = finger(two, pad).contour(wanted())
        assert status == "closed"
        middle = np.array([0.07 if trace.path.points[0, 0] > 0.035 else 0.0, 0.0, 0.0])
        assert np.allclose(np.linalg.norm(trace.path.points - middle, axis=1), 0.02, atol=10e-6)


def test_a_start_inside_the_object_is_repeated_from_outside(finger, flat, domed, ball):
    for pad in (flat, domed):
        trace, status = finger(ball, pad).contour(TraceGoal(0.0, np.zeros(2), 0.025, 150))
        assert (status, trace.gaps) == ("closed", ())


def test_a_loop_that_never_closes_ends_with_its_touches(finger, flat, domed, ball):
    for pad in (flat, domed):
        for most in (4, 9):
            trace, status = finger(ball, pad).contour(wanted(most=most))
            assert (status, trace.touches) == ("budget", most)


def test_where_contact_is_lost_the_contour_is_met_again_and_the_loss_is_a_gap(
    finger, flat, domed, ball
):
    for pad in (flat, domed):
        trace, status = finger(Partly(ball), pad).contour(wanted())
        assert status == "occluded"
        assert sum(gap.extent for gap in trace.gaps) == pytest.approx(
            2 * math.sqrt(0.03**2 - 0.01**2), abs=1.5e-3
        )
        assert {gap.reason for gap in trace.gaps} == {"missed"}
        assert (trace.path.points[:, 1] > -0.01).all()


@pytest.mark.parametrize("share", [0.97, -0.97])
def test_slices_near_the_top_and_the_bottom_close(share, finger, flat, domed, ball, box):
    for pad in (flat, domed):
        for shape in (ball, box):
            height = share * float(shape.size[2])
            trace, status = finger(shape, pad).contour(wanted(height))
            off = np.linalg.norm(trace.path.points, axis=1) * (
                1 - 1 / shape.gauge(trace.path.points)
            )
            assert (status, trace.gaps) == ("closed", ())
            assert np.abs(off).max() < 50e-6


def test_a_slice_far_below_the_object_has_no_contact(finger, flat, domed, ball):
    for pad in (flat, domed):
        trace, status = finger(ball, pad).contour(wanted(-0.06))
        assert (status, trace.path) == ("no_contact", None)
        assert trace.touches <= 8


def test_a_slice_just_below_object_is_not_believed_to_be_there(finger, flat, domed, ball):
    for pad in (flat, domed):
        trace, status = finger(ball, pad).contour(wanted(-0.032))
        assert (status, trace.path) == ("occluded", None)


@pytest.mark.parametrize("width", [5e-3, 10e-3, 20e-3, 40e-3])
def test_lengths_go_by_the_width_of_the_array(width, finger, ball):
    for dome in (0.0, 1.0 / width):
        pad = Pad(16, 16, width / 15, 3e-3, dome, 0.8)
        trace, status = finger(ball, pad).contour(wanted())
        assert status == "closed"
        assert np.allclose(np.linalg.norm(trace.path.points, axis=1), 0.03, atol=35e-6)


def test_box_touched_by_trembling_hand_costs_no_more_than_45_touches(finger, flat, domed, box):
    for pad in (flat, domed):
        for seed in range(3):
            hand, rng = finger(box, pad), np.random.default_rng(seed)
            trace = Trace(wanted(0.01))
            while isinstance((stepped := next_command(pad, trace))[1], TouchCommand):
                measured = hand.answer(stepped[1], 0.01)
                shift = np.append(1e-4 * rng.standard_normal(2), 0.0)
                if measured is not None:
                    measured = measured._replace(points=measured.points + shift)
                trace = after_touch(stepped[0], measured)
            assert stepped[1] == "closed"
            assert stepped[0].touches <= 45
