"""Where the next touch goes: search, steps, corners, gaps and their walls, reacquisition, ends."""

import itertools
import math

import numpy as np
import pytest

from palpate.core.explore import tracing
from palpate.core.explore.tracing import SliceArc, TouchCommand, Trace, next_command
from palpate.core.touch import Pad
from tests.core.explore.tracing import fingertip
from tests.core.explore.tracing.fingertip import FLAT, arc_of, circle, repeated, scripted, wall

HALF = 0.5 * fingertip.WIDTH
FACE = wall(*np.linspace(0.0, 0.02, 16))
BRIDGED = fingertip.missed(above=20, below=20)


def command_after(pad: Pad, *arcs: SliceArc | None) -> TouchCommand:
    command = scripted(pad, *arcs)[1]
    assert isinstance(command, TouchCommand), command
    return command


def test_absent_object_is_approached_from_eight_sides():
    wanted = tracing.TraceGoal(0.05, np.array([0.01, -0.02]), 0.1, 150)
    run = fingertip.follow(FLAT, wanted, lambda command: None)
    assert (run.status, run.trace.touches) == ("no_contact", 8)
    turns = np.degrees([one.heading for one in run.commands]) % 360.0
    assert np.sort(turns) == pytest.approx(45.0 * np.arange(8))
    assert np.sort(turns[:4]) == pytest.approx(90.0 * np.arange(4))
    for command in run.commands:
        position, axes = command.start(0.05)
        out = np.array([math.cos(command.heading), math.sin(command.heading), 0.0])
        assert position == pytest.approx([0.01, -0.02, 0.05] + 0.1 * out)
        assert axes[:, 2] == pytest.approx(-out, abs=1e-12)
        assert command.travel == pytest.approx(0.1)


def test_walk_follows_leaning_surface_to_slice_and_never_to_pole():
    met = fingertip.missed(slope=0.5, rise=5e-3)
    command = command_after(FLAT, met, met)
    assert command.heading == 0.0
    assert command.posture.tilt == pytest.approx(-math.atan(0.5))
    assert command.place == pytest.approx([0.03 - 5e-3 * 0.5, 0.0], abs=1e-9)
    for slope in (-50.0, 50.0):
        askew = fingertip.missed(slope=slope, rise=0.02)
        tilts = [one.posture.tilt for one in repeated(FLAT, askew, answer=askew, most=8)[0]]
        tilts = np.abs([one for one in tilts if one != pytest.approx(math.pi / 2)])
        assert 1.3 < tilts.max() < 1.5


def test_bridge_is_searched_deeper_in_postures_one_of_which_is_kept():
    commands, *_ = repeated(FLAT, BRIDGED, BRIDGED, answer=None, most=9)
    assert all(one.posture.depth > tracing.TOUCH_DEPTH and one.posture.is_kept for one in commands)
    postures = {(round(one.posture.tilt, 9), round(one.posture.shift, 9)) for one in commands}
    shifts = sorted({shift for _, shift in postures})
    assert len(postures) == 9
    assert shifts == pytest.approx([-shifts[2], 0.0, shifts[2]]) and 0.8 * HALF < shifts[2] < HALF
    trace, command = scripted(FLAT, BRIDGED, BRIDGED, None, wall(-1e-3, 0.0, 1e-3))
    assert command.posture == trace.posture == commands[1].posture._replace(half_contact=1e-3)
    assert np.linalg.norm(command.place - [0.03, 1e-3]) < 1e-3 + 0.5 * 2e-3 + 1e-9


