import itertools
import math

import numpy as np
import pytest

from palpate.core.explore.tracing.contour_path import (
    DEEP_TOUCH_DEPTH,
    TOUCH_DEPTH,
    UPRIGHT,
    Path,
    ProcedureResult,
    SliceArc,
    SliceSpec,
    TouchCommand,
    heading_at_end,
    resume,
)
from palpate.core.explore.tracing.contour_trace import (
    AROUND_A_CORNER,
    OVER_A_GAP,
    REACQUIRE_STEP,
    STEEPEST,
    WALL_POSTURES,
    Stride,
    Trace,
    TraceGoal,
    after_touch,
    follow,
    next_command,
    probe_gaps,
    probe_walls,
    reacquire,
)
from palpate.core.poses import split_pose
from palpate.core.shapes.protocol import PosedShape, Shape
from palpate.core.touch.pad import Pad

MOST = 150
# Where only two rows are touched beside the slice, a straight line has to do; else 0.1 um.
EXACT = 5e-6
NEAR_RIM = 25e-6  # The same where the rounded edge of a box curves within 5 mm


def slice_at(height, most=MOST):
    return TraceGoal(height, np.zeros(2), 0.1, most)


def off_surface(shape, points):
    """Radial distance of points (n, 3) from a superquadric, m."""
    return np.asarray(np.linalg.norm(points, axis=1) * (1 - 1 / shape.gauge(points)))


def length_of(points):
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
):
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


@pytest.mark.parametrize("height", [0.0, 0.022])
def test_sharp_edges_take_few_touches(height, finger, flat, domed, block):
    for pad in (flat, domed):
        trace, status = finger(block, pad).contour(slice_at(height))
        assert (status, trace.gaps) == ("closed", ())
        assert trace.touches <= 40
        x, y = np.abs(trace.path.points[:, :2]).T
        assert np.minimum(abs(x - 0.03), abs(y - 0.022)).max() < EXACT


@pytest.mark.parametrize("share", [0.0, 0.6, 0.93])
def test_the_length_of_a_contour_of_a_ball_is_that_of_its_circle(share, finger, flat, ball):
    trace, _ = finger(ball, flat).contour(slice_at(0.03 * share))
    circle = 2 * np.pi * 0.03 * np.sqrt(1 - share**2)
    assert length_of(trace.path.points) == pytest.approx(circle, rel=3e-3)


def test_normals_look_outwards_and_curvatures_are_those_across(finger, flat, ball):
    trace, _ = finger(ball, flat).contour(slice_at(0.018))
    path = trace.path
    assert len(path.normals) == len(path.across) == len(path.points)
    assert np.allclose(path.normals, path.points / 0.03, atol=0.02)
    assert np.median(path.across) == pytest.approx(1 / 0.03, rel=0.02)


@pytest.mark.parametrize("turn", [0.3, 0.9])
def test_a_contour_does_not_depend_on_where_it_starts_beyond_its_sampling(turn, finger, domed, box):
    half = np.array([0, 0, np.sin(turn / 2), np.cos(turn / 2)])
    turned = PosedShape(box, np.concatenate([[0.004, -0.003, 0.0], half]))
    trace, status = finger(turned, domed).contour(slice_at(0.01))
    assert status == "closed"
    back = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    points = trace.path.points.copy()
    points[:, :2] = (points[:, :2] - [0.004, -0.003]) @ back.T
    assert np.abs(off_surface(box, points)).max() < NEAR_RIM
    assert length_of(points) == pytest.approx(0.195, abs=3e-3)


def test_stepping_a_trace_twice_gives_the_same_and_leaves_it_unchanged(finger, flat, box):
    hand, trace = finger(box, flat), Trace(slice_at(0.0))
    for _ in range(12):
        first, aim = next_command(flat, trace)
        second, same = next_command(flat, trace)
        assert isinstance(aim, TouchCommand)
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


def test_a_trace_asked_again_goes_on_from_where_it_was(finger, flat, box):
    hand, trace = finger(box, flat), Trace(slice_at(0.0))
    for _ in range(6):
        trace, aim = next_command(flat, trace)
        again, same = next_command(flat, trace)
        assert isinstance(aim, TouchCommand)
        assert np.array_equal(aim.start(0.0), same.start(0.0))
        trace = after_touch(again, hand.answer(same, 0.0))


