import math

import numpy as np
import pytest

from palpate.core.explore.tracing.contour_path import (
    LEAN,
    STEEP,
    TOUCH_DEPTH,
    UPRIGHT,
    Path,
    ProcedureResult,
    SliceArc,
    TouchCommand,
    arc_in_slice,
    contact_bands,
    crossings,
    heading_at_end,
    path_of,
    resume,
    same_surface,
)
from palpate.core.explore.tracing.contour_trace import TraceGoal
from palpate.core.poses import pad_rotation, pose_of
from palpate.core.touch.jet import fit_jet
from palpate.core.touch.pad import guarded_move

WIDTH = 0.015


def arc(radius, begin, end, count):
    """Points of a circle about the origin, counter-clockwise, with their normals."""
    azimuth = np.linspace(begin, end, count)
    away = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(count)])
    flat = np.zeros(count)
    return Path(radius * away, away, flat, flat, flat)


@pytest.mark.parametrize("radius", [0.005, 0.01, 0.03, 0.2])
@pytest.mark.parametrize("azimuth", [0.0, 1.0, 3.1, -2.0])
def test_the_course_of_a_circle_is_its_tangent_and_curvature(radius, azimuth):
    path = arc(radius, azimuth - 0.012 / radius, azimuth, 13)
    course = heading_at_end(path, azimuth - 0.1, WIDTH)
    assert np.allclose(course.tangent, [-math.sin(azimuth), math.cos(azimuth)], atol=1e-12)
    assert course.normal_azimuth == pytest.approx(azimuth, abs=1e-9)
    # A parabola leaves out the fourth power, at most 60 um of it.
    assert course.curvature == pytest.approx(1 / radius, rel=0.15)


def test_a_hollow_has_negative_curvature():
    points = arc(0.02, 3.0, 2.5, 12)
    path = points._replace(normals=-points.normals)
    assert heading_at_end(path, 2.5 - math.pi, WIDTH).curvature == pytest.approx(-50.0, rel=0.1)


def test_headings_do_not_jump_by_a_whole_turn():
    for turns in (-1, 0, 2):
        path = arc(0.03, 2.9, 3.3, 12)
        course = heading_at_end(path, 3.2 + 2 * math.pi * turns, WIDTH)
        assert course.normal_azimuth == pytest.approx(3.3 + 2 * math.pi * turns, abs=1e-9)


def test_one_point_goes_on_across_the_heading():
    path = arc(0.03, 0.5, 0.5, 1)._replace(normals=np.array([[0.0, 0.0, 1.0]]))
    course = heading_at_end(path, 0.5, WIDTH)
    assert np.allclose(course.tangent, [-math.sin(0.5), math.cos(0.5)])
    assert course.curvature == 0.0


def test_curvatures_are_bounded():
    tight = heading_at_end(arc(0.0005, -2.0, 0.0, 9), 0.0, WIDTH)
    assert tight.curvature <= 500.0


def measured(slope):
    empty = np.zeros((0, 3))
    none = np.zeros(0)
    return SliceArc(empty, empty, none, none, none, slope, np.zeros(3), np.zeros(3), 1, 1)


def count_hits(most):
    """Touch at 0, 1, 2, ... until `most` hits; a miss costs two steps ahead."""
    place, hits = 0.0, 0
    while hits < most:
        found = yield TouchCommand(np.array([place, 0.0]), 0.0, 0.01, 0.01, UPRIGHT)
        place += 2.0 if found is None else 1.0
        hits += found is not None
    return hits


def place_of(aim):
    return float(aim.place[0])


def test_a_routine_starts_with_its_first_aim():
    assert place_of(resume(lambda: count_hits(2), ())) == 0.0


def test_what_was_touched_leads_to_the_next_aim():
    assert place_of(resume(lambda: count_hits(3), (measured(0.0),))) == 1.0
    assert place_of(resume(lambda: count_hits(3), (None,))) == 2.0
    assert place_of(resume(lambda: count_hits(3), (None, measured(0.0), None))) == 5.0


