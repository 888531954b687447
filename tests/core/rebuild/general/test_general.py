"""Laws of the general solid: genus, closedness, platform, prediction, updates."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from palpate.core.archive import tree_to_arrays
from palpate.core.arrays import Floats
from palpate.core.geometry import solidity
from palpate.core.poses import Pose, rotations_from_vectors
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.general import (
    DEFAULT_GENERAL,
    GeneralSolid,
    oriented,
    protrusions,
    rebuild_general,
)
from palpate.core.rebuild.general.band import basis_rows, cell_integrals
from palpate.core.rebuild.general.fitting import Start, TouchedPoints, fit_implicit
from palpate.core.rebuild.general.leave_out import LeaveOutSettings, leave_out
from palpate.core.rebuild.general.rebuilding import least_cell
from palpate.core.rebuild.general.solid import cell_weights
from tests.core.rebuild.objects import contacts, only, rms

RADIUS, TUBE = 0.028, 0.011  # of a torus [m]
CELL = 5.0e-3


def torus_distance(points: Floats) -> Floats:
    return np.hypot(np.hypot(points[:, 0], points[:, 1]) - RADIUS, points[:, 2]) - TUBE


@cache
def torus_touches(seed: int = 0, pose: float = 0.0) -> ContactPoints:
    """Patches of 30 points all over a torus, each touch displaced."""
    rng = np.random.default_rng(seed)
    count = 90
    u = 2.0 * np.pi * (np.arange(count) * 0.618 % 1.0)[:, None]
    u = u + 0.12 * rng.normal(size=(count, 30))
    v = 2.0 * np.pi * (np.arange(count) / count)[:, None] + 0.35 * rng.normal(size=(count, 30))
    normals = np.stack([np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)], axis=-1)
    middles = RADIUS * np.stack([np.cos(u), np.sin(u), 0.0 * u], axis=-1)
    points = middles + TUBE * normals + pose * rng.normal(size=(count, 1, 3))
    touch = np.repeat(np.arange(count), 30)
    return contacts(points.reshape(-1, 3), normals.reshape(-1, 3), touch)


@cache
def torus() -> GeneralSolid:
    return rebuild_general(torus_touches(), cell=CELL, pose=1e-5)


def error(solid: GeneralSolid, parts: int = 2) -> float:
    """Root mean square distance of a solid's vertices from the torus [m]."""
    return rms(torus_distance(solid.mesh(parts).vertices))


def test_a_torus_keeps_its_hole_and_is_closed():
    mesh = torus().mesh()
    body = solidity(mesh.vertices, mesh.faces)
    assert body.watertight and body.genus == 1
    assert torus().check() == (True, True, 1, 0, 0)
    assert error(torus()) < 3e-5
    # Vertices lie on the surface, and distances have signs.
    value, gradient = torus().evaluate(mesh.vertices)
    assert np.nanmax(np.abs(value)) < 2e-5 and np.nanmin(np.linalg.norm(gradient, axis=1)) > 0.5
    places = np.array([[RADIUS, 0.0, 0.0], [0.0, 0.0, 0.0], [RADIUS + TUBE + 0.004, 0.0, 0.0]])
    assert torus().signed_distance(places) == pytest.approx(torus_distance(places), abs=2e-4)


def test_touches_of_a_later_placement_are_moved_together_to_where_they_fit():
    """Every other touch was made after the torus was turned, and is half a degree off since."""
    touched = torus_touches(2, 1e-4)
    placement = (np.arange(90) % 2).astype(np.int32)
    later = placement[touched.touch] == 1
    turn = rotations_from_vectors(np.array([[0.006, -0.008, 0.0]]))[0]
    off = Pose(np.array([0.2e-3, -0.1e-3, 0.3e-3]), turn)
    points = np.where(later[:, None], off.to_outer(touched.points), touched.points)
    normals = np.where(later[:, None], touched.normals @ turn.T, touched.normals)
    moved = ContactPoints(points, normals, touched.touch)
    found = rebuild_general(moved, cell=CELL, pose=1e-4, placement=placement)
    alone = rebuild_general(moved, cell=CELL, pose=1e-4)
    assert error(found) < 0.8 * error(alone) and len(found.motions) == 1
    before, after = (
        rms(torus_distance(one.to_outer(touched.points[later])))
        for one in (off, found.motions[0] @ off)
    )
    assert after < 0.6 * before
    one_more = found.update(ContactPoints.of_touch(points[:30], normals[:30]), placement=1)
    assert one_more.placements_of_touches.tolist() == [*placement.tolist(), 1]


@pytest.mark.slow
def test_displaced_touches_are_put_back():
    moved = 2e-4
    touched = torus_touches(1, moved)
    plain = rebuild_general(touched, cell=CELL, pose=1e-6)
    found = rebuild_general(touched, cell=CELL, pose=moved)
    assert error(found) < error(plain) and found.health()["displacement"] > 0.5 * moved