@pytest.mark.parametrize("radius", [0.01, 0.03, 0.2])
@pytest.mark.parametrize("azimuth", [0.0, 3.1, -2.0])
def test_next_touch_lies_ahead_on_circle_along_its_normal(radius, azimuth):
    trace, command = scripted(FLAT, circle(radius, azimuth - 0.012 / radius, azimuth))
    ahead = math.atan2(command.place[1], command.place[0])
    assert 0.0 < math.remainder(ahead - azimuth, 2.0 * math.pi) < HALF / radius
    # A parabola follows a circle up to the fourth power of the angle.
    assert np.linalg.norm(command.place) == pytest.approx(radius, rel=0.02)
    assert math.remainder(command.heading - ahead, 2.0 * math.pi) == pytest.approx(0.0, abs=0.09)
    end = trace.end_heading
    hollow = circle(radius, azimuth + 0.012 / radius, azimuth)
    bent = scripted(FLAT, hollow._replace(normals=-hollow.normals))[0].end_heading
    assert bent.curvature == pytest.approx(max(-1.0 / radius, -3.0 / fingertip.WIDTH), rel=0.15)
    assert end.tangent == pytest.approx([-math.sin(azimuth), math.cos(azimuth)], abs=1e-12)
    assert end.curvature == pytest.approx(1.0 / radius, rel=0.15)
    assert math.remainder(end.normal_azimuth - azimuth, 2.0 * math.pi) == pytest.approx(0, abs=1e-9)


def test_steps_are_as_long_as_contact_and_pad_allow():
    flat = wall(*np.linspace(-0.012, 0.0, 13))
    large = Pad(16, 16, 2e-3, 3e-3, 0.0, 0.8)
    ways = [
        np.linalg.norm(command_after(pad, arc).place - arc.points[-1, :2])
        for pad, arc in ((FLAT, flat), (fingertip.DOMED, flat), (large, flat))
    ]
    assert 0.6 * HALF < ways[0] < 0.8 * HALF
    assert ways[1:] == pytest.approx([ways[0], 2.0 * ways[0]])
    for radius in (0.003, 0.006):  # the contact of a press of depth d is 2 sqrt(2 r d) long
        arc = circle(radius, -0.009 / radius, 0.0, 40)
        way = np.linalg.norm(command_after(FLAT, arc).place - arc.points[-1, :2])
        assert way == pytest.approx(math.sqrt(2.0 * tracing.TOUCH_DEPTH * radius), rel=0.16)
    ahead = wall(*np.linspace(0.0, 0.006, 7))  # its slope tilts the next touch in part
    assert command_after(FLAT, flat, ahead._replace(slope=0.02)).posture.tilt == 0.0
    tilt = command_after(FLAT, flat, ahead._replace(slope=0.5)).posture.tilt
    assert -math.atan(0.5) < tilt < -0.5 * math.atan(0.5)


def test_joined_arc_adds_what_lies_ahead_and_widens_bands_behind():
    trace = scripted(FLAT, circle(0.03, 0.0, 0.5, 16), circle(0.03, 0.4, 0.8, 13))[0]
    turns = fingertip.azimuths(trace.path.points)
    assert len(turns) == 16 + 9 and (np.diff(turns) > 0.0).all()
    assert (trace.arcs_since, trace.touches) == ((), 2)
    first = wall(0.0, 1e-3, 2e-3)._replace(low=np.full(3, -3e-3), high=np.full(3, 1e-3))
    places = (1.3e-3, 2.3e-3, 3.3e-3, 4.3e-3)
    second = wall(*places)._replace(low=np.full(4, -1e-3), high=np.full(4, 5e-3))
    path = scripted(FLAT, first, second)[0].path
    assert path.points[:, 1].tolist() == [0.0, 1e-3, 2e-3, *places[1:]]
    assert path.high.tolist() == [1e-3, 5e-3, 5e-3, 5e-3, 5e-3, 5e-3]
    assert path.low.tolist() == [-3e-3] * 3 + [-1e-3] * 3