def test_the_end_of_a_routine_is_its_result():
    assert resume(lambda: count_hits(2), (measured(0.0), None, measured(0.0))) == ProcedureResult(2)
    assert resume(lambda: count_hits(0), ()) == ProcedureResult(0)


def test_resuming_twice_is_resuming_once():
    known = (measured(0.0), None)
    first, second = (resume(lambda: count_hits(9), known) for _ in range(2))
    assert place_of(first) == place_of(second) == 3.0


def test_a_routine_may_call_another():
    def both():
        return (yield from count_hits(1)) + (yield from count_hits(1))

    assert place_of(resume(both, (measured(0.0),))) == 0.0
    assert resume(both, (measured(0.0), measured(0.0))) == ProcedureResult(2)


def test_an_aim_starts_its_standoff_before_the_place_and_travels_past_it():
    aim = TouchCommand(np.array([0.03, 0.0]), 0.0, 0.012, 0.014, UPRIGHT)
    assert np.allclose(aim.start(0.05)[:3], [0.042, 0.0, 0.05])
    assert aim.travel == pytest.approx(0.026)
    shifted = aim._replace(posture=UPRIGHT._replace(shift=0.006))
    assert np.allclose(shifted.start(0.05)[:3], [0.042, 0.0, 0.044])
    tilted = aim._replace(posture=UPRIGHT._replace(tilt=math.pi / 2))
    assert np.allclose(tilted.start(0.05)[:3], [0.03, 0.0, 0.062])


RADIUS = 0.03
# What a cubic through four rows misses on a ball, m; a straight line cuts off 4.2 um.
ROW_BIAS = 0.2e-6


def touch(pad, shape, heading, tilt, height):
    """A pad pressed straight towards the middle of a ball, and the slice at a height."""
    axes = pad_rotation(heading, tilt)
    end = guarded_move(shape, pad, pose_of(-0.05 * axes[:, 2], axes), 0.05, 1e-3)
    touched = end.compression > 0
    surface = pad.surface(end.compression, touched)
    fitted = fit_jet(pad, surface, touched)
    return arc_in_slice(pad, end.pose, surface, touched, fitted.jet if fitted else None, height)


def level_pad(surface, touched, pad, height):
    """A pad that looks along -x, its middle at the origin."""
    pose = pose_of(np.zeros(3), pad_rotation(0.0, 0.0))
    return arc_in_slice(pad, pose, surface, touched, None, height)


@pytest.mark.parametrize("heading", [0.0, 2.0, -1.3])
@pytest.mark.parametrize(
    ("tilt", "height"), [(0.0, 0.0), (0.0, 2e-3), (0.6, 0.018), (-0.6, -0.0165)]
)
def test_the_arc_lies_on_the_ball_and_in_slice(heading, tilt, height, flat, domed, ball):
    for pad in (flat, domed):
        measured = touch(pad, ball, heading, tilt, height)
        assert len(measured.points) >= 6
        assert np.allclose(measured.points[:, 2], height, rtol=0, atol=1e-17)
        depth = RADIUS - np.linalg.norm(measured.points, axis=1)
        assert np.abs(depth).max() < ROW_BIAS
        assert np.allclose(measured.normals, measured.points / RADIUS, atol=2e-3)
        assert np.allclose(np.linalg.norm(measured.normals, axis=1), 1.0, atol=1e-14)
        assert np.allclose(measured.across, 1 / RADIUS, rtol=0.05)


def test_the_arc_leads_counter_clockwise(flat, ball):
    for heading in (0.0, 2.0, -3.0):
        measured = touch(flat, ball, heading, 0.0, 0.0)
        azimuth = np.unwrap(np.arctan2(measured.points[:, 1], measured.points[:, 0]))
        assert (np.diff(azimuth) > 0.0).all()
        assert math.remainder(azimuth.mean() - heading, 2 * math.pi) == pytest.approx(0, abs=1e-9)