def test_stated_errors_grow_with_distance_from_touch():
    known = torus().predicted
    assert (np.diff(known.distances) >= 0.0).all() and (np.diff(known.errors) >= 0.0).all()
    beyond = known.distances[-1] + np.array([0.0, 0.01, 0.02])
    errors, bounds = known.at(np.zeros((3, 3)), beyond)
    assert np.diff(errors) == pytest.approx(2 * [np.diff(errors)[0]]) and errors[1] > errors[0]
    assert (bounds > errors).all()
    far = (RADIUS + TUBE + np.array([0.0, 0.01, 0.02]))[:, None] * [1.0, 0.0, 0.0]
    errors, bounds = torus().expected_errors(far)
    assert (errors <= bounds).all() and errors[0] < 1e-3
    # Beyond the hull of what was touched, by all but a few millimetres.
    assert (errors[1:] > [0.005, 0.015]).all() and (errors < [0.001, 0.011, 0.021]).all()


def test_ripples_over_all_that_was_touched_are_cut_off():
    solid = torus()
    top = solid.contacts.points[solid.contacts.points[:, 2].argmax()]
    control = solid.fit.control.copy()
    away = solid.fit.band.control * solid.cell + solid.origin - top
    control[(np.linalg.norm(away[:, :2], axis=1) < 6e-3) & (away[:, 2] > -4e-3)] = -1.0
    rippled = replace(solid, fit=replace(solid.fit, control=control))
    spike = top + [[0.0, 0.0, 4.0e-3]]
    assert rippled.evaluate(spike)[0] < 0.0 < solid.evaluate(spike)[0]  # the spline has one
    mesh = rippled.plain_mesh(8)
    assert 2e-3 < protrusions(solid.contacts.points, mesh.vertices).max() < 4.3e-3


@pytest.mark.slow
def test_one_touch_more_is_nearly_the_whole_fit():
    touched = torus_touches()
    last = touched.touch == touched.touch.max()
    about = np.linalg.norm(touched.points - touched.points[last].mean(axis=0), axis=1) < 0.012
    touched = only(touched, ~np.isin(touched.touch, np.unique(touched.touch[about & ~last])))
    touched = touched._replace(touch=np.unique(touched.touch, return_inverse=True)[1])
    last = touched.touch == touched.touch.max()
    most = only(touched, ~last)
    more = ContactPoints.of_touch(touched.points[last], touched.normals[last])
    before, whole = (rebuild_general(one, cell=CELL, pose=1e-5) for one in (most, touched))
    after = before.update(more)
    values = [one.evaluate(more.points)[0] for one in (before, after, whole)]
    left, was = (float(np.abs(one - values[2]).mean()) for one in (values[1], values[0]))
    assert left < 0.3 * was
    assert len(after.fit.displacements) == len(before.fit.displacements) + 1


def test_touch_is_left_out_as_by_a_fit_without_it():
    touched = torus_touches(2, 1e-4)
    solid = rebuild_general(touched, cell=CELL, pose=1e-4)
    band, fit = solid.fit.band, solid.fit
    points = TouchedPoints(solid.contacts.points / CELL, solid.contacts.normals, touched.touch)
    terms = solid.coarse.at(band.control * CELL) / CELL, cell_weights(CELL, 1e-4)
    start = Start(fit.weights, fit.displacements)
    left = leave_out(fit_implicit(band, points, *terms, start), LeaveOutSettings(max_touches=90))
    drawn = np.random.default_rng(90).permutation(90)
    for number in range(3):
        out = points.touch == drawn[number]
        kept = Start(fit.weights[~out], fit.displacements)
        solution = fit_implicit(band, points.only(~out), *terms, kept)
        exact = leave_out(solution).solution.fit  # without conjugate gradients
        off = band.evaluate(exact.control, points.places[out])[0]
        assert np.mean(off**2) == pytest.approx(left.squares[number], rel=0.02)
    # Of touches that are displaced as the fit believes, the squares are what it expects.
    assert 0.5 < np.mean(left.squares / left.expected) < 1.5


def test_solid_that_goes_on_from_another_is_nearly_the_whole_fit():
    touched = torus_touches()
    begun = rebuild_general(only(touched, touched.touch < 36), cell=CELL, pose=1e-5)
    gone_on = rebuild_general(touched, cell=CELL, pose=1e-5, start=begun)
    assert error(gone_on, 1) < 1.2 * error(torus(), 1) < 0.5 * error(begun, 1)


