"""Contours of known solids: closed on the surface, in few touches, with gaps where no pad fits."""

import math
from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from palpate.core import shapes
from palpate.core.arrays import Floats
from palpate.core.explore import tracing
from palpate.core.explore.tracing import SliceSpec, TouchCommand, Trace, after_touch, next_command
from palpate.core.touch import Pad
from tests.core.explore.tracing.fingertip import DOMED, FLAT, Run, azimuths, follow, goal, press

RADIUS = 0.03
BALL = shapes.Superquadric(np.full(3, RADIUS), np.ones(2))
BOX = shapes.Superquadric(np.array([0.03, 0.02, 0.04]), np.array([0.1, 0.1]))
Off = Callable[[Floats], Floats]  # Distances of points from a surface


def column(radius: Off, count: int = 48) -> shapes.Shape:
    section = shapes.SplineSection(radius(2.0 * math.pi * np.arange(count) / count))
    ends, scales = np.array([-0.04, 0.04]), np.ones(2)
    return shapes.GeneralisedCylinder(section, ends, scales, smooth=False)


def turned(heights: list[float], scales: list[float]) -> shapes.Shape:
    """A solid of revolution of 30 mm radius, scaled over the height."""
    section = shapes.SplineSection(np.full(8, RADIUS))
    return shapes.GeneralisedCylinder(section, np.array(heights), np.array(scales))


def star(azimuth: Floats) -> Floats:
    return 0.028 * (1.0 + 0.12 * np.cos(4.0 * azimuth))


def off(shape: shapes.Superquadric) -> Off:
    return lambda points: np.linalg.norm(points, axis=1) * (1.0 - 1.0 / shape.gauge(points))


def radii(points: Floats) -> Floats:
    return np.hypot(points[:, 0], points[:, 1])


BOTTLE = turned([-0.05, -0.02, 0.0, 0.012, 0.035, 0.05], [1.0, 1.0, 1.0, 0.45, 0.45, 0.45])
GROOVE = turned([-0.04, -0.0031, -0.003, 0.003, 0.0031, 0.04], [1.0, 1.0, 0.8, 0.8, 1.0, 1.0])
SLOT = column(lambda turn: np.where(np.abs(turn - math.pi) < 0.14, 0.02, 0.028), 64)
SOLIDS: dict[str, tuple[shapes.Shape, Off]] = {
    "ball": (BALL, off(BALL)),
    "box": (BOX, off(BOX)),
    "star": (column(star), lambda points: radii(points) - star(azimuths(points))),
    "bottle": (BOTTLE, lambda points: radii(points) - 0.0135),
}
# Where only two rows are touched beside the slice, a straight line has to do; else 0.1 um.
EXACT = 5e-6
NEAR_RIM = 25e-6  # The same where the rounded edge of a box curves within 5 mm
CLOSED = [
    # Solid, height [m], pad, most touches, largest error [m]
    ("ball", 0.0, FLAT, 20, EXACT),
    ("ball", 0.018, DOMED, 26, EXACT),
    ("ball", -0.018, FLAT, 20, EXACT),
    ("ball", -0.0285, DOMED, 26, 50e-6),
    ("box", -0.024, DOMED, 35, NEAR_RIM),
    pytest.param("box", 0.0388, FLAT, 40, 50e-6, marks=pytest.mark.slow),
    ("star", 0.0, DOMED, 60, 50e-6),
    ("bottle", 0.013, FLAT, 40, 50e-6),  # close above a shoulder
    pytest.param("bottle", 0.016, DOMED, 60, 50e-6, marks=pytest.mark.slow),
]


@cache
def traced(name: str, height: float, pad: Pad) -> Run:
    return follow(pad, goal(height), press(SOLIDS[name][0], pad, height))


def trace(shape: shapes.Shape, pad: Pad, height: float = 0.0, **more: float) -> Run:
    return follow(pad, goal(height, **more), press(shape, pad, height))