def test_a_slice_that_the_pad_does_not_cover_has_no_arc_but_a_slope(flat, ball):
    measured = touch(flat, ball, 0.0, 0.0, 0.012)
    assert measured.points.shape == measured.normals.shape == (0, 3)
    assert measured.across.shape == (0,)
    assert measured.above == 0
    assert measured.below > 100
    # The contact of a press of 1 mm is 7.7 mm high on either side: its upper end is nearest.
    assert measured.nearest[2] == pytest.approx(7.5e-3, abs=1e-6)
    assert np.linalg.norm(measured.nearest) == pytest.approx(RADIUS)
    assert measured.slope == pytest.approx(-7e-3 / RADIUS, rel=0.1)


def test_the_slope_says_how_the_surface_leans_against_the_pad(flat):
    _, y = flat.grid()
    touched = np.ones((16, 16), bool)
    measured = level_pad(0.25 * y, touched, flat, 0.02)
    assert len(measured.points) == 0
    assert measured.slope == pytest.approx(0.25)


@pytest.mark.parametrize(("row", "sign"), [(0, 1.0), (15, -1.0)])
def test_where_one_row_touches_the_slope_is_a_guess_of_the_right_sign(row, sign, flat):
    touched = np.zeros((16, 16), bool)
    touched[row, 3:9] = True
    measured = level_pad(np.zeros((16, 16)), touched, flat, 0.0)
    assert measured.slope == sign * LEAN
    assert (measured.above, measured.below) == ((6, 0) if row == 0 else (0, 6))


def test_untouched_taxels_bear_no_arc(flat):
    touched = np.ones((16, 16), bool)
    touched[:, 5:9] = False
    measured = level_pad(np.zeros((16, 16)), touched, flat, 0.0)
    assert len(measured.points) == 12


def test_a_jump_between_two_rows_is_not_one_surface(flat):
    x, y = flat.grid()
    surface = np.where((y > 0) & (x > 0), 2.1e-3, 0.0)
    measured = level_pad(surface, np.ones((16, 16), bool), flat, 0.0)
    assert len(measured.points) == 8


def test_each_column_gives_the_crossing_nearest_to_the_middle(flat):
    _, y = flat.grid()
    # Seen from 45 degrees above, a wave in y passes the slice three times.
    pose = pose_of(np.zeros(3), pad_rotation(0.0, math.pi / 4))
    surface = 1.2e-3 * np.sin(2 * math.pi * y / 6e-3) - 0.9 * y
    measured = arc_in_slice(flat, pose, surface, np.ones((16, 16), bool), None, 0.0)
    assert len(measured.points) == 16
    assert np.allclose(measured.points[:, [0, 2]], 0.0, atol=0.2e-3)


def test_without_a_jet_the_pads_own_normal_stands_in(flat):
    measured = level_pad(np.zeros((16, 16)), np.ones((16, 16), bool), flat, 0.0)
    assert np.allclose(measured.normals, [1.0, 0.0, 0.0], atol=1e-15)
    assert (measured.across == 0.0).all()


def test_nothing_touched_is_nothing_touched(flat):
    assert level_pad(np.zeros((16, 16)), np.zeros((16, 16), bool), flat, 0.0) is None


ROUNDING = 1e-15


def level(pad, surface, touched, height=0.0, tilt=0.0):
    """A pad that looks along -x, its middle at the origin."""
    measured = arc_in_slice(
        pad, pose_of(np.zeros(3), pad_rotation(0.0, tilt)), surface, touched, None, height
    )
    assert measured is not None
    return measured


def test_a_flat_wall_is_touched_from_the_first_touched_row_to_the_last(flat):
    touched = np.zeros((16, 16), bool)
    touched[3:12] = True
    for height in (0.0, -2.2e-3):
        measured = level(flat, np.zeros((16, 16)), touched, height)
        assert len(measured.points) == 16
        assert np.allclose(measured.low, -3.5e-3, rtol=0, atol=1e-15)  # rows run downwards
        assert np.allclose(measured.high, 4.5e-3, rtol=0, atol=1e-15)


def test_a_tilted_pads_band_is_as_high_as_its_rows_stand(flat):
    measured = level(flat, np.zeros((16, 16)), np.ones((16, 16), bool), 0.0, 0.5)
    assert np.allclose(measured.high, 7.5e-3 * math.cos(0.5), rtol=0, atol=1e-15)


