"""Single touches: where they can be made, which is made, and when they are over."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial import Delaunay

from palpate.core import geometry, poses, shapes, touch
from palpate.core.arrays import Floats
from palpate.core.explore import planners
from palpate.core.explore.planners import Progress, Stop, Touch, Touches, estimate_error
from tests.core.explore.planners.sides import Says, known

PAD = touch.Pad(rows=16, cols=16, pitch=1e-3, thickness=6e-3, dome=0.0, saturation=0.5)
RADIUS, MIDDLE = 0.03, np.array([0.0, 0.0, 0.05])
FOOT = MIDDLE[2] - RADIUS
TOP = MIDDLE + [0.0, 0.0, RADIUS]
MOUTH = TOP + 1e-3 * np.array([[x, y, 0.0] for x in (-2, 0, 2) for y in (-2, 0, 2)])
NEAR = lambda at: 1e-3  # noqa: E731
EXACT = lambda at: 1e-5  # noqa: E731
Field = Callable[[Floats], float]


def solid(mesh: shapes.Mesh, errors: Field, distances: Field = NEAR, **changes: Any):
    """A solid as a planner observes it, by errors and distances as functions of places."""
    each = np.array([errors(at) for at in mesh.vertices])
    away = np.array([distances(at) for at in mesh.vertices])
    surface = planners.ObservedSurface(
        **{"mesh": mesh, "errors": each, "bounds": 1.6 * each, "distances": away, "pad": PAD}
        | {"platform": 0.0, "reach": 0.12, "refused": np.zeros((0, 3)), "aimed": np.zeros((0, 3))}
        | changes
    )
    return known(surface=surface, general=True, tolerance=2e-4)


BALL = shapes.Superquadric(np.full(3, RADIUS), np.ones(2)).mesh(4)
BALL = shapes.Mesh(BALL.vertices + MIDDLE, BALL.faces)


def ball(errors: Field, distances: Field = NEAR, **changes: Any):
    return solid(BALL, errors, distances, **changes)


def towards(*side: float) -> Field:
    """Errors of 1 mm within 12 mm of one side of the ball."""
    place = MIDDLE + RADIUS * np.array(side)
    return lambda at: 1e-3 if np.linalg.norm(at - place) < 12e-3 else 1e-5


def failures(observation: planners.Observation) -> list[str]:
    return [one.name for one in estimate_error(observation).verdict.failed]


@pytest.mark.parametrize("side", [(1, 0, 0), (0, -1, 0), (0, 0, 1), (0.6, 0, 0.8)])
def test_next_touch_goes_where_error_is(side):
    choice = Touches().next(ball(towards(*side)))
    assert isinstance(choice, Touch) and choice.reason == "the expected error is largest there"
    position, axes = choice.pose
    assert axes.T @ axes == pytest.approx(np.eye(3)) and np.linalg.det(axes) > 0.0
    assert axes[:, 2] @ side < -0.6 and abs(axes[2, 0]) < 1e-12  # its x axis lies level
    assert np.linalg.norm(choice.target - MIDDLE - RADIUS * np.array(side)) < 13e-3
    away = np.linalg.norm(position - MIDDLE) - RADIUS
    assert 3e-3 < away < 25e-3 and away < choice.reach < away + 12e-3
    assert planners.check_choice(Touches(), ball(towards(*side))).target == pytest.approx(choice[2])


def test_offers_never_meet_pedestal_and_reach_below_beside_it():
    low = ball(towards(0, 0, -1), platform=0.022).surface
    rim = RADIUS * math.sqrt(1.0 - ((MIDDLE[2] - 0.022) / RADIUS) ** 2)
    turn, depth = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 60), np.linspace(0.0, 0.03, 60))
    pedestal = np.stack([rim * np.cos(turn), rim * np.sin(turn), 0.022 - depth], axis=-1)
    assert len(low.offers) > 0
    for offer in low.offers:
        position, axes = offer.pose
        away = (pedestal - position) @ axes
        assert not ((np.abs(away[..., :2]) < 8e-3).all(axis=-1) & (away[..., 2] < 0.0)).any()
    choice = Touches().next(ball(towards(0.8, 0.0, -0.6), platform=FOOT))
    assert choice.pose.axes[2, 2] > 0.3 and choice.target[2] < MIDDLE[2]


def test_refused_or_tried_place_is_not_touched_again():
    errors = towards(1, 0, 0)
    first = Touches().next(ball(errors))
    around = BALL.vertices[np.linalg.norm(BALL.vertices - MIDDLE - [RADIUS, 0, 0], axis=1) < 12e-3]
    for again in (
        Touches().next(ball(errors, refused=np.vstack([around, first.target]))),
        Touches().next(known(surface=ball(errors).surface, general=True, tried=first.target[None])),
    ):
        assert isinstance(again, Stop) or np.linalg.norm(again.target - first.target) > 5e-3


def test_far_place_is_touched_though_error_is_within_tolerance():
    far = ball(EXACT, lambda at: 12e-3 if at[0] > 0.8 * RADIUS else 1e-3)
    choice = Touches().next(far)
    assert choice.reason == "nothing near to it was touched" and choice.target[0] > 0.5 * RADIUS
    estimate = estimate_error(far)
    cap = 0.5 * (1.0 - 0.8)  # of the sphere's area
    assert estimate.findings.unknown_share == pytest.approx(cap, abs=0.03)
    assert estimate.largest_untouched == pytest.approx(24e-3)
    assert estimate.open_area.normals[0] == pytest.approx([1.0, 0.0, 0.0], abs=0.6)
    assert not estimate.reached


def test_known_solid_ends_touches():
    choice, estimate = Touches().next(ball(EXACT)), estimate_error(ball(EXACT))
    assert choice == Stop(planners.ALL_REACHED) and estimate.reached
    assert estimate.rms_bound_95 == pytest.approx(1.6e-5)
    assert estimate.open_area.share == estimate.largest_untouched == 0.0
    lacking = ball(EXACT, missing=3e-3)  # parts that the solid lacks count
    assert estimate_error(lacking).rms_bound_95 == pytest.approx(math.hypot(1.6e-5, 3e-3))
    assert ball(EXACT).surface.area == pytest.approx(4.0 * math.pi * RADIUS**2, rel=0.01)
    inside, outside = MIDDLE + [0.0, 0.0, 0.029], MIDDLE + [0.0, 0.0, 0.031]
    assert lacking.surface.is_inside(inside) and not lacking.surface.is_inside(outside)


def test_spanned_opening_is_unknown_until_touched():
    away = lambda at: np.clip(6e-3 - float(np.linalg.norm(at - TOP)), 1e-3, 3e-3)  # noqa: E731
    aimed = list[Floats]()
    while isinstance(
        choice := Touches().next(
            opened := ball(EXACT, away, openings=MOUTH, aimed=np.reshape(aimed, (-1, 3)))
        ),
        Touch,
    ):
        assert np.linalg.norm(choice.target - TOP) < 6e-3
        aimed.append(choice.target)
    assert isinstance(choice, Stop) and 2 <= len(aimed) <= 4
    estimate = estimate_error(opened)
    assert failures(opened) == ["error bound", "unentered hole"]
    assert estimate.findings.unentered_hole == pytest.approx(6e-3, rel=0.1)
    assert estimate.rms_bound_95 > 1e-4  # what it may hide counts
    assert np.linalg.norm(estimate.open_area.places[0] - TOP) < 5e-3
    assert estimate_error(ball(EXACT, openings=MOUTH)).reached
    lying = ball(lambda at: 1e-2 if at[2] < 0.0205 else 1e-5, platform=FOOT)
    assert failures(lying) == []  # what it stands on may be hollow: no number bounds it
    assert lying.surface.findings.underside_share > 0.01
    assert failures(replace(lying, underside_share=0.0)) == ["underside"]


@pytest.mark.parametrize("thickness", [3e-3, 10e-3, 40e-3])
def test_bound_of_an_opening_covers_a_hole_through_the_solid(thickness):
    radius, top = 4e-3, np.array([0.0, 0.0, thickness])
    plate = shapes.Superquadric(np.array([0.03, 0.03, 0.5 * thickness]), np.full(2, 0.02)).mesh(5)
    plate = shapes.Mesh(plate.vertices + 0.5 * top, plate.faces)
    edges = np.linspace(-4e-3, 4e-3, 9)
    mouth = top + np.array([[x, y, 0.0] for x in edges for y in edges])
    away = lambda at: np.clip(radius - float(np.linalg.norm(at - top)), 1e-5, radius)  # noqa: E731
    surface = solid(plate, EXACT, away, openings=mouth, platform=None).surface
    hidden = float(np.square(surface.hole_errors).mean()) * surface.area
    walls = 2.0 * math.pi * radius * thickness * thickness**2 / 12.0  # of distances from both ends
    slope = surface.settings.hidden.opening_slope
    deepest = slope * surface.places.distances[surface.places.spanned]
    if thickness < 30e-3:
        assert walls < hidden < 40.0 * walls and surface.hole_errors.max() < deepest.max()
    else:  # deeper holes are bounded as one that is four times as deep as wide
        assert surface.hole_errors.max() == pytest.approx(deepest.max())


def test_planners_and_surfaces_with_other_settings_exist_side_by_side():
    seen, settings = ball(towards(1, 0, 0)), planners.TouchPlannerSettings()
    hasty = replace(settings, paying=replace(settings.paying, min_gain=1.0))
    assert isinstance(Touches().next(seen), Touch)
    assert "lower neither" in Touches(settings=hasty).next(seen).reason
    places = replace(planners.DEFAULT_SURFACE.places, n_places=500)
    coarse = replace(seen.surface, settings=replace(planners.DEFAULT_SURFACE, places=places))
    assert [len(one.places.points) for one in (coarse, seen.surface)] == [500, 4000]
    assert isinstance(Touches().next(replace(seen, surface=coarse)), Touch)


def test_deep_hole_does_not_end_touches_of_the_rest():
    """What it may hide is far more than what touches elsewhere bring."""
    away = lambda at: max(6e-3 - float(np.linalg.norm(at - TOP)), 1e-3)  # noqa: E731
    tried = {"openings": MOUTH, "aimed": np.array([TOP, TOP])}
    choice = Touches().next(ball(towards(1, 0, 0), away, **tried))
    assert isinstance(choice, Touch) and choice.target[0] > 0.5 * RADIUS
    assert isinstance(Touches().next(ball(EXACT, away, **tried)), Stop)


@pytest.mark.parametrize(("bend", "hides"), [((-1, -1), True), ((-1, 0), False), ((-1, 1), False)])
def test_pit_that_holds_pad_off_may_be_the_mouth_of_a_hole(bend, hides):
    """A table with a pit, a valley or a saddle in its middle, 5 mm from every touch there."""
    x, y = np.meshgrid(*[np.linspace(-0.03, 0.03, 61)] * 2)
    dip = sum(sign * np.minimum(at**2, 9e-5) for sign, at in zip(bend, (x, y), strict=True))
    top = 0.04 + (-40.0 * dip - 7.2e-3 * (min(bend) < 0))
    rows = np.stack([x, y, top], axis=-1).reshape(-1, 3)
    faces = Delaunay(rows[:, :2]).simplices
    middle = rows[30 * 61 + 30]
    away = lambda at: max(5e-3 - float(np.linalg.norm(at - middle)), 0.5e-3)  # noqa: E731
    seen = solid(shapes.Mesh(rows, faces.astype(np.int32)), EXACT, away, platform=None)
    assert (seen.surface.unentered_hole > 4e-3) == hides
    assert ("unentered hole" in failures(seen)) == hides


def test_crease_that_holds_pad_off_may_hide_error():
    turn, height = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 97)[:-1], np.linspace(0.01, 0.09, 81))
    radius = 0.01 + 0.5 * np.abs(height - 0.05)  # an hourglass
    rings = np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=-1)
    body = shapes.Mesh(*geometry.close_rings(0.01 * np.eye(3)[2], rings, 0.09 * np.eye(3)[2]))
    depth = lambda at: 4e-3 - abs(at[2] - 0.05) if abs(at[2] - 0.05) < 4e-3 else 0.5e-3  # noqa: E731
    seen = solid(body, EXACT, depth, platform=None)
    creased = seen.surface.creased
    assert (np.abs(seen.surface.places.points[creased, 2] - 0.05) < 4e-3).all()
    assert 0.01 < creased.mean() < 0.2
    assert seen.surface.bound_of(creased) > 0.2e-3 > 2e-5
    assert seen.surface.touchable_bound(np.zeros((0, 3))) < 2e-5
    tight = known(surface=seen.surface, general=True, tolerance=5e-5)
    assert isinstance(Touches().next(tight), Stop)
    assert failures(tight) == ["error bound", "crease error"]
    round_ = ball(EXACT, lambda at: 4e-3)  # a pad reaches all of a ball
    assert not round_.surface.creased.any()


def test_nearer_of_equal_touches_is_made_and_planners_agree():
    uneven = lambda at: 1e-3 if abs(at[0]) > 0.85 * RADIUS else 1e-5  # noqa: E731
    for x in (-0.1, 0.1):
        seen = known(
            surface=ball(uneven).surface,
            general=True,
            tolerance=2e-4,
            resting=MIDDLE + [x, 0.0, 0.0],
        )
        choice = Touches().next(seen)
        assert choice.target[0] * x > 0.0
        assert planners.next_touch(seen, seen.surface, 1e-3).target == pytest.approx(choice.target)
    weak = planners.next_touch(seen, seen.surface, least_gain=1e3)
    assert weak == Stop("no further touch would lower the error enough")
    assert Touches().next(known()).height == pytest.approx(0.045)  # without a solid a slice
    for more in ({}, {"surface": ball(EXACT).surface, "general": True}):
        assert isinstance(Touches().next(known(busy_heights=(0.04,), **more)), planners.Wait)


SWAYING = [3e-3, 2e-3, 1e-3, *([1.4e-3, 1e-3] * 12)]


@pytest.mark.parametrize(
    ("bounds", "opened", "settled"),
    [
        ([3e-3, 2e-3, 1e-3], 0.0, False),
        ([3e-3, 2e-3, 1e-3, 1e-3], 0.0, False),
        ([3e-3, 2e-3, 1e-3, 1e-3, 1e-3, 1e-3], 0.0, True),
        ([3e-3, 2e-3, 1e-3, 0.9e-3, 0.8e-3, 0.7e-3], 0.0, False),
        ([1e-3] * 6, 0.03, False),  # less stays open
        (SWAYING[:10], 0.0, False),
        (SWAYING, 0.0, True),  # up and down, never below what it was
        ([*SWAYING, 0.8e-3], 0.0, False),
    ],
)
def test_touches_that_change_nothing_are_last(bounds, opened, settled):
    left = range(len(bounds) - 1, -1, -1)
    *earlier, last = (
        Progress(10 * (len(bounds) - i), bound, opened * i)
        for i, bound in zip(left, bounds, strict=True)
    )
    seen = ball(lambda at: last.bound / 1.6, earlier=tuple(earlier), touches=last.touches)
    assert seen.surface.progress[-1] == pytest.approx(last)
    ended = Touches().next(seen).reason == "further touches no longer lower the error"
    assert ended == settled


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ((0.0, 0.0, 0.0), r"must begin outside the object, got \(0, 0, 0\.05\) m"),
        ((0.2, 0.0, 0.0), r"must begin within 0\.12 m of the axis, got \(0\.2, 0, 0\.05\)"),
        ((0.0, 0.0, -0.25), r"must begin no lower than 0\.12 m below the platform, got -0\.2 m"),
        ((math.nan, 0.0, 0.0), r"must have a finite Pose and a reach"),
    ],
)
def test_touch_that_no_finger_can_make_is_refused(place, words):
    asked = Touch(poses.Pose(MIDDLE + place, np.eye(3)), 0.01, MIDDLE, "")
    with pytest.raises(planners.WrongChoiceError, match=words):
        planners.check_choice(Says(asked), ball(EXACT))
    asked = asked._replace(pose=poses.Pose(MIDDLE + [0.1, 0.0, 0.0], np.eye(3)))
    assert planners.check_choice(Says(asked), ball(EXACT)) is asked
    with pytest.raises(planners.WrongChoiceError, match="needs a known solid"):
        planners.check_choice(Says(asked), known())
    with pytest.raises(ValueError, match="bounds must"):
        ball(EXACT, bounds=np.zeros(3))