def test_miss_turns_both_ways_hops_ahead_and_comes_back_from_outside():
    (_, *rest), _, status = repeated(FLAT, FACE, answer=None)
    corner = [one for one in rest if one.standoff > 0.0]
    turns = np.degrees([one.heading for one in corner])
    assert turns[0] > 0.0 and 90.0 <= turns.max() <= 110.0 and -60.0 <= turns.min() <= -40.0
    ways = np.array([np.linalg.norm(one.place - [0.03, 0.02]) for one in corner])
    on_spot = ways < 1e-9
    assert on_spot[:6].all() and len(set(turns[on_spot].round(6))) == 6
    assert (
        np.diff(ways[~on_spot]) >= 0.0
    ).all() and fingertip.WIDTH / 2 < ways.max() < fingertip.WIDTH
    assert all(one.standoff >= 0.2 * fingertip.WIDTH for one in corner)
    outside = np.unwrap([one.heading for one in rest if one.standoff == 0.0])
    assert np.diff(outside).max() <= math.radians(30.0) + 1e-9
    assert outside[-1] == pytest.approx(2.0 * math.pi)  # where the contour began
    assert status == "stuck" and len(rest) < 40
    places = np.linspace([0.0295, 0.0205], [0.02, 0.0205], 10)
    end = scripted(FLAT, FACE, None, arc_of(places, np.tile([0.0, 1.0], (10, 1))))[0].end_heading
    assert end.tangent == pytest.approx([-1.0, 0.0], abs=1e-9)  # the face beyond the corner
    assert end.normal_azimuth == pytest.approx(math.pi / 2)


def test_lost_contour_is_reacquired_and_gap_before_it_probed():
    half = circle(0.03, 0.0, math.pi, 94)
    answers: list[SliceArc | None] = [half]
    while command_after(FLAT, *answers).standoff > 0.0:
        answers.append(None)
    commands, _, status = repeated(FLAT, *answers, answer=None)
    headings = [one.heading for one in commands]
    assert headings == pytest.approx(math.pi + math.radians(30.0) * np.arange(1, 7))
    assert status == "stuck"
    beyond = circle(0.03, math.pi + 0.45, math.pi + 0.6, 5)
    middle = 0.5 * (half.points[-1] + beyond.points[0])
    assert command_after(FLAT, *answers, beyond).place == pytest.approx(middle[:2])
    trace, _ = scripted(FLAT, *answers, beyond, None)
    [gap] = trace.gaps
    assert (len(trace.path.points), trace.reacquisitions) == (94 + 5, 1)
    assert gap.extent == pytest.approx(2.0 * 0.03 * math.sin(0.225)) and gap.reason == "missed"


def test_gap_is_probed_in_middle_until_closed_or_kept():
    assert scripted(FLAT, wall(0.0, 1e-3, 2.8e-3))[0].path is not None  # these points join
    probe = command_after(FLAT, wall(0.0, 0.006))
    assert probe.place == pytest.approx([0.03, 0.003])
    assert probe.heading == pytest.approx(0.0)
    assert probe.standoff >= 0.4 * fingertip.WIDTH and probe.reach >= 0.5 * fingertip.WIDTH
    wide = command_after(FLAT, wall(0.0, 0.02))
    assert wide.standoff == wide.reach == pytest.approx(0.02)
    again = command_after(FLAT, wall(0.0, 0.010), wall(0.001, 0.002))  # it is shorter now
    assert again.place[1] == pytest.approx(0.006)
    trace, _ = scripted(FLAT, wall(0.0, 0.006), wall(-0.001, 0.0015, 0.003, 0.0045, 0.0075))
    assert trace.path.points[:, 1].tolist() == [0.0, 0.0015, 0.003, 0.0045, 0.006]
    assert trace.gaps == ()
    chain = wall(0.0, 0.006, 0.016)  # the last gap comes first
    assert command_after(FLAT, chain).place[1] == pytest.approx(0.011)
    assert command_after(FLAT, chain, None).place[1] == pytest.approx(0.003)
    gaps = scripted(FLAT, chain, None, None)[0].gaps  # nothing there: one probe is enough
    assert [(gap.start[1], gap.reason) for gap in gaps] == [(0.0, "missed"), (0.006, "missed")]


