"""Solids of contact points: true shapes, noise, edges, oblique ends, stated errors."""

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from palpate.core.archive import tree_from_arrays, tree_to_arrays, tree_to_bytes
from palpate.core.arrays import Floats
from palpate.core.poses import Pose, rotations_from_vectors
from palpate.core.rebuild import LatticeSolid, reconstruct
from palpate.core.rebuild.contours import ContactPoints, stack_points
from tests.core.rebuild import objects
from tests.core.rebuild.objects import Oracle, at_height, circle, contacts, is_closed, rms, slow

NINE, SEVEN = np.linspace(-0.94, 0.94, 9), np.linspace(-0.9, 0.9, 7)
BALL = ([0.03] * 3, [1.0, 1.0])
BOX = ([0.03, 0.02, 0.04], [0.2, 0.2])
EGG = ([0.03, 0.025, 0.045], [1.0, 1.0])
V, TURNS = np.linspace(0.002, 0.998, 60), np.arange(48) / 48


def places(solid: LatticeSolid) -> Floats:
    return solid.surface.at(V[:, None], TURNS).reshape(-1, 3)


def deviation_of(solid: LatticeSolid) -> float:
    stated = solid.whole_deviation()
    assert stated is not None and np.isfinite(stated.whole) and 0.0 < stated.ends <= stated.whole
    return stated.whole


@pytest.mark.parametrize(
    ("size", "exponents", "mean", "most"),
    [
        (*BALL, 2e-6, 20e-6),
        ([0.025, 0.025, 0.04], [0.1, 1.0], 10e-6, 0.1e-3),
        slow([0.03, 0.02, 0.025], [0.5, 0.3], 30e-6, 0.25e-3),
        ([0.03, 0.02, 0.04], [0.1, 0.1], 10e-6, 50e-6),
    ],
)
def test_nine_contours_and_touched_top_recover_object(size, exponents, mean, most):
    true = Oracle(size, exponents)
    solid, touched = true.rebuilt(NINE), true.evidence(NINE)[1]
    error, health = true.distances(places(solid)), solid.health()
    assert (rms(error) < mean, np.abs(error).max() < most) == (True, True)
    assert is_closed(solid, 1e-3 * solid.surface.size)
    flags = ("unused", "pose_blocks", "stretched")
    assert [health[f"radial_{name}"] for name in flags] == [0.0, 0.0, 0.0]
    assert 0.6 * len(touched.points) < health["radial_points"] <= len(touched.points)
    assert health["sigma"] == health["radial_sigma"] < 1e-5
    assert 1.0 < health["condition"] == health["radial_condition"] < 1e10
    uncertainty = solid.uncertainty()
    assert uncertainty is not None
    assert 0.0 < uncertainty.rms < uncertainty.most < 2e-3
    assert 0.499 * health["radial_untouched_gap"] < uncertainty.resolution < 2e-3


@pytest.mark.parametrize("shares", [[0.4], slow([-0.8, 0.0, 0.8])])
def test_few_contours_give_closed_solid_on_platform(shares):
    solid = Oracle(*BALL).rebuilt(shares)
    assert is_closed(solid, 1e-3 * solid.surface.size)
    assert solid.surface.at(0.0, 0.0)[2] == pytest.approx(0.0, abs=1e-6)
    assert places(solid)[:, 2].max() == pytest.approx(0.06, abs=2e-4)
    high = Oracle([0.03, 0.03, 0.4], [1.0, 1.0]).rebuilt(shares, top=False)
    assert high.health()["radial_stretched"] == (len(shares) == 1)
    if len(shares) == 3:  # an untouched wall may extend by the spacing of the contours
        wall = Oracle([0.025, 0.025, 0.04], [0.05, 1.0]).rebuilt(shares, top=False)
        assert wall.uncovered == (0.0, pytest.approx(0.8 * 0.04, rel=0.01))


@pytest.mark.parametrize("scale", [slow(1e-3), 1e3])
def test_solid_of_scaled_contacts_is_scaled_solid(scale):
    unit, other = (Oracle(*EGG, scale=each).rebuilt(SEVEN) for each in (1.0, scale))
    assert np.allclose(places(other) / scale, places(unit), rtol=0, atol=1e-8)
    assert deviation_of(other) == pytest.approx(scale * deviation_of(unit), rel=1e-3)