def steps_of(points: Floats) -> Floats:
    return np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1)


@pytest.mark.parametrize(("name", "height", "pad", "most", "error"), CLOSED)
def test_contour_closes_on_surface_in_few_touches(name, height, pad, most, error):
    run = traced(name, height, pad)
    path, points = run.trace.path, run.points
    assert (run.status, run.trace.gaps) == ("closed", ())
    assert run.trace.touches == len(run.commands) <= most
    assert np.abs(SOLIDS[name][1](points)).max() < error
    assert np.allclose(points[:, 2], height, rtol=0, atol=1e-13)
    assert 0.0 < steps_of(points).max() <= SliceSpec(pad, height).max_spacing
    turns = azimuths(points - points.mean(axis=0))
    assert turns[-1] - turns[0] == pytest.approx(2.0 * math.pi, abs=0.25)
    assert np.diff(turns).min() > -0.02
    assert np.allclose(np.linalg.norm(path.normals, axis=1), 1.0, atol=1e-12)
    along = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    outward = along[:, 1] * path.normals[:, 0] - along[:, 0] * path.normals[:, 1]
    assert (outward > 0.0).mean() > 0.9
    assert (path.low <= height).all() and (path.high >= height).all()


@pytest.mark.parametrize(("height", "pad"), [one[1:3] for one in CLOSED if one[0] == "ball"])
def test_ball_has_circles_length_normals_curvature_and_bands(height, pad):
    run = traced("ball", height, pad)
    path, level = run.trace.path, math.sqrt(RADIUS**2 - height**2)
    assert steps_of(path.points).sum() == pytest.approx(2.0 * math.pi * level, rel=3e-3)
    assert np.allclose(path.normals, path.points / RADIUS, atol=0.03)
    assert np.median(path.curvatures) == pytest.approx(1.0 / RADIUS, rel=0.02)
    assert np.sign(run.trace.posture.tilt) == np.sign(height)
    # A contact is this high on the ball; a flat pad's ends at its edge, seen under its tilt.
    contact = math.sqrt(2.0 * tracing.TOUCH_DEPTH / (1.0 / RADIUS + pad.dome))
    contact = min(7.5e-3, contact) * level / RADIUS
    if abs(height) < 0.02:
        assert 1.2 * contact < np.median(path.high - path.low) < 2.1 * contact


@pytest.mark.parametrize(("height", "pad"), [(-0.018, FLAT), (0.018, DOMED)])
def test_repeated_step_gives_same_and_changes_nothing(height, pad):
    run = traced("ball", height, pad)
    contour = Trace(run.trace.goal)
    for command, arc in zip(run.commands, run.arcs, strict=True):
        before = contour.touches, len(contour.arcs_since), contour.path
        stepped, first = next_command(pad, contour)
        again, second = next_command(pad, stepped)
        assert before == (contour.touches, len(contour.arcs_since), contour.path)
        for one in (first, second):
            assert np.array_equal(one.start(0.0).array, command.start(0.0).array)
            assert (one.posture, one.travel) == (command.posture, command.travel)
        contour = after_touch(again, arc)
        assert contour.touches == before[0] + 1
    assert np.array_equal(next_command(pad, contour)[0].path.points, run.points)
    spent = trace(BALL, pad, most_touches=4)
    assert (spent.status, spent.trace.touches) == ("budget", 4)