def test_a_break_ends_the_band_there_and_in_that_column_alone(flat):
    touched = np.ones((16, 16), bool)
    touched[10, 4] = False
    _, y = flat.grid()
    surface = np.zeros((16, 16))
    surface[y < -4e-3] = 2.1e-3  # a step that is more than two pitches deep
    measured = level(flat, surface, touched)
    low = np.full(16, -7.5e-3)
    low[4] = -1.5e-3  # the row before the untouched one
    assert np.allclose(measured.low, low, rtol=0, atol=1e-15)
    assert np.allclose(measured.high, 3.5e-3, rtol=0, atol=1e-15)


def test_where_the_slice_runs_along_a_row_the_band_is_on_both_sides_of_it(flat):
    measured = level(flat, np.zeros((16, 16)), np.ones((16, 16), bool), 0.5e-3)
    assert np.allclose(measured.low, -7.5e-3, rtol=0, atol=1e-15)
    assert np.allclose(measured.high, 7.5e-3, rtol=0, atol=1e-15)


def test_a_surface_that_turns_back_is_touched_to_its_highest_place(flat):
    _, y = flat.grid()
    above = 4e-3 - np.abs(y - 3.5e-3) + 1e-6
    met = crossings(flat, above, np.zeros((16, 16)), np.ones((16, 16), bool))
    whole = same_surface(flat, np.zeros((16, 16)), np.ones((16, 16), bool))
    _, high = contact_bands(above, whole, met)
    assert np.allclose(high, 4.001e-3, rtol=0, atol=1e-15)


def test_what_the_slice_does_not_meet_has_no_band(flat):
    measured = level(flat, np.zeros((16, 16)), np.ones((16, 16), bool), 0.02)
    assert measured.low.shape == measured.high.shape == (0,)


def slice_arc_arc(pad, places, low, high):
    points = np.array([[0.03, place, 0.0] for place in places])
    flat = np.zeros(len(places))
    return Path(points, 0.0 * points, flat, flat + low, flat + high)


def test_a_touch_over_touched_points_widens_their_bands_and_no_others(flat):
    path = slice_arc_arc(flat, [0.0, 1e-3, 2e-3], -3e-3, 1e-3)
    other = slice_arc_arc(flat, [1.3e-3, 2.3e-3, 3.3e-3], -1e-3, 5e-3)
    measured = SliceArc(*other, 0.0, np.zeros(3), np.zeros(3), 5, 5)
    wider = path.with_bands_of(measured, 0.75e-3)
    assert wider.high.tolist() == [1e-3, 5e-3, 5e-3]
    assert wider.low.tolist() == [-3e-3] * 3
    assert np.array_equal(wider.points, path.points)


def test_a_touch_without_an_arc_widens_no_band(flat):
    path = slice_arc_arc(flat, [0.0], -1e-3, 1e-3)
    empty = path_of(level(flat, np.zeros((16, 16)), np.ones((16, 16), bool), 0.02))
    measured = SliceArc(*empty, 0.0, np.zeros(3), np.zeros(3), 5, 5)
    assert path.with_bands_of(measured, 0.75e-3) is path


@pytest.mark.parametrize("share", [0.0, 0.5, -0.8])
def test_a_traced_ball_is_touched_as_far_as_contacts_reach(share, finger, flat, domed, ball):
    height = 0.03 * share
    for pad in (flat, domed):
        hand = finger(ball, pad)
        trace, status = hand.contour(TraceGoal(height, np.zeros(2), 0.1, 150))
        path = trace.path
        assert status == "closed"
        assert (path.low <= height).all()
        assert (path.high >= height).all()
        heights = np.concatenate([one.points[:, 2] for one in hand.contacts])
        assert heights.min() <= path.low.min() + ROUNDING
        assert heights.max() >= path.high.max() - ROUNDING
        # Half the height of a contact; a flat pad's ends at its edge.
        contact = min(7.5e-3, math.sqrt(2 * TOUCH_DEPTH / (1 / 0.03 + pad.dome))) * math.sqrt(
            1 - share**2
        )
        band = np.median(path.high - path.low)
        assert 1.2 * contact < band < 2.1 * contact