@pytest.mark.parametrize("method", [slow("skin"), "draft"])
def test_order_of_contours_and_touches_changes_nothing(method):
    rings, touched, tops = Oracle(*BALL).evidence(SEVEN)
    shuffled = objects.only(touched, np.random.default_rng(1).permutation(len(touched.points)))
    ordered = reconstruct(rings, patches=touched, tops=tops, method=method)
    other = reconstruct(rings[::-1], patches=shuffled, tops=tops, method=method)
    assert np.allclose(places(ordered), places(other), rtol=0, atol=1e-12)
    assert rms(Oracle(*BALL).distances(places(ordered))) < 5e-6


@pytest.mark.parametrize("case", ["kidney", "kidney without normals", "few points"])
def test_contours_give_side_where_contacts_do_not_suffice(case):
    if case == "few points":
        rings, touched, tops = Oracle(*BALL).evidence(NINE)
        touched = objects.only(touched, slice(50))
    else:  # a thick arc, which no place sees whole
        out = objects.polar(np.linspace(0.15, 2 * np.pi - 0.15, 120) / (2 * np.pi), 1.0)
        plane = np.concatenate([0.04 * out, 0.025 * out[::-1]])
        rings = [at_height(plane, z) for z in np.linspace(0.01, 0.05, 5)]
        normals = np.tile(at_height(np.concatenate([out, -out[::-1]]), 0.0), (5, 1))
        touched = contacts(np.concatenate(rings), normals if case == "kidney" else None)
        tops = np.array([[0.03, 0.0, 0.0], [0.03, 0.0, 0.06]])
    solid = reconstruct(rings, patches=touched, tops=tops, method="skin")
    assert solid.health()["radial_unused"] == 1.0
    if case != "few points":
        alone = reconstruct(rings, tops=tops, method="skin")
        assert np.array_equal(places(solid), places(alone))