@pytest.mark.parametrize("share", [0.0, 0.25, -0.33, 0.9, -0.6])
def test_search_tilts_pad_to_surface_without_overshoot(share):
    height, tilts = share * RADIUS, []
    answer, contour = press(BALL, DOMED, height), Trace(goal(height))
    while (stepped := next_command(DOMED, contour))[0].path is None:  # the first arc's search
        tilts.append(np.sign(share) * stepped[1].posture.tilt)
        contour = after_touch(stepped[0], answer(stepped[1]))
    tilts = np.array(tilts)
    assert tilts[0] == 0.0 and (np.diff(tilts) >= 0.0).all()
    assert len(tilts) == (1 if share == 0.0 else 2) or (abs(share) > 0.5 and len(tilts) <= 7)
    if 0.0 < abs(share) < 0.5:  # touched askew at first: exactly once more
        assert tilts[1] == pytest.approx(math.asin(abs(share)), abs=0.02)
    assert 0.5 * math.asin(abs(share)) <= tilts.max() < math.asin(abs(share)) + 0.02


@pytest.mark.parametrize(
    ("shape", "height", "pad", "status", "most"),
    [
        (BALL, RADIUS + 0.3e-3, FLAT, "pole", 20),
        (BALL, RADIUS + 6e-3, DOMED, "pole", 20),
        (BOX, 0.041, DOMED, "pole", 20),
        (BALL, 0.2, FLAT, "no_contact", 8),
        (BALL, -0.06, DOMED, "no_contact", 8),
        (BALL, -0.032, DOMED, "occluded", 150),
        pytest.param(GROOVE, 0.0, FLAT, "occluded", 150, marks=pytest.mark.slow),
    ],
)
def test_slice_that_cannot_be_met_ends_with_its_reason(shape, height, pad, status, most):
    run = trace(shape, pad, height)
    assert (run.status, run.trace.path, run.trace.gaps) == (status, None, ())
    assert run.trace.touches <= most


@pytest.mark.parametrize(
    ("height", "pad", "radius"),
    [(0.0, FLAT, 0.025), (0.0, Pad(16, 16, 5e-4, 3e-3, 120.0, 0.8), 0.1)]
    + [(0.0, Pad(16, 16, 2.7e-3, 3e-3, 25.0, 0.8), 0.1), (-0.97 * RADIUS, FLAT, 0.1)],
    ids=["start inside", "small pad", "large pad", "near the pole"],
)
def test_unusual_start_pad_and_height_still_close(height, pad, radius):
    run = trace(BALL, pad, height, radius=radius)
    assert (run.status, run.trace.gaps) == ("closed", ())
    assert np.allclose(np.linalg.norm(run.points, axis=1), RADIUS, atol=50e-6)


def test_contour_keeps_to_one_of_two_bodies():
    both = lambda origins, *ray: np.minimum(  # noqa: E731
        BALL.cast(origins, *ray), BALL.cast(origins - [0.09, 0.0, 0.0], *ray)
    )
    run = trace(SimpleNamespace(cast=both), DOMED)
    middle = np.array([0.09 if run.points[0, 0] > 0.045 else 0.0, 0.0, 0.0])
    assert run.status == "closed"
    assert np.allclose(np.linalg.norm(run.points - middle, axis=1), RADIUS, atol=10e-6)


def test_noisy_places_close_box_in_few_touches():
    rng, exact = np.random.default_rng(1), press(BOX, DOMED, 0.01)

    def answer(command: TouchCommand) -> tracing.SliceArc | None:
        arc, shift = exact(command), np.append(1e-4 * rng.standard_normal(2), 0.0)
        return arc and arc._replace(points=arc.points + shift)

    run = follow(DOMED, goal(0.01), answer)
    assert run.status == "closed" and run.trace.touches <= 45


def test_narrow_slot_is_gap_there_and_nowhere_else():
    run = trace(SLOT, DOMED)
    assert run.status == "occluded" and run.trace.gaps
    ends = np.array([end for gap in run.trace.gaps for end in (gap.start, gap.end)])
    assert {gap.reason for gap in run.trace.gaps} == {"bridged"}
    assert ends[:, 0].max() < -0.018 and np.abs(ends[:, 1]).max() < 0.006
    assert (steps_of(run.points) > SliceSpec(DOMED, 0.0).max_spacing).sum() == len(run.trace.gaps)
