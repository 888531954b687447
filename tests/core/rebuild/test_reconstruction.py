"""Solids of contours: true shapes, invariances, updates, archives, refusals."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from palpate.core.archive import tree_from_arrays, tree_to_arrays, tree_to_bytes
from palpate.core.arrays import Floats
from palpate.core.geometry import solidity
from palpate.core.poses import IDENTITY_POSE, Pose
from palpate.core.rebuild import LatticeSolid, Method, fit_coarse, reconstruct
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.recovery import Recovery
from palpate.core.shapes import Bend, area_samples, sampled_surface
from palpate.core.splines import SplineVolume
from tests.core.rebuild.objects import Oracle, at_height, circle, column, slow

SLOW = [slow(method) for method in ("thesis", "coarse")]
POSE = np.concatenate([[0.03, -0.2, 0.05], np.array([0.1, -0.5, 0.5, 0.7])])
SIZE = 0.1  # Of the lobed egg [m]
HEIGHTS = np.linspace(-0.047, 0.045, 11)
TOPS = np.array([[0.0, 0.0, -0.05], [0.002, 0.0, 0.05]])
V, TURNS = np.linspace(0.0, 1.0, 41)[:, None], np.arange(31)[None] / 31
AXES = np.array([50.0, 40.0, 30.0])  # Of the ellipsoid; lengths have no unit here


def egg_ring(z: float, count: int = 60) -> Floats:
    """A contour of a lobed egg that wanders sideways."""
    turn = 2 * np.pi * np.arange(count) / count
    radius = 0.03 * np.sqrt(1.001 - (z / 0.05) ** 2) * (1 + 0.08 * np.cos(3 * turn + 20 * z))
    plane = radius[:, None] * circle(count) * [1.0, 0.8] + [0.1 * z, 0.0]
    return at_height(plane, z)


EGG = [egg_ring(z, 50 + i) for i, z in enumerate(HEIGHTS)]


def ellipsoid(heights: Floats, count: int = 48) -> list[Floats]:
    shares = np.sqrt(1.0 - (heights / AXES[2]) ** 2)
    pairs = zip(shares, heights, strict=True)
    return [at_height(share * AXES[:2] * circle(count), z) for share, z in pairs]


ELLIPSOID = ellipsoid(np.linspace(-29.5, 29.5, 15))


@cache
def upright(method: Method = "lattice") -> LatticeSolid:
    return reconstruct(EGG, tops=TOPS, method=method)


@cache
def tilted(method: Method = "lattice") -> LatticeSolid:
    return reconstruct([moved(one) for one in EGG], tops=moved(TOPS), method=method, frame=POSE)


def moved(points: Floats) -> Floats:
    return Pose.from_array(POSE).to_outer(points)


def rotated(normals: Floats) -> Floats:
    return normals @ Pose.from_array(POSE).axes.T


def places(solid: LatticeSolid) -> Floats:
    return solid.surface.at(V, TURNS).reshape(-1, 3)


def apart(first: LatticeSolid, second: LatticeSolid) -> float:
    return float(np.abs(places(first) - places(second)).max())


def apart_moved(first: LatticeSolid, second: LatticeSolid) -> float:
    """Largest distance of the first solid, moved, from the second, over the size."""
    return float(np.abs(moved(places(first)) - places(second)).max()) / SIZE


@pytest.mark.parametrize(
    ("method", "faithful", "off"),
    [
        ("lattice", False, 2e-4),
        ("skin", False, 2e-4),
        ("draft", False, 2e-4),
        ("thesis", False, 0.06),  # it closes with cones
        slow("thesis", True, None),  # its volume is wrong
        ("coarse", False, 1e-6),
    ],
)
def test_every_method_gives_closed_solid_of_true_volume(method, faithful, off):
    solid = reconstruct(ELLIPSOID, method=method, faithful=faithful)
    mesh = solid.mesh()
    body = solidity(mesh.vertices, mesh.faces)
    assert (solid.method, body.watertight, body.genus) == (method, True, 0)
    if off is not None:
        assert solid.volume == pytest.approx(4 / 3 * np.pi * AXES.prod(), rel=off)
    assert solid.search().inside(np.zeros((1, 3))).all()
    health = solid.health()
    assert all(np.isfinite(value) for value in health.values())
    if method == "thesis":
        assert (health["widest_gap"] > 0.01) == faithful
    if method == "coarse":
        assert health["rms"] < 1e-9
    heights, turns = np.linspace(-20.0, 20.0, 5), np.arange(4) / 4
    stated = (solid.uncertainty(), solid.whole_deviation(), solid.deviation(heights, turns))
    if method in ("thesis", "coarse"):
        assert stated == (None, None, None)
    else:
        assert stated[0].most > stated[0].rms > 0.0
        assert stated[2].shape == (5, 4) and (stated[2] >= 0.0).all()


@pytest.mark.parametrize(("scale", "offset"), [(1e-9, 0.0), slow(1e3, 1e3)])
def test_unit_and_position_do_not_change_solid(scale, offset):
    contours = [scale * one + offset for one in EGG]
    solid = reconstruct(contours, tops=scale * TOPS + offset)
    off = (places(solid) - offset) / scale - places(upright())
    assert np.abs(off).max() < 1e-6 * SIZE
    assert solid.volume / scale**3 == pytest.approx(upright().volume, rel=1e-6)
    stated, usual = (one.whole_deviation() for one in (solid, upright()))
    assert stated.whole == pytest.approx(scale * usual.whole, rel=1e-5)


def test_order_direction_start_and_repeated_points_do_not_change_solid():
    framed = reconstruct(EGG, tops=TOPS, method="skin", frame=IDENTITY_POSE)
    assert framed.frame is None
    assert np.array_equal(*map(tree_to_bytes, (framed, upright("skin"))))
    rolled = [np.roll(one, 7 * i, axis=0)[:: 1 - 2 * (i % 2)] for i, one in enumerate(EGG)]
    doubled = [np.repeat(one, 2, axis=0) for one in EGG]
    closed = [np.vstack([one, one[:1]]) for one in EGG]
    spoilt = [np.insert(one, 5, [np.nan, 0.0, np.inf], axis=0) for one in EGG]
    for contours in (rolled[::-1], doubled, closed, spoilt):
        solid = reconstruct(contours, tops=TOPS, method="skin")
        assert apart(solid, upright("skin")) < 1e-12 * SIZE


@pytest.mark.parametrize("method", ["lattice", "skin", *SLOW])
def test_solid_of_moved_contours_is_moved_solid(method):
    still, other = upright(method), tilted(method)
    # A superquadric is fitted by iterations that end at a cosine of 1e-9.
    assert apart_moved(still, other) < (1e-10 if method == "coarse" else 1e-12)
    assert other.uncovered == pytest.approx(still.uncovered, abs=1e-12)
    assert still.frame is None
    assert np.array_equal(np.array(other.frame), POSE)
    rng = np.random.default_rng(0)
    v, turns = rng.uniform(0.1, 0.9, (2, 50))
    before, after = (each.surface.curvatures(v, turns).k1 for each in (still, other))
    normals = still.surface.normals(v, turns)
    assert other.surface.normals(v, turns) == pytest.approx(rotated(normals), abs=1e-9)
    assert after == pytest.approx(before, rel=1e-6, abs=1e-6 / SIZE)
    if method == "thesis":
        inside, old, new = rng.random((20, 3)), still.control_lattice, other.control_lattice
        for here, there in ((old.volume, new.volume), (old.undeformed, new.undeformed)):
            assert isinstance(there, SplineVolume)
            assert there.at(inside) == pytest.approx(moved(here.at(inside)), abs=1e-12)


@pytest.mark.slow
def test_measures_distances_and_deviations_move_with_solid():
    base, other = upright(), tilted()
    before, after = base.measures(), other.measures()
    assert after.area_m2 == pytest.approx(before.area_m2, rel=1e-12)
    assert after.volume_m3 == pytest.approx(before.volume_m3, rel=1e-12)
    # Quadrature along the world's axes has another error.
    assert after.centroid_m == pytest.approx(moved(before.centroid_m[None])[0], abs=1e-6 * SIZE)
    points = 0.03 * np.random.default_rng(0).normal(size=(40, 3))
    near, there = base.search().nearest(points), other.search().nearest(moved(points))
    assert there.distances == pytest.approx(near.distances, abs=1e-9)
    assert there.points == pytest.approx(moved(near.points), abs=1e-9)
    heights, turns = np.linspace(-0.04, 0.04, 5), np.arange(4) / 4
    stated = base.deviation(heights, turns)
    assert other.deviation(heights, turns) == pytest.approx(stated, rel=1e-6)
    assert other.slices.heights == pytest.approx(base.slices.heights, abs=1e-14)


@pytest.mark.parametrize("evidence", ["contacts", slow("normals"), slow("grasp")])
def test_contacts_normals_and_grasp_move_with_frame(evidence):
    true = Oracle([0.03, 0.02, 0.045], [1.0, 1.0])
    rings, touched, tops = true.evidence(np.linspace(-0.9, 0.9, 7))
    here: dict[str, Any] = {"method": "skin", "tops": tops}
    there: dict[str, Any] = {"method": "skin", "tops": moved(tops), "frame": POSE}
    if evidence == "contacts":
        normals = rotated(np.asarray(touched.normals))
        here["patches"] = touched
        there["patches"] = ContactPoints(moved(touched.points), normals, touched.touch)
    elif evidence == "normals":
        across = [np.asarray(true.contacts_at(still).normals).copy() for still in rings]
        across[2][7] = np.nan  # not measured
        here["normals"], there["normals"] = across, [rotated(each) for each in across]
    else:
        grasp = reconstruct(rings, method="coarse").model
        assert isinstance(grasp, Recovery)
        here |= {"grasp": grasp, "method": "lattice"}
        pose = (Pose.from_array(POSE) @ Pose.from_array(grasp.pose)).array
        there |= {"grasp": replace(grasp, pose=pose), "method": "lattice"}
    still = reconstruct(rings, **here)
    other = reconstruct([moved(each) for each in rings], **there)
    assert still.health().get("radial_unused", 0.0) == 0.0
    assert apart_moved(still, other) < (1e-9 if evidence == "grasp" else 1e-12)
    stated, usual = other.whole_deviation(), still.whole_deviation()
    assert stated.whole == pytest.approx(usual.whole, rel=1e-6)


@pytest.mark.parametrize("method", ["lattice", "skin", *SLOW])
def test_archived_solid_is_read_back_bit_for_bit(method):
    back = tree_from_arrays(tree_to_arrays(tilted(method)))
    assert np.array_equal(*map(tree_to_bytes, (back, tilted(method))))
    assert np.array_equal(places(back), places(tilted(method)))
    assert np.array_equal(back.mesh().vertices, tilted(method).mesh().vertices)


def test_control_lattices_are_in_world_frame():
    inside = np.random.default_rng(1).random((20, 3))
    still, there = upright(), tilted().control_lattice
    assert still.lattice is not None and there is not None
    assert still.control_lattice is still.lattice.lattice
    local = still.lattice.prism.points(inside)
    deformed = still.lattice.lattice.deform(local)
    assert there.deform(moved(local)) == pytest.approx(moved(deformed), abs=1e-12)
    assert upright("skin").control_lattice is None is upright("coarse").control_lattice
    point = np.array([[0.034, 0.0, 0.004], [0.0, 0.03, 0.02]])
    refined = [upright().refined(point), tilted().refined(moved(point))]
    assert apart_moved(*refined) < 1e-9
    assert np.abs(refined[1].search().nearest(moved(point)).distances).max() < 1e-6 * SIZE


@pytest.mark.parametrize("method", ["skin", slow("lattice")])
def test_updated_solid_equals_solid_of_all_contours(method):
    noise = 2e-4 * np.random.default_rng(0).normal(size=(11, 60, 3))
    contours = [one + noise[i, : len(one)] for i, one in enumerate(EGG)]
    contours[4][7, :2] *= 1.1  # an outlier
    at_once = reconstruct([*contours, contours[4]], tops=TOPS, method=method)
    updated = reconstruct(contours[:-1], tops=TOPS, method=method).update(contours[-1])
    updated = updated.update(contours[4])
    assert apart(updated, at_once) == 0.0
    assert updated.health() == at_once.health()
    assert updated.slices.rows.tolist() == at_once.slices.rows.tolist()
    other = reconstruct(contours[:0:-1], tops=TOPS, method=method).update(contours[0])
    assert apart(other, at_once) < 1e-12 * SIZE


def test_solid_is_updated_by_plane_framed_and_useless_contours():
    planes = [one[:, :2] for one in EGG]
    most = reconstruct(planes[1:], heights=HEIGHTS[1:], tops=TOPS, method="skin")
    whole_again = most.update(planes[0], height=HEIGHTS[0])
    assert apart(whole_again, upright("skin")) < 1e-12 * SIZE
    useless = upright("skin").update(np.zeros((2, 3)))
    assert useless.slices.dropped[-1].which == 11
    assert apart(useless, upright("skin")) == 0.0
    later = reconstruct([moved(one) for one in EGG[:-1]], tops=moved(TOPS), frame=POSE)
    assert np.array_equal(places(later.update(moved(EGG[-1]))), places(tilted()))
    with pytest.raises(ValueError, match="heights must be left out with a frame"):
        later.update(EGG[3][:, :2], height=0.0)
    with pytest.raises(ValueError, match=r"contour 10 must have shape \(any, 3\)"):
        later.update(np.zeros((4, 2)))
    bare = LatticeSolid(surface=later.surface, method="skin", evidence=later.evidence)
    with pytest.raises(ValueError, match="solid must be rebuilt by reconstruct to be updated"):
        bare.update(EGG[0])


@pytest.mark.slow
def test_coarse_fit_tapers_and_bends_only_if_points_do():
    rng, true = np.random.default_rng(3), Oracle([30.0, 20.0, 50.0], [0.6, 0.9])
    base = true.shape
    plain = area_samples(sampled_surface(base), 200, rng)
    narrowing = np.array([-0.3, -0.2])
    tapered = area_samples(sampled_surface(base, taper=narrowing), 200, rng)
    straight = fit_coarse(plain + 0.1 * rng.normal(size=plain.shape))
    assert "taper x" not in straight.names
    assert straight.size == pytest.approx(base.size, rel=0.01)
    assert fit_coarse(tapered).taper == pytest.approx(narrowing, abs=1e-3)
    ball = 30.0 * plain / np.linalg.norm(plain, axis=1, keepdims=True)
    narrowed = ball * (1.0 + 0.01 * ball[:, 2:]) ** [1, 1, 0]
    assert not fit_coarse(ball, noise=0.1).taper.any()
    assert fit_coarse(narrowed, noise=0.1).taper.any()
    shares = np.linspace(-0.9, 0.9, 11)
    rings = [true.section(share) * [1 - 0.3 * share, 1 - 0.2 * share, 1] for share in shares]
    solid = reconstruct(rings, method="coarse")
    points = places(solid) - true.middle
    points[:, :2] /= 1 - np.outer(points[:, 2] / 50.0, [0.3, 0.2])
    assert np.abs(base.gauge(points) - 1.0).max() < 1e-4
    bent = Bend(0.005, 0.7)(plain)
    assert fit_coarse(bent).bend.curvature == pytest.approx(0.005, rel=0.01)


def test_steps_are_named_in_order():
    named: list[str] = []

    @contextmanager
    def step(name: str) -> Iterator[None]:
        named.append(name)
        yield
        named.append("/" + name)

    solid = reconstruct(EGG, tops=TOPS, step=step)
    inner = "cross-validation ends /ends /cross-validation"
    assert " ".join(named) == f"contours /contours {inner} lattice /lattice"
    assert apart(solid, upright()) == 0.0


EIGHT = np.column_stack([np.sin(a := 2 * np.pi * np.arange(60) / 60), np.sin(2 * a), 0 * a])
LINE = np.outer(np.arange(6.0), [1.0, 2.0, 0.0])
SPAN = "contours and tops must span from 1e-50"


@pytest.mark.parametrize(
    ("contours", "options", "sentence"),
    [
        ([], {}, "contours must be at least one, got none"),
        (["abc"], {}, "contour 0 must be an array of real numbers"),
        ([[[0, 0, 0], [1, 1]]], {}, "contour 0 must be an array of real numbers"),
        ([np.zeros((4, 2))], {}, "contour 0 must have shape (any, 3), got (4, 2)"),
        ([np.full((9, 3), np.nan)], {}, "contours must hold at least one of 3 points"),
        ([np.zeros((5, 3)), LINE[:2]], {}, "got contour 0: in one place; contour 1: too few"),
        (column(1), {}, "contours must leave at least 2 to rebuild from, or 1 with tops"),
        (column(1), {"tops": [[0, 0, 50.0]]}, "or 1 with tops that touched both ends, got 1"),
        ([ELLIPSOID[7], 0.5 * ELLIPSOID[7]], {}, "contour 1: inside another at its height"),
        ([1e-300 * one for one in column(4)], {}, SPAN),
        ([1e60 * one for one in column(4)], {}, SPAN),
        (column(4), {"tops": [[0.0, 0.0, 1e300]]}, SPAN),
        ([EIGHT, EIGHT + [0.0, 0.0, 1.0]], {}, "contours must run around an area"),
        (column(4), {"tops": [[0.0, 0.0]]}, "tops must have shape"),
        (column(4), {"tops": [[0.0, 0.0, np.nan]]}, "tops must be finite"),
        (column(4), {"tops": "up"}, "tops must be an array of real numbers"),
        (column(9), {"tops": [[0, 0, 20.0]]}, "tops must not lie within the contours, got 20"),
        (column(4), {"noise": "a"}, "noise must be an array of real numbers"),
        (column(4), {"noise": 0.0}, "noise must be positive"),
        (EGG, {"method": "loft"}, "method must be one of lattice, skin, draft, thesis, coarse"),
        (EGG, {"method": "skin", "faithful": True}, "faithful goes with the method 'thesis'"),
        (EGG, {"method": "skin", "grasp": 1}, "size and grasp must be left out"),
        (
            [*ELLIPSOID[:3], *ellipsoid(np.array([10.0]), 40)],
            {"method": "thesis", "faithful": True},
            "contours must have as many points each, got 40 to 48",
        ),
        (ELLIPSOID[7:8], {"method": "coarse"}, "a superquadric, got coplanar points"),
        (EGG, {"patches": 3}, "patches must be ContactPoints("),
        (EGG, {"frame": np.zeros(6)}, "frame must have shape (7), got (6,)"),
        (EGG, {"frame": np.zeros(7)}, "a rotation must be a quaternion of length 1, got length 0"),
        (
            [one[:, :2] for one in EGG],
            {"frame": POSE, "heights": HEIGHTS},
            "heights must be left out with a frame, for contours are then points of the world",
        ),
        (EGG[:1], {"heights": [0.0]}, "contour 0 must have shape (any, 2), got (50, 3)"),
        ([EGG[0][:, :2]], {"heights": [0.0, 1.0]}, "heights must have shape (1), got (2,)"),
        (EGG, {"normals": EGG[:2]}, "normals must be as many as the 11 contours, got 2"),
        (EGG[:1], {"normals": [EGG[0][:5]]}, "normals of contour 0 must have shape (50, 3)"),
        *(
            (ELLIPSOID, {"size": size}, "size must be two whole numbers, from 4 to 64 across")
            for size in [(6,), (3, 12), (12, 3), (65, 12), (8, 8.0), "ab", (16, 520)]
        ),
    ],
)
def test_reconstruct_rejects_invalid_arguments(contours, options, sentence):
    with pytest.raises(ValueError, match=re.escape(sentence)):
        reconstruct(contours, **options)


def test_refinement_and_coarse_fit_reject_invalid_arguments():
    with pytest.raises(ValueError, match="method must be lattice for a solid to be refined"):
        upright("skin").refined([[0.0, 0.0, 0.0]])
    for points, sigma, words in (
        ([[0.0, np.nan, 0.0]], None, "points must be finite"),
        ([[0.0, 0.0]], None, "points must have shape"),
        ([[0.0, 0.0, 0.06]], 0.0, "sigma must be positive"),
    ):
        for solid in (upright(), tilted()):
            with pytest.raises(ValueError, match=words):
                solid.refined(points, sigma=sigma)
    with pytest.raises(ValueError, match="noise must be positive"):
        fit_coarse(np.eye(3), noise=-1.0)
