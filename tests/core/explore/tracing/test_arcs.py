"""The arc of one touch: where a touched surface meets the slice, its band, slope and normals."""

import math

import numpy as np
import pytest

from palpate.core.arrays import Bools, Floats
from palpate.core.explore.tracing import SliceArc, arc_in_slice
from palpate.core.poses import Pose, pad_rotation
from palpate.core.shapes import Superquadric
from palpate.core.touch import fit_jet, guarded_move
from tests.core.explore.tracing.fingertip import DOMED, FLAT, azimuths

RADIUS = 0.03
BALL = Superquadric(np.full(3, RADIUS), np.ones(2))
ROW_BIAS = 0.2e-6  # What a cubic through four rows misses on a ball [m]; a line cuts off 4.2 um
ALL = np.ones((16, 16), np.bool_)
X, Y = FLAT.grid()
NONE = np.zeros((16, 16))


def rows(first: int, last: int) -> Bools:
    touched = np.zeros((16, 16), np.bool_)
    touched[first : last + 1] = True
    return touched


def level(surface: Floats, touched: Bools = ALL, height: float = 0.0, tilt: float = 0.0):
    """The arc of a flat pad that looks along -x, its middle at the origin."""
    pose = Pose(np.zeros(3), pad_rotation(0.0, tilt))
    return arc_in_slice(FLAT, pose, surface, touched, None, height)


def in_pad(points: Floats, tilt: float = 0.0) -> Floats:
    return points @ pad_rotation(0.0, tilt)


def ball_arc(pad, heading: float, tilt: float, height: float, depth: float = 1e-3) -> SliceArc:
    """A pad pressed towards the middle of a ball."""
    axes = pad_rotation(heading, tilt)
    end = guarded_move(BALL, pad, Pose(-0.05 * axes[:, 2], axes), 0.05, depth)
    touched = end.compression > 0
    surface = pad.surface(end.compression, touched)
    fitted = fit_jet(pad, surface, touched)
    arc = arc_in_slice(pad, end.pose, surface, touched, fitted and fitted.jet, height)
    assert arc is not None
    return arc