@pytest.mark.parametrize("arc", [0.0, slow(2e-3), slow(8e-3)])
def test_edge_rounded_by_arc_is_rebuilt(arc):
    """A column of 30 mm radius, 90 mm high, whose upper edge is an arc."""
    steps = 30_000
    length = np.cumsum([0.0, 0.09 - arc, 0.5 * np.pi * arc, 0.03 - arc])
    at = length[-1] * (np.arange(steps) + 0.5) / steps
    on_side, on_top = at < length[1], at >= length[2]
    angle = np.clip((at - length[1]) / max(arc, 1e-12), 0.0, 0.5 * np.pi)
    radius = np.where(on_top, 0.03 - arc - (at - length[2]), 0.03 - arc + arc * np.cos(angle))
    heights = np.where(on_side, at, 0.09 - arc + arc * np.sin(angle))
    lean = np.where(on_top, 0.5 * np.pi, angle)
    out = objects.polar(0.618034 * np.arange(steps), 1.0)
    normals = np.column_stack([out * np.cos(lean)[:, None], np.sin(lean)])
    points = np.column_stack([radius[:, None] * out, heights])
    touched = contacts(points, normals, np.arange(steps) // 100)
    rings = [at_height(0.03 * circle(60), z) for z in np.linspace(0.004, 0.078, 8)]
    touched = objects.only(touched, ~on_top | (radius < 0.012))
    solid = reconstruct(rings, patches=touched, tops=ends(0.0, 0.09), method="skin")
    off = solid.signed_distance(points[37::97])
    assert rms(off) < 2e-5 and np.abs(off).max() < 0.15e-3
    dish = np.pi * (2.0 * arc**3 / 3.0 + 0.5 * np.pi * arc**2 * (0.03 - arc))
    volume = np.pi * (0.03**2 * (0.09 - arc) + (0.03 - arc) ** 2 * arc) + dish
    assert solid.volume == pytest.approx(volume, rel=5e-4)


@pytest.mark.parametrize("shape", [BOX, slow(EGG)])
def test_stated_deviation_has_size_of_error(shape):
    true = Oracle(*shape)
    rings, touched, tops = true.evidence(SEVEN)
    touch = 120 * np.arange(len(touched.points)) // len(touched.points)
    shifts = 1e-4 * np.random.default_rng(0).normal(size=(120, 3))  # of each touch
    noisy = contacts(touched.points + shifts[touch], touched.normals, touch)
    solid = reconstruct(rings, patches=noisy, tops=tops, method="skin")
    error = rms(true.distances(solid.mesh(5e-4).vertices))
    assert 0.4 * error < deviation_of(solid) < 4.0 * error
    assert error < 2.5e-4  # The corners of the box are sharper than the spline


def ends(low: float, high: float) -> Floats:
    return np.array([[0.0, 0.0, low], [0.0, 0.0, high]])


def column(scale: float = 1.0, count: int = 10) -> list[Floats]:
    """Contours of an elliptic column."""
    plane = circle(80) * [0.03, 0.02]
    return [scale * at_height(plane, z) for z in np.linspace(-0.045, 0.045, count)]


def test_untouched_ends_increase_stated_deviation():
    both, upper, none = (
        deviation_of(reconstruct(column(), tops=tops, method="skin"))
        for tops in (ends(-0.05, 0.05), ends(-0.05, 0.05)[1:], None)
    )
    assert 5.0 * both < upper < none
    # The end, a seventh of the surface, may extend by 10 mm, with equal probability of all heights.
    assert 2e-3 < none < 4e-3
    away = [0.046, 0.048, 0.052, 0.06]  # the farther the last contour, the more is hidden
    stated = [deviation_of(reconstruct(column(), tops=ends(-z, z), method="skin")) for z in away]
    assert stated == sorted(stated)
    assert stated[-1] > 5.0 * stated[0]


def squarish_ball(count: int, corner: float) -> list[Floats]:
    """Contours of a ball, squarer with a larger exponent."""
    rim = circle(24) * (np.abs(circle(24)) ** corner).sum(axis=1, keepdims=True) ** (-1.0 / corner)
    heights = np.linspace(0.0, 1.0, count)
    radii = 0.3 * np.sqrt(1.02 - (2.0 * heights - 1.0) ** 2)
    return [at_height(radius * rim, z) for radius, z in zip(radii, heights, strict=True)]


@pytest.mark.parametrize("method", ["skin", "lattice"])
def test_far_end_is_separate_piece_where_side_would_invert(method):
    tops = [[0, 0, -0.2], [0, 0, 1.2]]
    solid = reconstruct(squarish_ball(4, 20.0), tops=tops, method=method)
    assert solid.health()["apart_below"] + solid.health()["apart_above"] >= 1.0
    assert solid.check()[:4] == (True, True, 0, 0)
    heights = solid.mesh().vertices[:, 2]
    assert (heights.min(), heights.max()) == pytest.approx((-0.2, 1.2), abs=1e-9)
    near = reconstruct(squarish_ball(9, 2.0), tops=[[0, 0, -5e-3], [0, 0, 1.005]], method=method)
    assert (near.health()["apart_below"], near.health()["apart_above"]) == (0.0, 0.0)


RADIUS, HEIGHT = 0.02, 0.08  # Of the column with an oblique top; its height is that of the axis [m]
SLOPES = np.array([0.25, 0.1])


def top_at(plane: Floats) -> Floats:
    return np.asarray(HEIGHT + plane @ SLOPES)


@cache
def column_touches() -> ContactPoints:
    """Rings of touches around the side, up to its edge, and five of the oblique top."""
    rng = np.random.default_rng(0)
    parts = []
    for level in np.linspace(0.003, 0.083, 27):
        for turn in np.arange(24) / 24:
            out = objects.polar(turn + rng.uniform(-0.02, 0.02, 12), 1.0)
            heights = level + rng.uniform(-3e-3, 3e-3, 12)
            beside = (heights < top_at(RADIUS * out)) & (heights > 0.0)
            if beside.sum() > 2:
                points = np.column_stack([RADIUS * out, heights])
                parts.append(objects.only(contacts(points, at_height(out, 0.0)), beside))
    upward = np.array([-SLOPES[0], -SLOPES[1], 1.0]) / math.sqrt(1.0 + SLOPES @ SLOPES)
    for place in ((0.0, 0.0), (0.01, 0.0), (-0.01, 0.0), (0.0, 0.01), (0.0, -0.01)):
        at = place + 1e-3 * np.stack(np.meshgrid(*2 * (np.arange(-3, 4),)), axis=-1).reshape(-1, 2)
        parts.append(contacts(np.column_stack([at, top_at(at)]), np.tile(upward, (49, 1))))
    return stack_points(parts)


def column_rings() -> list[Floats]:
    return [at_height(RADIUS * circle(48), z) for z in np.linspace(0.005, 0.07, 8)]


@cache
def oblique() -> LatticeSolid:
    return reconstruct(column_rings(), patches=column_touches(), tops=np.zeros((1, 3)))


def oblique_points() -> Floats:
    """Points of the true column: side and top, up to 0.5 mm from their edge."""
    rng = np.random.default_rng(1)
    out = objects.polar(rng.random(600), 1.0)
    side = np.column_stack([RADIUS * out, rng.uniform(5e-4, top_at(RADIUS * out) - 5e-4)])
    inside = (RADIUS - 5e-4) * np.sqrt(rng.uniform(size=(600, 1))) * out
    return np.concatenate([side, np.column_stack([inside, top_at(inside)])])


STEEP = float(np.hypot(*SLOPES))


def test_oblique_top_is_as_accurate_as_level_top():
    assert np.abs(oblique().search().nearest(oblique_points()).distances).max() < 2e-5
    assert oblique().health()["slope_above"] == pytest.approx(STEEP, rel=1e-3)
    assert oblique().health()["slope_below"] == pytest.approx(0.0, abs=1e-3)
    assert oblique().volume == pytest.approx(math.pi * RADIUS**2 * HEIGHT, rel=1e-3)
    assert oblique().check()[:4] == (True, True, 0, 0)


@pytest.mark.slow
def test_control_lattice_and_refinement_follow_sheared_ends():
    lattice = oblique().control_lattice
    assert lattice is not None and oblique().lattice is not None
    assert lattice.undeformed is oblique().lattice.lattice.undeformed
    local = oblique().lattice.prism.points(np.random.default_rng(0).random((50, 3)))
    straight = oblique().lattice.lattice.deform(local)
    expected = straight[:, 2] + straight[:, :2] @ SLOPES * straight[:, 2] / HEIGHT
    assert lattice.deform(local)[:, 2] == pytest.approx(expected, abs=5e-5)
    point = np.array([[RADIUS + 1e-3, 0.0, 0.04]])
    assert abs(oblique().refined(point).search().nearest(point).distances[0]) < 1e-6
    with pytest.raises(ValueError, match="points must lie beside the object"):
        oblique().refined([[-0.4, -0.1, 0.04]])


@pytest.mark.parametrize("change", ["moved", slow("updated"), slow("mirrored")])
def test_oblique_top_survives_update_motion_and_mirror(change):
    solid, true = oblique(), oblique_points()
    if change == "updated":
        again = tree_from_arrays(tree_to_arrays(solid))
        assert np.array_equal(*map(tree_to_bytes, (solid, again)))
        more = again.update(column_rings()[3] + [0.0, 0.0, 1e-3])
        assert np.abs(more.search().nearest(true).distances).max() < 2e-5
    elif change == "moved":
        turn = rotations_from_vectors(np.array([[0.3, -0.5, 0.2]]))[0]
        pose = Pose(np.array([0.1, -0.2, 0.3]), turn).array
        rebuilt = rebuilt_as(Pose.from_array(pose).to_outer, turn, frame=pose)
        v, turns = np.linspace(0.0, 1.0, 21), np.linspace(0.0, 1.0, 21)
        expected = Pose.from_array(pose).to_outer(solid.surface.at(v, turns))
        assert rebuilt.surface.at(v, turns) == pytest.approx(expected, abs=1e-9)
    else:  # mirrored, with an upper end of which only the height is known
        mirror = np.diag([1.0, 1.0, -1.0])
        rebuilt = rebuilt_as(lambda points: points @ mirror, mirror)
        assert rebuilt.uncovered[1] == 0.0
        assert rebuilt.health()["slope_below"] == pytest.approx(STEEP, rel=1e-3)
        assert np.abs(rebuilt.search().nearest(true @ mirror).distances).max() < 2e-5


def rebuilt_as(moved: Callable[[Floats], Floats], turn: Floats, **more: Any) -> LatticeSolid:
    """The column from moved contacts."""
    touched = column_touches()
    there = touched._replace(
        points=moved(touched.points), normals=np.asarray(touched.normals) @ turn.T
    )
    tops = moved(np.zeros((1, 3)))
    return reconstruct([moved(one) for one in column_rings()], patches=there, tops=tops, **more)