def test_a_slice_above_the_object_has_no_contact(finger, flat, ball):
    trace, status = finger(ball, flat).contour(slice_at(0.2))
    assert status == "no_contact"
    assert trace.path is None


def test_a_slice_over_the_top_ends_at_the_pole(finger, flat, box):
    trace, status = finger(box, flat).contour(slice_at(0.043))
    assert status == "pole"
    assert trace.path is None


@pytest.mark.parametrize("most", [1, 5, 12])
def test_a_trace_gives_up_after_its_touches(most, finger, flat, ball):
    trace, status = finger(ball, flat).contour(slice_at(0.0, most))
    assert status == "budget"
    assert trace.touches == most


class Partly:
    """A ball of which only those places can be measured that a rule allows."""

    def __init__(self, ball, rule):
        self._ball, self._rule = ball, rule

    def bounds(self):
        return self._ball.bounds()

    def cast(self, origins, direction, reach):
        found = self._ball.cast(origins, direction, reach)
        place = origins + np.where(np.isfinite(found), found, 0.0)[:, None] * direction
        return np.where(self._rule(place), found, np.inf)

    def mesh(self, level):
        return self._ball.mesh(level)


@pytest.mark.parametrize("azimuth", [180.0, 90.0, -22.0])
def test_a_stretch_that_cannot_be_touched_is_a_gap_of_its_length(azimuth, finger, flat, ball):
    middle = 0.03 * np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth))])

    def outside(place):
        return np.asarray(np.linalg.norm(place[:, :2] - middle, axis=1) > 2.5e-3)

    trace, status = finger(Partly(ball, outside), flat).contour(slice_at(0.0))
    assert status == "occluded"
    [gap] = trace.gaps
    assert 5e-3 - 2e-4 < gap.extent < 6e-3  # half a pitch longer at either end
    assert np.linalg.norm(0.5 * (gap.start + gap.end)[:2] - middle) < 0.6e-3


def test_a_side_that_cannot_be_touched_is_leapt_over_and_is_a_gap(finger, flat, ball):
    shape: Shape = Partly(ball, lambda place: np.asarray(place[:, 1] > -0.01))
    trace, status = finger(shape, flat).contour(slice_at(0.0))
    assert status == "occluded"
    [gap] = trace.gaps
    chord = 2 * math.sqrt(0.03**2 - 0.01**2)
    assert gap.extent == pytest.approx(chord, abs=1e-3)
    assert gap.start[0] < 0.0 < gap.end[0]
    assert gap.reason == "missed"


def test_a_contour_without_a_way_on_is_stuck(flat):
    trace = after_touch(next_command(flat, Trace(slice_at(0.0)))[0], arc(0.0, 0.5))
    while isinstance((stepped := next_command(flat, trace))[1], TouchCommand):
        trace = after_touch(stepped[0], None)
        assert trace.touches < 40
    assert stepped[1] == "stuck"
    assert stepped[0].path is not None


def arc(begin, end, growth=0.0):
    """A touch that measured part of a circle of 20 mm about the origin, or of a spiral."""
    azimuth = np.linspace(begin, end, 12)
    away = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(12)])
    points = (0.02 + growth * azimuth)[:, None] * away
    flat = np.zeros(12)
    return SliceArc(points, away, flat, flat, flat, 0.0, points[0], points[0], 5, 5)


def test_a_gap_that_ends_at_the_start_is_a_gap(flat):
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


def test_a_path_that_circles_without_closing_is_overrun(flat):
    trace, azimuth = Trace(slice_at(0.0)), 0.0
    while True:
        trace, found = next_command(flat, trace)
        if not isinstance(found, TouchCommand):
            break
        measured, azimuth = arc(azimuth, azimuth + 0.4, growth=0.0005), azimuth + 0.4
        trace = after_touch(trace, measured)
        assert trace.touches < 40
    assert found == "overrun"
    assert azimuth > 2 * np.pi


def following_arc(radius, begin, end, count):
    """Points of a circle about the origin, counter-clockwise, with their normals."""
    azimuth = np.linspace(begin, end, count)
    away = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(count)])
    flat = np.zeros(count)
    return Path(radius * away, away, flat, flat, flat)