@pytest.mark.parametrize("pad", [FLAT, DOMED])
@pytest.mark.parametrize(
    ("heading", "tilt", "height"),
    [(0.0, 0.0, 0.0), (2.0, 0.0, 2e-3), (-3.0, 0.6, 0.018), (-1.3, -0.6, -0.0165)],
)
def test_arc_of_ball_lies_on_it_and_runs_counterclockwise(pad, heading, tilt, height):
    arc = ball_arc(pad, heading, tilt, height)
    assert len(arc.points) >= 6
    assert np.allclose(arc.points[:, 2], height, rtol=0, atol=1e-17)
    assert np.abs(RADIUS - np.linalg.norm(arc.points, axis=1)).max() < ROW_BIAS
    assert np.allclose(arc.normals, arc.points / RADIUS, atol=2e-3)
    assert np.allclose(np.linalg.norm(arc.normals, axis=1), 1.0, atol=1e-14)
    assert np.allclose(arc.curvatures, 1.0 / RADIUS, rtol=0.05)
    turns = azimuths(arc.points)
    assert (np.diff(turns) > 0.0).all()
    assert math.remainder(turns.mean() - heading, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
    assert arc.pad @ arc.points[0] > 0.0 and np.linalg.norm(arc.pad) < RADIUS
    assert np.abs(arc.nearest[2] - height) <= 0.5e-3


def test_uncovered_slice_has_no_arc_but_slope_and_nearest_point():
    arc = ball_arc(FLAT, 0.0, 0.0, 0.012)
    assert arc.points.shape == arc.normals.shape == (0, 3)
    assert arc.curvatures.shape == arc.low.shape == arc.high.shape == (0,)
    assert (arc.above, arc.below > 100) == (0, True)
    # The contact of a press of 1 mm is 7.7 mm high on either side: its upper end is nearest.
    assert arc.nearest[2] == pytest.approx(7.5e-3, abs=1e-6)
    assert np.linalg.norm(arc.nearest) == pytest.approx(RADIUS)
    assert arc.slope == pytest.approx(-7e-3 / RADIUS, rel=0.1)


def test_slope_is_that_of_surface_nearest_to_slice():
    assert level(0.25 * Y, height=0.02).slope == pytest.approx(0.25)
    assert level(0.25 * Y).slope == 0.0  # without a jet
    bent = level(np.where(Y < -2e-3, 0.5, 0.1) * Y, height=0.02)
    assert bent.slope == pytest.approx(0.5)
    for row, sign in ((0, 1.0), (15, -1.0)):  # one row shows only to which side it leans
        touched = rows(row, row)
        touched[:, :3] = touched[:, 9:] = False
        arc = level(NONE, touched)
        assert 0.2 < sign * arc.slope < 0.6
        assert (arc.above, arc.below) == ((6, 0) if row == 0 else (0, 6))


def test_taxels_above_and_below_are_counted_and_untouched_bear_no_arc():
    touched = rows(3, 12)
    touched[:, 5:9] = False
    arc = level(NONE, touched, height=2e-3)
    assert np.allclose(arc.normals, [1.0, 0.0, 0.0], atol=1e-15)  # without a jet the pad's own
    assert (arc.curvatures == 0.0).all()
    above = touched & (-Y > 2e-3)  # rows run downwards
    assert (arc.above, arc.below) == (above.sum(), (touched & ~above).sum())
    assert len(arc.points) == 12
    assert level(NONE, ~ALL) is None


CUBIC = (0.2e-3, 0.1, 6.0, 800.0)


@pytest.mark.parametrize(
    ("first", "last", "degree"),
    [(0, 15, 3), (7, 15, 3), (0, 8, 3), (6, 9, 3), (5, 8, 3), (7, 10, 3)]
    + [(7, 9, 2), (6, 8, 2), (7, 8, 1)],
)
def test_polynomial_is_met_exactly_with_enough_rows(first, last, degree):
    surface = sum(CUBIC[n] * Y**n for n in range(degree + 1))
    arc = level(surface, rows(first, last), tilt=math.pi / 4)
    local = in_pad(arc.points, math.pi / 4)
    assert len(local) == 16
    wanted = sum(CUBIC[n] * local[:, 1] ** n for n in range(degree + 1))
    assert np.allclose(local[:, 2], wanted, rtol=0, atol=1e-15)
    assert np.allclose(arc.points[:, 2], 0.0, rtol=0, atol=1e-15)


def test_crossing_of_column_is_nearest_one_on_single_surface():
    for more, columns in ((8, 8), (5, 16)):  # two rows are left out where ample others have more
        touched = rows(7, 8)
        touched[6, 4 : 4 + more] = True
        assert len(level(NONE, touched, height=0.1e-3).points) == columns
    for jump, columns in ((1.98e-3, 16), (2.02e-3, 8)):  # of two pitches
        assert len(level(np.where((Y > 0) & (X > 0), jump, 0.0)).points) == columns
    # Seen from 45 degrees above, a wave passes the slice three times, an edge lies between rows.
    wave = level(1.2e-3 * np.sin(2.0 * math.pi * Y / 6e-3) - 0.9 * Y, tilt=math.pi / 4)
    assert np.allclose(np.sort(in_pad(wave.points, math.pi / 4)[:, 0]), X[0])
    assert np.allclose(wave.points[:, [0, 2]], 0.0, atol=0.2e-3)
    # Nearest along the pad, not nearest to its plane: roots at 0.2 and 1.8 mm of a parabola.
    bowl = 2e-3 - Y + 200.0 * (Y - 0.2e-3) * (Y - 1.8e-3)
    arc = level(bowl, ALL, -2e-3 * math.sqrt(0.5), math.pi / 4)
    assert in_pad(arc.points, math.pi / 4)[:, 1] == pytest.approx(0.2e-3)
    for place in np.linspace(-0.5e-3, 0.5e-3, 9):
        edge = level(1.2 * np.maximum(Y - place, 0.0) - 0.2 * Y, tilt=math.pi / 4)
        assert np.abs(in_pad(edge.points, math.pi / 4)[:, 1]).max() <= 0.5e-3


def test_band_reaches_from_first_to_last_touched_row_without_break():
    touched, low = ALL.copy(), np.full(16, -7.5e-3)
    touched[10, 4] = False
    stepped = level(np.where(Y < -4e-3, 2.1e-3, 0.0), touched)  # more than two pitches deep
    low[np.argsort(in_pad(stepped.points)[:, 0])[4]] = -1.5e-3  # the row before the untouched one
    for arc, ends in (
        (level(NONE, rows(3, 11)), [[-3.5e-3], [4.5e-3]]),  # rows run downwards
        (level(NONE, rows(3, 11), -2.2e-3), [[-3.5e-3], [4.5e-3]]),
        (level(NONE, height=0.5e-3), [[-7.5e-3], [7.5e-3]]),  # a row lies in the slice
        (level(NONE, tilt=0.5), np.array([[-7.5e-3], [7.5e-3]]) * math.cos(0.5)),
        (stepped, [low, np.full(16, 3.5e-3)]),
    ):
        assert len(arc.points) == 16
        assert np.allclose([arc.low, arc.high], ends, rtol=0, atol=1e-15)