def test_error_is_as_large_as_stated():
    touched = torus_touches(3, 2e-4)
    exact = rebuild_general(torus_touches(3, 1e-5), cell=CELL, pose=1e-5)
    said, unsaid = (rebuild_general(touched, cell=CELL, pose=pose) for pose in (2e-4, 5e-5))
    for solid in (exact, said):
        errors, bounds = map(rms, solid.expected_errors(solid.mesh(1).vertices))
        assert error(solid, 1) < bounds
        assert solid is exact or 0.4 * errors < error(solid, 1)
    # What touches are displaced over their poses counts everywhere.
    assert said.predicted.common < 5e-5
    assert 1e-4 < unsaid.predicted.common < 2e-4
    errors = unsaid.expected_errors(unsaid.mesh(1).vertices)[0]
    assert errors.min() >= unsaid.predicted.common


def test_errors_are_larger_where_the_surface_bends_and_said_to_be():
    rng = np.random.default_rng(1)
    middles = rng.uniform(-1.0, 1.0, (160, 1, 3))
    axis = np.abs(middles[:, 0]).argmax(axis=1)
    points = np.clip(middles + 0.12 * rng.normal(size=(160, 20, 3)), -1.0, 1.0)
    normals = np.zeros((160, 20, 3))
    side = np.sign(middles[np.arange(160), 0, axis])
    points[np.arange(160), :, axis] = side[:, None]
    normals[np.arange(160), :, axis] = side[:, None]
    half, touch = 0.02, np.repeat(np.arange(160), 20)
    cube = contacts(half * points.reshape(-1, 3), normals.reshape(-1, 3), touch)
    solid = rebuild_general(cube, cell=CELL, outward=True)
    places = solid.mesh(2).vertices
    within = np.sort(half - np.abs(places), axis=1)
    outside = np.linalg.norm(np.minimum(half - np.abs(places), 0.0), axis=1)
    true = np.where(outside > 0.0, outside, within[:, 0])
    edge, face = within[:, 1] < 2e-3, within[:, 1] > 8e-3
    expected = solid.expected_errors(places)[0]
    for errors in (true, expected):
        assert rms(errors[edge]) > 2.0 * rms(errors[face])