def line(begin, end, count):
    points = np.linspace([*begin, 0.0], [*end, 0.0], count)
    along = (points[-1] - points[0]) / np.linalg.norm(points[-1] - points[0])
    flat = np.zeros(count)
    return Path(points, np.tile([along[1], -along[0], 0.0], (count, 1)), flat, flat, flat)


def stride(pad, path, heading, measured):
    """Where the march from the path's end goes after it has measured this, or what it found."""
    cut = SliceSpec(pad, 0.0)
    course = heading_at_end(path, heading, cut.width)
    found = resume(lambda: follow(cut, path, course, UPRIGHT), measured)
    return found.result if isinstance(found, ProcedureResult) else found


def measured_on(path):
    return SliceArc(*path, 0.0, path.points[0], path.points[0], 5, 5)


def test_steps_are_as_long_as_contact_and_pad_allow(flat, domed):
    ways = []
    for pad, radius in ((flat, 0.003), (flat, 0.006), (domed, 10.0), (flat, 10.0)):
        path = following_arc(radius, -0.009 / radius, 0.0, 40)
        aim = stride(pad, path, 0.0, ())
        assert isinstance(aim, TouchCommand)
        ways.append(abs(float(aim.place[1])))
    # The contact of a press of depth d on a contour of radius r is sqrt(2 r d) wide.
    assert ways[0] == pytest.approx(1.05 * math.sqrt(2.0 * TOUCH_DEPTH * 0.003), rel=0.1)
    assert ways[1] == pytest.approx(1.05 * math.sqrt(2.0 * TOUCH_DEPTH * 0.006), rel=0.1)
    assert ways[2] == ways[3] == pytest.approx(0.69 * 7.5e-3)


def test_an_arc_that_joins_the_path_is_taken_without_what_lies_behind(flat):
    found = stride(
        flat,
        following_arc(0.03, 0.0, 0.5, 16),
        0.5,
        [measured_on(following_arc(0.03, 0.4, 0.8, 13))],
    )
    azimuth = np.arctan2(found.new.points[:, 1], found.new.points[:, 0])
    assert azimuth.min() > 0.5
    assert azimuth.max() == pytest.approx(0.8)
    assert len(azimuth) == 9


def test_a_miss_leads_around_the_corner_and_through_the_whole_list(flat):
    path = line(np.array([0.03, 0.0]), np.array([0.03, 0.02]), 16)
    counts = range(1, 2 + len(AROUND_A_CORNER))
    tried = [stride(flat, path, 0.0, [None] * count) for count in counts]
    headings = [aim.heading for aim in tried if isinstance(aim, TouchCommand)]
    assert headings == pytest.approx([attempt.turn for attempt in AROUND_A_CORNER])
    assert tried[-1] is None


def test_a_face_beyond_the_corner_is_joined_by_the_turned_touch(flat):
    path = line(np.array([0.03, 0.0]), np.array([0.03, 0.02]), 16)
    top = line(np.array([0.0295, 0.0205]), np.array([0.02, 0.0205]), 10)
    found = stride(flat, path, 0.0, [None, measured_on(top)])
    assert found.heading == pytest.approx(AROUND_A_CORNER[0].turn)


def test_an_arc_beyond_a_gap_is_taken_last_with_a_touch_in_the_gaps_middle(flat):
    path = line(np.array([0.03, 0.0]), np.array([0.03, 0.01]), 11)
    beyond = measured_on(line(np.array([0.03, 0.015]), np.array([0.03, 0.02]), 6))
    missed = [beyond, *[None] * len(OVER_A_GAP)]
    aim = stride(flat, path, 0.0, missed)
    assert np.allclose(aim.place, [0.03, 0.0125], atol=1e-12)
    between = measured_on(line(np.array([0.0299, 0.011]), np.array([0.0299, 0.014]), 4))
    for filling, count in ((between, 4 + 6), (None, 6)):
        found = stride(flat, path, 0.0, [*missed, filling])
        assert len(found.new.points) == count


# Of a gap that stays: a plain one, a deep one, and each way at both ends.
PROBES = 2 + 2 * len(WALL_POSTURES)


def chain(*places):
    """Points along y on a wall that looks along x."""
    points = np.array([[0.03, place, 0.0] for place in places])
    flat = np.zeros(len(points))
    return Path(points, np.tile([1.0, 0.0, 0.0], (len(points), 1)), flat, flat, flat)


def measured_at(*places):
    return SliceArc(*chain(*places), 0.0, np.zeros(3), np.zeros(3), 5, 5)