def test_edge_of_pad_comes_down_wall_of_gap_with_body_outside():
    ends, turn = np.array([[0.03, -0.004], [0.03, 0.004]]), 0.7  # of the walls against the chord
    normals = np.array([[math.cos(turn), side * math.sin(turn)] for side in (1.0, -1.0)])
    rim = arc_of(ends, normals)
    (_, deep, *probes), trace, _ = repeated(FLAT, rim, answer=rim, first=True)
    [gap] = trace.gaps
    assert (gap.reason, len(trace.path.points)) == ("bridged", 2)
    [depth] = {one.posture.depth for one in (deep, *probes)}
    assert tracing.TOUCH_DEPTH < depth < FLAT.saturation * FLAT.thickness and len(probes) % 2 == 0
    for command, end, side in zip(probes[:2], ends, (1.0, -1.0), strict=True):
        place, axes = command.start(0.0)
        edge = (place + side * HALF * axes[:, 0] + command.standoff * axes[:, 2])[:2]
        beyond, into = edge - end, np.array([-math.sin(turn), side * math.cos(turn)])
        assert 0.5 * turn < side * command.heading < turn
        assert beyond @ into == pytest.approx(np.linalg.norm(beyond))
        assert 0.1 * fingertip.WIDTH < np.linalg.norm(beyond) < 0.3 * fingertip.WIDTH
        assert command.place[0] > edge[0] and abs(command.place[1]) > abs(edge[1])
    # Where the pad is tilted its corner comes first: one row lies beyond the slice.
    postures = {(one.posture.tilt, round(one.posture.shift, 9)) for one in probes}
    assert all(shift == pytest.approx(7e-3 * np.sign(tilt)) for tilt, shift in postures)
    assert {-tilt for tilt, _ in postures} == {tilt for tilt, _ in postures}


def test_arc_beyond_gap_is_taken_last_with_touch_in_gap():
    face, beyond = wall(*np.linspace(0.0, 0.01, 11)), wall(*np.linspace(0.015, 0.02, 6))
    turned = command_after(FLAT, face, beyond)
    assert turned.heading < 0.0  # into the hollow that the pad may have bridged
    assert command_after(FLAT, face, beyond, None).place == pytest.approx([0.03, 0.0125])
    between = wall(*np.linspace(0.011, 0.014, 4), x=0.0299)
    for filling, points, gaps in ((between, 21, 0), (None, 17, 1)):
        trace, _ = scripted(FLAT, face, beyond, None, filling)
        assert (len(trace.path.points), len(trace.gaps)) == (points, gaps)


def test_gap_that_ends_at_start_is_gap():
    turns = np.linspace(0.0, 2.0 * math.pi - 0.2, 16)
    arcs = [circle(0.02, *pair) for pair in itertools.pairwise(turns)]
    arcs.append(circle(0.02, 2.0 * math.pi + 0.02, 2.0 * math.pi + 0.4))
    trace = Trace(fingertip.goal())
    while isinstance((stepped := next_command(FLAT, trace))[1], TouchCommand):
        # A plain step meets the next arc; what is tried over the gap meets nothing.
        trace = tracing.after_touch(stepped[0], None if stepped[0].arcs_since else arcs.pop(0))
    [gap] = stepped[0].gaps
    assert stepped[1] == "occluded" and gap.extent == pytest.approx(2.0 * 0.02 * math.sin(0.1))
    assert np.array_equal(gap.end, stepped[0].path.points[0])


def test_path_that_circles_without_closing_is_overrun():
    turns = itertools.count(0.0, 0.4)

    def spiral(command: TouchCommand) -> SliceArc:
        azimuth = next(turns) + np.linspace(0.0, 0.4, 12)
        away = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
        return arc_of((0.02 + 5e-4 * azimuth)[:, None] * away, away)

    assert fingertip.follow(FLAT, fingertip.goal(most_touches=40), spiral).status == "overrun"
    assert 2.0 * math.pi < next(turns) < 3.0 * math.pi
