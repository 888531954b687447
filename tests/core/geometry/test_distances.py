"""Laws of nearest points, of distances between surfaces, and of rigid alignment."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.core.arrays import Floats
from palpate.core.geometry import (
    PreparedSurface,
    align,
    are_slivers,
    areas_and_normals,
    compare_surfaces,
    nearest_points,
    nearest_search,
    point_tree,
    prepare_surface,
    sample_surface,
    triangle_corners,
)
from palpate.core.poses import Pose
from tests.core.geometry.bodies import BOX, SPHERE, ball, moved

RNG = np.random.Generator


def slow_distance(corners: Floats, point: Floats) -> float:
    """The least distance of one point from triangles: from their edges, and from their insides."""
    following = np.roll(corners, -1, axis=1)
    along, away = following - corners, point - corners
    square = np.einsum("nij,nij->ni", along, along)
    share = np.einsum("nij,nij->ni", away, along) / np.where(square > 0, square, 1)
    feet = corners + np.clip(share, 0, 1)[:, :, None] * along
    normal = np.cross(along[:, 0], -along[:, 2])
    length = np.linalg.norm(normal, axis=1)
    whole = length > 0
    normal, corners, along = normal[whole] / length[whole, None], corners[whole], along[whole]
    foot = point - np.einsum("ni,ni->n", point - corners[:, 0], normal)[:, None] * normal
    turns = np.einsum("nij,nj->ni", np.cross(along, foot[:, None] - corners), normal)
    places = np.concatenate([feet.reshape(-1, 3), foot[(turns >= 0).all(axis=1)]])
    return float(np.linalg.norm(places - point, axis=1).min())


def random_soup(rng: RNG, faces: int) -> Floats:
    """Triangles of sizes over three decades."""
    centres = rng.normal(size=(faces, 1, 3))
    return centres + rng.normal(size=(faces, 3, 3)) * 10 ** rng.uniform(-2.5, 0.5, (faces, 1, 1))


def long_thin(rng: RNG, faces: int) -> Floats:
    """Triangles a thousand times as long as wide, in all directions."""
    start, along = rng.normal(size=(2, faces, 3))
    across = rng.normal(size=(faces, 3)) * 1e-3
    return np.stack([start, start + along, start + 0.3 * along + across], axis=1)


def degenerate(rng: RNG, faces: int) -> Floats:
    """Triangles that are segments or points, among whole ones."""
    corners = random_soup(rng, faces)
    corners[0::4, 2] = corners[0::4, 1]
    corners[1::4, 1:] = corners[1::4, :1]
    corners[2::4, 2] = 0.25 * corners[2::4, 0] + 0.75 * corners[2::4, 1]
    return corners


@pytest.mark.parametrize("make", [random_soup, long_thin, degenerate])
@pytest.mark.parametrize("faces", [1, 2, 5, 60])
def test_nearest_points_are_those_of_the_slow_search(make, faces):
    rng = np.random.default_rng(faces)
    corners = make(rng, faces)
    queries = np.concatenate([rng.normal(size=(40, 3)) * 1.5, corners.mean(axis=1)])
    distances, points, named = nearest_points(nearest_search(corners), queries)
    slow = [slow_distance(corners, query) for query in queries]
    # Rounding costs eps times length over width, a thousand for the thin ones.
    assert np.allclose(distances, slow, atol=1e-11, rtol=1e-12)
    assert np.allclose(np.linalg.norm(points - queries, axis=1), distances, rtol=0, atol=1e-14)
    pairs = zip(named, points, strict=True)
    assert max(slow_distance(corners[face : face + 1], point) for face, point in pairs) < 1e-12


def test_spheres_are_searched_from_near_and_far():
    corners = triangle_corners(*SPHERE)
    search = nearest_search(corners)
    directions = np.random.default_rng(8).normal(size=(6000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    # From its very middle, where every face is as near as any other, to ten radii out.
    queries = directions * np.linspace(0.0, 0.4, 6000)[:, None]
    whole = nearest_points(search, queries)
    slow = [slow_distance(corners, query) for query in queries[::400]]
    assert np.allclose(whole.distances[::400], slow, rtol=0, atol=1e-15)
    parts = [nearest_points(search, part) for part in np.split(queries, 8)]
    assert np.array_equal(whole.distances, np.concatenate([one.distances for one in parts]))
    assert nearest_points(search, corners.reshape(-1, 3)).distances.max() < 1e-17
    for scale in (1e-3, 1e3):
        scaled = nearest_points(nearest_search(corners * scale), queries[3000:3300] * scale)
        assert np.allclose(scaled.distances, whole.distances[3000:3300] * scale, rtol=1e-10, atol=0)
        assert np.allclose(
            scaled.points, whole.points[3000:3300] * scale, rtol=0, atol=1e-9 * scale
        )


def test_slivers_are_flagged_and_trees_find_neighbours():
    flat = degenerate(np.random.default_rng(0), 8)
    assert are_slivers(flat).tolist() == [True, True, True, False] * 2
    assert not are_slivers(long_thin(np.random.default_rng(0), 8)).any()
    points = np.random.default_rng(0).random((50, 3))
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    for balanced in (True, False):
        result = point_tree(points, balanced=balanced).query(points, k=2)[1][:, 1]
        assert np.array_equal(result, np.argsort(apart, axis=1)[:, 1])


@cache
def prepared(kind: str, scale: float = 1.0) -> PreparedSurface:
    meshes = {
        "sphere": SPHERE,
        "inside out": SPHERE._replace(faces=SPHERE.faces[:, ::-1]),
        "squashed": moved(SPHERE, 0.0, [1.0, 0.9, 1.1]),
        "box": moved(BOX, 0.0, 0.05),
    }
    mesh = moved(meshes[kind], 0.0, scale)
    return prepare_surface(*mesh, samples=5000)


SHEET = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
SHEET_FACES = np.array([[0, 1, 2], [0, 2, 3]])


def test_distances_equal_known_values():
    same = compare_surfaces(prepared("sphere"), prepared("sphere"))
    assert same.hausdorff < 1e-16 and same.normal_deg < 1e-9
    sheet = prepare_surface(SHEET, SHEET_FACES, 3000)
    raised = prepare_surface(SHEET + [0, 0, 0.25], SHEET_FACES, 3000)
    assert compare_surfaces(sheet, raised) == pytest.approx((0.25,) * 4 + (0.0, 0.25), abs=1e-12)
    assert compare_surfaces(sheet, raised, 0.2).rms_above == 0.0  # one end lies below
    near, far = (prepare_surface(*ball(radius, 5), samples=3000) for radius in (0.040, 0.041))
    result = compare_surfaces(near, far)
    # The facets stand off by up to 0.04 * 0.035**2 / 8 = 6 um.
    assert result[:4] == pytest.approx((1e-3,) * 4, abs=7e-6) and result.normal_deg < 1.0
    # Samples whose nearest point is on a neighbouring facet are not quite turned by 180 degrees.
    turned = compare_surfaces(prepared("sphere"), prepared("inside out"))
    assert turned.normal_deg == pytest.approx(180.0, abs=0.5)


def test_distances_follow_their_definitions():
    # Only one direction sees a small flap one metre above a square.
    flap = np.array([[0.4, 0.4, 1], [0.6, 0.4, 1], [0.6, 0.6, 1], [0.4, 0.6, 1]])
    both = np.concatenate([SHEET, flap]), np.concatenate([SHEET_FACES, SHEET_FACES + 4])
    result = compare_surfaces(prepare_surface(SHEET, SHEET_FACES), prepare_surface(*both))
    share = 0.04 / 1.04  # of the samples of the surface with the flap
    assert result.chamfer == pytest.approx(0.5 * share, rel=1e-3)
    assert result.rms == pytest.approx((0.5 * share) ** 0.5, rel=1e-3)
    assert result.p95 < 1e-15 and result.hausdorff == pytest.approx(1.0)


def test_distances_are_symmetric_and_follow_scale_and_place():
    result = compare_surfaces(prepared("sphere"), prepared("box"))
    assert result == compare_surfaces(prepared("box"), prepared("sphere"))
    thousandth = compare_surfaces(prepared("sphere", 1e3), prepared("box", 1e3))
    assert np.array(thousandth[:4]) / 1e3 == pytest.approx(result[:4], rel=1e-9)
    assert thousandth.normal_deg == pytest.approx(result.normal_deg, rel=1e-3)
    here = compare_surfaces(prepared("sphere"), prepared("squashed"))
    shift = [1.0, -2.0, 3.0]
    there = [prepare_surface(*moved(SPHERE, shift, by), samples=5000) for by in (1, [1, 0.9, 1.1])]
    assert compare_surfaces(*there)[:4] == pytest.approx(here[:4], rel=1e-9)
    thin = prepared("sphere").thinned(5)
    assert len(thin.samples.points) == 1000
    assert compare_surfaces(thin, prepared("sphere")).hausdorff < 1e-16
    # Faces without area are left out.
    extra = np.concatenate([[[0, 0, 1], [5, 5, 5]], SPHERE.faces])
    padded = prepare_surface(SPHERE.vertices, extra, 5000)
    assert compare_surfaces(prepared("sphere"), padded).hausdorff < 1e-16
    with pytest.raises(ValueError, match="must have an area, but all 2 faces have none"):
        prepare_surface(np.zeros((3, 3)), [[0, 1, 2], [2, 1, 0]])


def test_samples_are_uniform_by_area():
    # Areas 1, 0, 3, 0: faces without area get no sample.
    flat = [[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]
    large = [[0.0, 0, 5], [2, 0, 5], [0, 3, 5]]
    corners = np.array([[[0.0, 0, 0], [2, 0, 0], [0, 1, 0]], flat, large, flat])
    counts = np.bincount(sample_surface(corners, 4000, np.random.default_rng(1)).faces, minlength=4)
    # Stratified: only the stratum that a boundary cuts can fall to either side.
    assert abs(counts[0] - 1000) <= 1 and counts[1] == counts[3] == 0
    unit = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    x, y = sample_surface(unit, 100_000, np.random.default_rng(3)).points[:, :2].T
    # Four congruent quarters of the triangle; the bound is five standard deviations.
    quarters = [(x > 0.5).mean(), (y > 0.5).mean(), (x + y < 0.5).mean()]
    assert quarters == pytest.approx([0.25] * 3, abs=5 * (0.25 * 0.75 / 100_000) ** 0.5)
    assert x.min() >= 0.0 and y.min() >= 0.0 and (x + y).max() <= 1.0
    corners = triangle_corners(*SPHERE)
    samples, other = (sample_surface(corners, 20_000, np.random.default_rng(4)) for _ in range(2))
    assert samples.points.tobytes() == other.points.tobytes()
    normals = areas_and_normals(corners)[1][samples.faces]
    offsets = samples.points - corners[samples.faces, 0]
    assert np.abs((offsets * normals).sum(axis=1)).max() < 1e-15
    # 40 mm / sqrt(3 * 20000) = 0.16 mm would be the deviation of a plain sample.
    assert np.abs(samples.points.mean(axis=0)).max() < 5 * 0.16e-3
    with pytest.raises(ValueError, match="must have an area to be sampled, got 0"):
        sample_surface(np.zeros((2, 3, 3)), 10, np.random.default_rng(0))


@cache
def lopsided(unit: float = 1.0) -> PreparedSurface:
    """A solid without any symmetry, some 100 mm long."""
    directions, faces = ball(1.0, 3)
    vertices = directions * [0.05, 0.04, 0.03]
    vertices[:, 0] *= 1.0 + 6.0 * vertices[:, 2]
    vertices[:, 1] += 4.0 * vertices[:, 0] ** 2
    return prepare_surface(unit * vertices, faces)


@pytest.mark.parametrize(("vector", "unit", "least", "noise"), [
    pytest.param([0, 0, 0], 1.0, -1.0, 0.0, marks=pytest.mark.slow),
    ([np.pi, 0, 0], 1e-3, -0.01, 0.0),  # only the part above a plane
    ([0.3, 2.5, -0.7], 1e3, -1.0, 1e-4),
])  # fmt: skip
def test_alignment_undoes_a_motion(vector, unit, least, noise):
    surface, rng = lopsided(unit), np.random.default_rng(4)
    points = surface.samples.points[::40]
    points = points[points[:, 2] > least * unit]
    away = Rotation.from_rotvec(vector).apply(points) + unit * np.array([0.3, -0.1, 0.5])
    away += noise * unit * rng.normal(size=away.shape)
    result = align(away, surface)
    limit = 6 * noise or 1e-8
    assert np.allclose(
        Pose.from_array(result.pose).to_outer(away), points, rtol=0, atol=limit * unit
    )
    assert result.rms == pytest.approx(noise * unit, rel=0.15, abs=1e-9 * unit)
    assert result.converged and not result.ambiguous and result.pose[6] >= 0.0


def test_symmetric_surfaces_are_ambiguous_and_turned_least():
    sphere = prepare_surface(*ball(0.04, 4), samples=5000)
    result = align(sphere.samples.points[::20] + [0.1, 0.2, 0.3], sphere)
    assert result.ambiguous
    assert np.allclose(result.pose[:3], [-0.1, -0.2, -0.3], rtol=0, atol=5e-5)
    brick = prepare_surface(*moved(BOX, 0.0, [0.03, 0.05, 0.08]), samples=5000)
    turned = Rotation.from_rotvec([0.0, 0.0, 0.2]).apply(brick.samples.points[::10])
    result = align(turned + [0.0, 0.0, 0.1], brick)
    assert result.ambiguous and result.rms < 1e-9
    # Of the four poses the one that turns least, back by 0.2.
    assert 2.0 * np.arcsin(np.linalg.norm(result.pose[3:6])) == pytest.approx(0.2, abs=1e-6)


@pytest.mark.parametrize(("points", "words"), [
    (np.zeros((5, 3)), "points must be at least 6, got 5"),
    (np.ones((9, 3)), "points must not lie all in one place, got 9"),
    (np.full((9, 3), np.nan), "points must be finite"),
    (np.zeros((9, 2)), r"points must have shape \(any, 3\)"),
])  # fmt: skip
def test_points_that_cannot_be_aligned_are_refused(points, words):
    with pytest.raises(ValueError, match=words):
        align(points, lopsided())