def filled(pad, path, measured):
    return resume(lambda: probe_gaps(SliceSpec(pad, 0.0), path, UPRIGHT), measured)


def test_points_that_join_are_left_alone(flat):
    found = filled(flat, chain(0.0, 0.001, 0.0028), ())
    assert isinstance(found, ProcedureResult)
    path, gaps = found.result
    assert len(path.points) == 3
    assert gaps == ()


def test_a_gap_is_probed_in_its_middle_across_its_chord(flat):
    aim = filled(flat, chain(0.0, 0.006), ())
    assert np.allclose(aim.place, [0.03, 0.003])
    assert aim.heading == pytest.approx(0.0)


def test_what_is_touched_between_is_put_in_and_what_is_not_stays_a_gap(flat):
    path = chain(0.0, 0.006, 0.016)
    nothing = [measured_at(0.0, 0.016)] * PROBES
    found = filled(flat, path, [*nothing, measured_at(-0.001, 0.0015, 0.003, 0.0045, 0.0075)])
    assert isinstance(found, ProcedureResult)
    whole, [gap] = found.result
    assert whole.points[:, 1].tolist() == [0.0, 0.0015, 0.003, 0.0045, 0.006, 0.016]
    assert (gap.start[1], gap.end[1], gap.reason) == (0.006, 0.016, "bridged")
    assert gap.extent == pytest.approx(0.010)


def test_a_gap_that_a_probe_has_shortened_is_probed_again(flat):
    aim = filled(flat, chain(0.0, 0.010), [measured_at(0.001, 0.002)])
    assert np.allclose(aim.place, [0.03, 0.006])


def test_a_bridge_is_pressed_deeper_and_then_its_walls_are_followed_from_both_ends(flat):
    bridged = [measured_at(0.0, 0.010)]
    aims = [filled(flat, chain(0.0, 0.010), bridged * count) for count in range(1, PROBES)]
    assert filled(flat, chain(0.0, 0.010), bridged * PROBES) not in aims
    deep, *walls = aims
    assert np.allclose(deep.place, [0.03, 0.005])
    expected = probe_walls(
        SliceSpec(flat, 0.0), chain(0.0, 0.010).points, chain(0.0, 0.010).normals
    )
    for aim, wanted in zip(walls, expected, strict=True):
        assert aim.posture == wanted.posture
        assert np.array_equal(aim.place, wanted.place)
    assert all(
        isinstance(aim, TouchCommand) and aim.posture.depth == DEEP_TOUCH_DEPTH for aim in aims
    )


def test_where_nothing_is_touched_one_probe_is_enough(flat):
    found = filled(flat, chain(0.0, 0.006), [None])
    assert isinstance(found, ProcedureResult)
    [gap] = found.result[1]
    assert gap.reason == "missed"


def test_a_probe_that_feels_no_more_than_the_ends_has_not_helped(flat):
    path = chain(0.0, 0.006)
    found = filled(flat, path, [measured_at(0.0001, 0.0059)] * PROBES)
    assert isinstance(found, ProcedureResult)
    assert len(found.result[0].points) == 2


# Of a hollow in a wall that looks along x.
ENDS = np.array([[0.03, -0.004, 0.0], [0.03, 0.004, 0.0]])


def walls(angle):
    """Normals of two walls that lead into it, so steep."""
    return np.array([[math.cos(angle), side * math.sin(angle), 0.0] for side in (1.0, -1.0)])


def leading_edge(pad, aim, number):
    """Where the pad's edge comes that is set into the hollow, (2,), m."""
    place, axes = split_pose(aim.start(0.0))
    edge = place + (1.0 if number == 0 else -1.0) * 7.5e-3 * axes[:, 0]
    return edge[:2] + aim.standoff * axes[:2, 2]


def test_each_way_is_tried_at_both_ends_with_the_deepest_press(flat):
    aims = probe_walls(SliceSpec(flat, 0.0), ENDS, walls(0.7))
    assert len(aims) == 2 * len(WALL_POSTURES)
    assert {aim.posture.depth for aim in aims} == {DEEP_TOUCH_DEPTH}
    assert flat.saturation * flat.thickness > DEEP_TOUCH_DEPTH