def test_what_stands_is_cut_off_level_at_its_platform():
    rng = np.random.default_rng(3)
    turns, heights = 2.0 * np.pi * rng.random(900), 0.002 + 0.036 * rng.random(900)
    side = np.column_stack([np.cos(turns), np.sin(turns), 0.0 * turns])
    points = 0.02 * side + np.array([0.0, 0.0, 1.0]) * heights[:, None]
    disc = 0.018 * np.sqrt(rng.random(300))
    top = disc[:, None] * side[:300] + [0.0, 0.0, 0.04]
    normals = np.concatenate([side, np.tile([0.0, 0.0, 1.0], (300, 1))])
    every = contacts(np.concatenate([points, top]), normals, np.arange(1200) // 12)
    mesh = rebuild_general(every, platform=0.0, cell=CELL, pose=1e-5).mesh()
    assert solidity(mesh.vertices, mesh.faces).watertight
    assert mesh.vertices[:, 2].min() == 0.0
    above = only(every, every.points[:, 2] > 0.012)
    solid = rebuild_general(above, platform=0.0, cell=CELL, pose=1e-5)
    at = np.array([[0.02, 0.0, z] for z in (0.03, 0.012, 0.008, 0.002, 0.0)])
    errors, bounds = solid.expected_errors(at)
    assert (bounds >= errors).all() and (np.diff(errors[1:]) > 0.0).all()
    assert errors[0] < 0.2 * errors[-1] and bounds[-1] < 0.02
    foot = mesh.vertices[mesh.vertices[:, 2] == 0.0]
    assert np.hypot(foot[:, 0], foot[:, 1]).max() == pytest.approx(0.02, abs=2e-4)


def test_solids_of_two_settings_stand_beside_each_other():
    spline = replace(DEFAULT_GENERAL.spline, cell=CELL, pose=1e-5)
    errors = replace(DEFAULT_GENERAL.errors, bound_factor=2.0 * DEFAULT_GENERAL.errors.bound_factor)
    settings = replace(DEFAULT_GENERAL, spline=spline, errors=errors)
    solid = rebuild_general(torus_touches(), settings=settings)
    assert np.array_equal(solid.mesh().vertices, torus().mesh().vertices)
    places = torus().mesh().vertices
    errors_and_bounds = torus().expected_errors(places), solid.expected_errors(places)
    (usual, bounds), (same, doubled) = errors_and_bounds
    assert np.array_equal(same, usual) and doubled == pytest.approx(2.0 * bounds)
    touch = ContactPoints.of_touch(places[:3], torus().evaluate(places[:3])[1])
    assert solid.update(touch).settings == settings != torus().settings


def test_solid_of_other_settings_is_not_stored():
    walls = replace(DEFAULT_GENERAL.walls, cell_ratio=0.5)
    solid = replace(torus(), settings=replace(DEFAULT_GENERAL, walls=walls))
    with pytest.raises(ValueError, match="solid/settings cannot be stored: it is not the default"):
        tree_to_arrays(solid)


def test_contacts_without_a_solid_are_refused():
    touched = torus_touches()
    for wrong in (touched._replace(normals=None), only(touched, slice(0))):
        with pytest.raises(ValueError, match="must have points and normals"):
            rebuild_general(wrong)
    with pytest.raises(ValueError, match="cell must be positive"):
        rebuild_general(touched, cell=0.0)
    flat = touched._replace(points=touched.points * [1.0, 1.0, 0.0])
    for wrong in (flat, touched._replace(points=flat.points @ np.linalg.qr(np.ones((3, 3)))[0])):
        with pytest.raises(ValueError, match="must not all lie in one plane"):
            rebuild_general(wrong)
    random = np.random.default_rng(5).normal(size=touched.points.shape)
    with pytest.raises(ValueError, match="normals must agree with those beside them"):
        rebuild_general(touched._replace(normals=random), cell=CELL)
    far = touched._replace(points=1e3 * touched.points)
    with pytest.raises(ValueError, match=r"span 77\.\d+ m.* multiply millimetres by 0\.001"):
        rebuild_general(far)
    with pytest.raises(ValueError, match=r"points lie up to 30 .* multiply millimetres by 0\.001"):
        torus().distance([[0.0, 0.0, 30.0]])


def test_surface_lies_behind_what_a_pad_spanned():
    rng = np.random.default_rng(1)
    out = rng.normal(size=(3000, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    out = out[np.hypot(out[:, 0], out[:, 1]) + (out[:, 2] < 0.0) > 0.3]  # but for the top
    touched = contacts(0.03 * out, out, np.arange(len(out)) // 20)
    options: Any = {"cell": CELL, "pose": 1e-5, "outward": True}
    whole = rebuild_general(touched, **options)
    grid = np.array([[x, y, 0.0] for x in (-2e-3, 0.0, 2e-3) for y in (-2e-3, 0.0, 2e-3)])

    def top(face: float) -> float:
        """Height of the ball's top behind a pad's face at a height, m."""
        spans = grid + [0.0, 0.0, face]
        fitted = rebuild_general(touched, **options, spanned=spans, start=whole)
        assert len(fitted.fit.weights) == len(touched.points)
        return face - float(fitted.evaluate(spans[4:5])[0][0])

    assert top(0.031) == pytest.approx(0.03, abs=1e-4)  # the face lies over the surface
    assert 0.0294 < top(0.0295) < 0.02975


def test_splines_sum_to_one_and_integrals_are_exact():
    within = np.random.default_rng(0).random((20, 3))
    rows = basis_rows(within)
    assert rows[0].sum(axis=1) == pytest.approx(np.ones(20))
    assert np.abs(rows[1:].sum(axis=2)).max() < 1e-12
    third, mass = cell_integrals()
    corner = np.stack(np.meshgrid(*[np.arange(4.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    line = corner @ np.array([1.0, 2.0, 3.0])
    assert line @ third @ line == pytest.approx(0.0, abs=1e-9)
    assert line**2 @ third @ line**2 == pytest.approx(0.0, abs=1e-6)
    # x y z, and x cubed but for lower powers: six times 1 squared, and 6 squared.
    assert corner.prod(axis=1) @ third @ corner.prod(axis=1) == pytest.approx(6.0)
    assert corner[:, 0] ** 3 @ third @ corner[:, 0] ** 3 == pytest.approx(36.0)
    assert np.ones(64) @ mass @ np.ones(64) == pytest.approx(1.0)


@pytest.mark.parametrize("radius", [0.01, 0.15, 0.3, 0.5])
def test_cells_are_as_large_as_memory_asks(radius: float):
    at = np.random.default_rng(0).normal(size=(4000, 3))
    at *= radius / np.linalg.norm(at, axis=1, keepdims=True)
    cell, settings = least_cell(at), DEFAULT_GENERAL.grid
    assert 8.0 * np.pi * (radius / cell) ** 2 <= 1.01 * settings.max_cells
    assert (2.0 * radius / cell) ** 3 <= settings.max_voxels
    assert (cell < 4e-3) == (radius < 0.1)


@pytest.mark.parametrize("share", [0.2, 0.5, 1.0])
def test_normals_that_point_inwards_are_turned(share):
    touched = torus_touches()
    assert touched.normals is not None
    wrong = np.random.default_rng(4).random(len(touched.points)) < share
    turned = touched._replace(normals=np.where(wrong[:, None], -1.0, 1.0) * touched.normals)
    found = oriented(turned)
    assert found.turned == np.count_nonzero(wrong)
    assert np.array_equal(found.contacts.normals, touched.normals)
