"""Laws that all kinds of solids obey: casts, spans, functions and meshes agree with definitions."""

from collections.abc import Iterator

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.geometry import solidity
from palpate.core.poses import Pose, rotations_from_vectors
from palpate.core.shapes import MISS, PosedShape, PosedSolid
from tests.core.shapes.definitions import DOWN, SOLIDS, Case, check_casts

# Each of them costs 1 s to 3 s in all, and has a relative among the others.
SLOW = {"dome", "dented and drilled", "unevenly tapered, bent"}
marks = [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in SOLIDS]
every = pytest.mark.parametrize("name", marks)


def unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def bundles(case: Case, seed: int, count: int) -> Iterator[tuple[Floats, Floats]]:
    """Parallel rays about a solid's surface, a third of the directions along axes."""
    rng, vertices = np.random.default_rng(seed), case.mesh.vertices
    for number in range(count):
        axis = (-1) ** number * np.eye(3)[number // 3 % 3]
        direction = unit(rng.normal(size=3)) if number % 3 else axis
        places = vertices[rng.integers(len(vertices), size=20)]
        places = places + rng.normal(size=(20, 3)) * 0.1 * np.ptp(vertices, axis=0)
        yield places - rng.choice([0.0, 0.15], (20, 1)) * direction, direction


def assert_same_ranges(result: Floats, wanted: Floats, tolerance: float) -> None:
    met = np.isfinite(wanted)
    assert np.array_equal(result[~met], wanted[~met])
    assert np.allclose(result[met], wanted[met], rtol=0, atol=tolerance)


@every
def test_casts_are_first_entries_by_definition(name):
    case, rays = SOLIDS[name], list(bundles(SOLIDS[name], 7, 3))
    casts = check_casts(case, rays, 0.3)
    assert np.isfinite(casts).sum() > 12
    for (origins, direction), result in zip(rays, casts, strict=True):
        for reach in (1e-6, 0.1, np.inf):  # the exit out of reach does not hide a start inside
            wanted = np.where(result <= reach, result, MISS)
            assert_same_ranges(case.solid.cast(origins, direction, reach), wanted, 1e-12)


@every
def test_chords_and_gaps_of_any_thinness_are_resolved(name):
    case, rng = SOLIDS[name], np.random.default_rng(3)
    places = case.mesh.vertices[rng.integers(len(case.mesh.vertices), size=4)]
    slopes = [case.solid.inside_out(places, np.tile(axis, (4, 1)))[1] for axis in np.eye(3)]
    normals = unit(np.stack(slopes, axis=1))
    tangents = unit(np.cross(normals, rng.normal(size=(4, 3))))
    depths = np.array([-1e-4, -1e-6, -1e-8, -1e-10, 1e-10, 1e-8, 1e-6, 1e-4])[:, None]
    parts = zip(places, normals, tangents, strict=True)
    rays = [(place + depths * normal - 0.1 * along, along) for place, normal, along in parts]
    # A thin chord has its ends where the surface falls off slowly: they have fewer digits.
    check_casts(case, rays, 0.3, 1e-9)


@every
def test_spans_are_where_the_definition_is_negative(name):
    case, travelled = SOLIDS[name], np.linspace(0.0, 0.3, 301)
    for origins, direction in bundles(case, 11, 2):
        spans = case.solid.spans(origins, direction)
        level = case.level(origins[:, None] + travelled[:, None] * direction)
        inside = ((spans[..., :1] <= travelled) & (travelled <= spans[..., 1:])).any(axis=1)
        clear = np.abs(level) > 1e-6
        assert np.array_equal(inside[clear], (level <= 0)[clear])
        assert_same_ranges(spans[:, 0, 0], case.solid.cast(origins, direction, np.inf), 1e-11)
        # From behind, the same spans are seen in reverse.
        ahead = case.solid.spans(origins - 0.5 * direction, direction)
        behind = case.solid.spans(origins + 0.5 * direction, -direction)
        filled = [np.nan_to_num(some, posinf=0.0) for some in (ahead, behind)]
        lengths = [(some[..., 1] - some[..., 0]).sum(axis=1) for some in filled]
        assert np.allclose(lengths[0], lengths[1], rtol=0, atol=1e-9)
        met = lengths[0] > 1e-9
        ends = filled[0][:, 0, 0] + filled[1][..., 1].max(axis=1)
        assert np.allclose(ends[met], 1.0, rtol=0, atol=1e-10)


@every
def test_function_has_the_sign_of_the_definition_and_its_own_slope(name):
    case, rng = SOLIDS[name], np.random.default_rng(9)
    low, high = case.solid.enclosure()
    points, towards = rng.uniform(low - 0.01, high + 0.01, (200, 3)), rng.normal(size=(200, 3))
    value, slope = case.solid.inside_out(points, towards)
    level = case.level(points)
    assert np.array_equal(value[np.abs(level) > 1e-9] > 0, level[np.abs(level) > 1e-9] > 0)
    there, back = (case.solid.inside_out(points + s * towards, towards)[0] for s in (1e-8, -1e-8))
    off = np.abs(slope - (there - back) / 2e-8)
    assert np.quantile(off, 0.9) < 1e-5 * np.abs(slope).max()  # but across creases
    assert np.isfinite(case.solid.inside_out(np.zeros((1, 3)), np.ones((1, 3)))).all()


@every
def test_mesh_is_a_closed_surface_with_the_volume_of_the_spans(name):
    case, count = SOLIDS[name], 50
    vertices, faces = case.mesh
    body = solidity(vertices, faces)
    assert body.watertight and (body.components, body.genus) == (1, case.genus)
    low, high = case.solid.enclosure()
    assert (vertices >= low - 1e-9).all() and (vertices <= high + 1e-9).all()
    shares = (np.arange(count) + 0.5) / count
    x, y = np.meshgrid(*(low[i] + (high - low)[i] * shares for i in (0, 1)))
    origins = np.column_stack([x.ravel(), y.ravel(), np.full(count**2, high[2] + 1)])
    spans = case.solid.spans(origins, DOWN)
    length = np.ptp(spans[np.isfinite(spans[..., 0])], axis=1).sum()
    volume = length * np.prod((high - low)[:2]) / count**2
    assert body.volume == pytest.approx(volume, rel=0.04)  # facets of level 4 lie within


@every
def test_pose_and_scale_carry_over_to_ranges_spans_and_functions(name):
    case, rng = SOLIDS[name], np.random.default_rng(4)
    axes = rotations_from_vectors(rng.normal(size=(1, 3)))[0]
    pose = Pose(rng.normal(size=3), axes)
    large, posed = case.make(7.0), PosedSolid(case.solid, pose)
    for origins, direction in list(bundles(case, 5, 2))[1:]:
        moved, turned = pose.to_outer(origins), axes @ direction
        wanted = case.solid.cast(origins, direction, 0.3)
        spans = case.solid.spans(origins, direction)
        seen = PosedShape(case.solid, pose).cast(moved, turned, 0.3)
        # A grazing ray feels the rounding of its origin most.
        assert_same_ranges(seen, wanted, 1e-10)
        assert_same_ranges(large.cast(7 * origins, direction, 2.1) / 7, wanted, 1e-10)
        assert_same_ranges(posed.spans(moved, turned)[:, 0].ravel(), spans[:, 0].ravel(), 1e-10)
        towards = np.broadcast_to(direction, origins.shape)
        own = case.solid.inside_out(origins, towards)
        value = posed.inside_out(moved, towards @ axes.T)[0]
        assert np.allclose(value, own[0], rtol=1e-7, atol=1e-9)
    vertices = pose.to_outer(case.mesh.vertices)
    for solid in (posed, PosedShape(case.solid, pose)):
        assert np.allclose(solid.mesh(4).vertices, vertices, rtol=0, atol=1e-14)
    low, high = posed.enclosure()
    assert (vertices >= low - 1e-9).all() and (vertices <= high + 1e-9).all()