def test_an_edge_comes_down_the_wall_beyond_its_last_touched_point(flat):
    first, last = probe_walls(SliceSpec(flat, 0.0), ENDS, walls(0.7))[:2]
    for number, aim, side in ((0, first, 1.0), (1, last, -1.0)):
        assert aim.heading == pytest.approx(side * 0.9 * 0.7)
        beyond = leading_edge(flat, aim, number) - ENDS[number, :2]
        assert np.linalg.norm(beyond) == pytest.approx(0.22 * 15e-3)
        into = np.array([-math.sin(0.7), side * math.cos(0.7)])
        assert beyond @ into == pytest.approx(0.22 * 15e-3)


def test_the_pads_body_stays_outside_the_hollow(flat):
    for number, aim in enumerate(probe_walls(SliceSpec(flat, 0.0), ENDS, walls(0.7))[:2]):
        edge, middle = leading_edge(flat, aim, number), aim.place
        assert middle[0] > edge[0]
        assert abs(middle[1]) > abs(edge[1])


def test_corners_come_first_where_the_pad_is_tilted(flat):
    for aim, way in zip(
        probe_walls(SliceSpec(flat, 0.0), ENDS, walls(0.7))[::2], WALL_POSTURES, strict=True
    ):
        assert aim.posture.tilt == way.tilt
        assert aim.posture.shift == pytest.approx(7e-3 * float(np.sign(way.tilt)))


def test_no_edge_is_set_beyond_the_middle_of_a_narrow_gap(flat):
    narrow = 0.25 * ENDS + 0.75 * ENDS.mean(axis=0)
    for number, aim in enumerate(probe_walls(SliceSpec(flat, 0.0), narrow, walls(0.0))[:2]):
        assert leading_edge(flat, aim, number)[1] == pytest.approx(0.0, abs=1e-12)


def test_a_pad_is_never_turned_along_the_chord(flat):
    first = probe_walls(SliceSpec(flat, 0.0), ENDS, walls(3.0))[0]
    assert first.heading == pytest.approx(STEEPEST)


@pytest.mark.parametrize("scale", [0.3, 3.0])
def test_lengths_go_by_the_width_of_the_array(scale, flat):
    pad = Pad(16, 16, scale * flat.pitch, flat.thickness, 0.0, flat.saturation)
    one = probe_walls(SliceSpec(flat, 0.0), ENDS, walls(0.5))[0]
    other = probe_walls(SliceSpec(pad, 0.0), scale * ENDS, walls(0.5))[0]
    assert np.allclose(other.place, scale * one.place)
    assert other.standoff == pytest.approx(scale * one.standoff)


def circle_arc(begin, end):
    """Points of a circle of 30 mm."""
    azimuth = np.linspace(begin, end, max(int(30 * (end - begin)), 2))
    away = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(len(azimuth))])
    flat = np.zeros(len(azimuth))
    return Path(0.03 * away, away, flat, flat, flat)


def reacquired(pad, path, measured):
    return resume(lambda: reacquire(SliceSpec(pad, 0.0), path, np.zeros(2), 0.1), measured)


def test_approaches_come_from_ever_farther_round_up_to_the_start(flat):
    path = circle_arc(0.0, math.pi)
    aims = [reacquired(flat, path, [None] * count) for count in range(6)]
    headings = [aim.heading for aim in aims if isinstance(aim, TouchCommand)]
    assert headings == pytest.approx([math.pi + REACQUIRE_STEP * turn for turn in range(1, 7)])
    assert reacquired(flat, path, [None] * 6) == ProcedureResult(None)


def test_what_is_met_is_the_way_on_and_the_stretch_before_it_is_probed(flat):
    path, beyond = circle_arc(0.0, math.pi), circle_arc(math.pi + 0.45, math.pi + 0.6)
    met = SliceArc(*beyond, 0.0, beyond.points[0], beyond.points[0], 5, 5)
    aim = reacquired(flat, path, [met])
    assert isinstance(aim, TouchCommand)
    middle = 0.5 * (path.points[-1] + beyond.points[0])
    assert np.allclose(aim.place, middle[:2])
    found = reacquired(flat, path, [met, None])
    assert isinstance(found, ProcedureResult)
    assert isinstance(found.result, Stride)
    assert len(found.result.new.points) == len(beyond.points)
    [gap] = found.result.gaps
    assert gap.extent == pytest.approx(2 * 0.03 * math.sin(0.225))