def met(pad, surface, first=0, last=15):
    """Where a surface, seen along a pad tilted by 45 degrees, meets a slice."""
    _, y = pad.grid()
    rows = np.arange(16)[:, None]
    touched = (rows >= first) & (rows <= last) & np.ones((16, 16), bool)
    return crossings(pad, 0.8 * y + surface, surface, touched).places


@pytest.mark.parametrize(("first", "last"), [(0, 15), (7, 15), (0, 8), (6, 9), (5, 8), (7, 10)])
def test_a_cubic_surface_is_met_exactly_where_four_rows_are_touched(first, last, flat):
    _, y = flat.grid()
    found = met(flat, 0.2e-3 + 6.0 * y**2 + 800.0 * y**3, first, last)
    place = found[0, 1]
    assert len(found) == 16
    assert 0.8 * place + 0.2e-3 + 6.0 * place**2 + 800.0 * place**3 == pytest.approx(0, abs=1e-15)
    assert np.allclose(found[:, 2], -0.8 * place, atol=1e-15)


@pytest.mark.parametrize(("first", "last"), [(7, 9), (6, 8)])
def test_a_parabola_is_met_exactly_where_three_rows_are_touched(first, last, flat):
    _, y = flat.grid()
    found = met(flat, 0.1e-3 + 9.0 * y**2, first, last)
    place = found[0, 1]
    assert 0.8 * place + 0.1e-3 + 9.0 * place**2 == pytest.approx(0.0, abs=1e-15)


def test_a_line_is_met_exactly_where_two_rows_are_touched(flat):
    _, y = flat.grid()
    found = met(flat, 0.1e-3 - 0.1 * y, 7, 8)
    assert np.allclose(found[:, 1], -0.1e-3 / 0.7, atol=1e-17)


def test_an_edge_between_two_rows_moves_no_point_off_its_rows(flat):
    _, y = flat.grid()
    for place in np.linspace(-0.5e-3, 0.5e-3, 9):
        found = met(flat, 1.2 * np.maximum(y - place, 0.0) - 0.6 * y)
        assert len(found) == 16
        assert np.abs(found[:, 1]).max() <= 0.5e-3


def test_columns_are_met_in_their_order_and_once(flat):
    x, y = flat.grid()
    found = crossings(flat, np.sin(y / 1.1e-3), 0.0 * x, np.ones((16, 16), bool))
    assert np.array_equal(found.places[:, 0], x[0])
    assert np.allclose(found.places[:, 1], 0.0, atol=1e-5)
    assert found.columns.tolist() == list(range(16))
    assert (found.rows == 7).all()


def test_two_rows_that_differ_too_much_are_not_one_surface(flat):
    _, y = flat.grid()
    jump = np.where(y > 0, STEEP * flat.pitch, 0.0)
    assert len(crossings(flat, y, 0.99 * jump, np.ones((16, 16), bool)).places) == 16
    assert len(crossings(flat, y, 1.01 * jump, np.ones((16, 16), bool)).places) == 0


def test_nothing_touched_is_met_nowhere(flat):
    _, y = flat.grid()
    assert crossings(flat, y, y, np.zeros((16, 16), bool)).places.shape == (0, 3)


def test_where_columns_have_more_rows_those_with_two_are_left_out(flat):
    _, y = flat.grid()
    touched = np.zeros((16, 16), bool)
    touched[7:9] = True
    lonely = crossings(flat, y - 0.2e-3, 0.0 * y, touched)
    assert lonely.columns.tolist() == list(range(16))
    touched[6, 4:12] = True
    assert crossings(flat, y - 0.2e-3, 0.0 * y, touched).columns.tolist() == list(range(4, 12))


def test_where_few_columns_have_more_rows_those_with_two_are_kept(flat):
    _, y = flat.grid()
    touched = np.zeros((16, 16), bool)
    touched[7:9] = True
    touched[6, 4:9] = True
    assert len(crossings(flat, y - 0.2e-3, 0.0 * y, touched).columns) == 16
