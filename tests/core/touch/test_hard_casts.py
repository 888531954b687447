"""Presses at which a cast can go wrong, on each kind of shape to which they apply."""

import math
from collections.abc import Callable
from importlib.util import find_spec

import numpy as np
import pytest

from palpate.core.poses import FACING_DOWN, pose_of
from palpate.core.shapes.deformed_superquadrics import DeformedSuperquadric
from palpate.core.shapes.protocol import PosedShape, Shape
from palpate.core.shapes.superquadrics import Superquadric
from palpate.core.shapes.triangle_meshes import TriangleShape
from palpate.core.touch.pad import Pad, guarded_move

Make = Callable[[Superquadric], Shape]
LEVEL = 5  # 20k faces
REACH = 0.1
EXACT = 1e-12
NO_EMBREE = pytest.mark.skipif(find_spec("embreex") is None, reason="no Embree here")


def embree(solid):
    return TriangleShape(*solid.mesh(LEVEL), embree=True)


def zbuffer(solid):
    return TriangleShape(*solid.mesh(LEVEL), embree=False)


def unwarped(solid):
    return DeformedSuperquadric(solid, np.zeros(2))


MESHES = [pytest.param(embree, marks=NO_EMBREE), zbuffer]
ALL: list[Make] = [lambda solid: solid, unwarped, *MESHES]
KINDS = pytest.mark.parametrize(
    "make", ALL, ids=["superquadric", "warped", "mesh, Embree", "mesh, z-buffer"]
)


def above(height):
    return pose_of(np.array([0.0, 0.0, height]), FACING_DOWN)


@KINDS
def test_a_pad_whose_transducers_start_inside_says_inside(make, ball, flat):
    for height in (0.026, 0.0, -0.02, -0.0295):  # the last in the far half, near the exit
        end = guarded_move(make(ball), flat, above(height), REACH, 1e-3)
        assert end.outcome == "inside"
        assert (end.compression == 0.0).all()


@KINDS
def test_a_pad_whose_face_starts_inside_says_inside_though_its_transducers_are_outside(
    make, ball, flat
):
    assert guarded_move(make(ball), flat, above(0.0298), REACH, 1e-3).outcome == "inside"


@KINDS
def test_the_exit_out_of_reach_does_not_hide_that_the_start_is_inside(make, flat):
    deep = make(Superquadric(np.array([0.05, 0.05, 0.5]), np.ones(2)))
    assert guarded_move(deep, flat, above(0.4), 1e-3, 1e-3).outcome == "inside"


@KINDS
def test_a_press_past_saturation_bottoms(make, ball, flat):
    end = guarded_move(make(ball), flat, above(0.05), REACH, 2.9e-3)
    assert end.outcome == "bottomed"
    assert end.compression.max() == pytest.approx(2.4e-3, abs=EXACT)


@KINDS
def test_a_pad_beside_the_object_or_too_far_misses(make, ball, flat):
    aside = pose_of(np.array([0.04, 0.0, 0.05]), FACING_DOWN)
    for start, reach in ((aside, REACH), (above(0.05), 0.0199), (above(-0.05), REACH)):
        end = guarded_move(make(ball), flat, start, reach, 1e-3)
        assert end.outcome == "miss"
        assert (end.compression == 0.0).all()
        assert end.advance == reach


@KINDS
def test_a_hit_is_touched_where_the_object_is(make, ball, flat):
    end = guarded_move(make(ball), flat, above(0.05), REACH, 1e-3)
    x, y = flat.grid()
    wanted = np.sqrt(0.03**2 - x**2 - y**2)
    wanted = np.maximum(1e-3 - (wanted.max() - wanted), 0.0)
    assert end.outcome == "hit"
    facets = 1e-5 if isinstance(make(ball), TriangleShape) else EXACT
    assert np.allclose(end.compression, wanted, rtol=0, atol=2 * facets)


@pytest.mark.parametrize(
    "exponents", [(0.02, 0.02), (0.1, 1.0), (1.0, 1.0), (2.0, 2.0), (2.0, 0.02)]
)
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("warp", [False, True])
def test_a_ray_on_the_axis_is_exact(exponents, axis, warp):
    solid = Superquadric(np.array([0.02, 0.03, 0.04]), np.array(exponents))
    shape: Shape = unwarped(solid) if warp else solid
    odd = Pad(rows=15, cols=15, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
    for sign in (1.0, -1.0):
        into = -sign * np.eye(3)[axis]
        across = np.eye(3)[axis - 1]
        axes = np.column_stack([across, np.cross(into, across), into])
        end = guarded_move(shape, odd, pose_of(-0.1 * into, axes), REACH, 1e-3)
        assert end.outcome == "hit"
        assert end.advance == pytest.approx(0.1 - solid.size[axis] + 1e-3, abs=EXACT)
        assert end.compression[7, 7] == pytest.approx(1e-3, abs=EXACT)


@KINDS
def test_a_plate_of_1_mm_pressed_by_2_mm_is_touched_on_its_near_side(make, flat):
    plate = make(Superquadric(np.array([0.03, 0.03, 0.0005]), np.full(2, 0.05)))
    end = guarded_move(plate, flat, above(0.05), REACH, 2e-3)
    assert end.outcome == "hit"
    assert np.allclose(end.compression, 2e-3, rtol=0, atol=1e-6)
    assert end.advance == pytest.approx(0.05 - 0.0005 + 2e-3, abs=1e-6)


@KINDS
@pytest.mark.parametrize(("aside", "measured"), [(0.0, 0), (0.5e-3, 1)])
def test_an_object_finer_than_the_pitch_is_touched_on_a_taxel_and_not_between_taxels(
    make, aside, measured, flat
):
    """Honest: the pad has no taxel there, and says so."""
    pin = make(Superquadric(np.full(3, 0.4e-3), np.ones(2)))
    end = guarded_move(
        pin, flat, pose_of(np.array([aside, aside, 0.05]), FACING_DOWN), REACH, 0.3e-3
    )
    assert end.outcome == ("hit" if measured else "miss")
    assert int((end.compression > 0).sum()) == measured
    if measured:
        assert end.compression.max() == pytest.approx(0.3e-3, abs=EXACT)


@KINDS
def test_an_object_smaller_than_the_pad_is_touched_by_the_taxels_over_it_alone(make, flat):
    small = make(Superquadric(np.full(3, 0.004), np.ones(2)))
    end = guarded_move(small, flat, above(0.05), REACH, 0.3e-3)
    assert end.outcome == "hit"
    x, y = flat.grid()
    rim = np.sqrt(np.maximum(0.004**2 - x**2 - y**2, 0.0))
    assert np.array_equal(end.compression > 0, rim > rim.max() - 0.3e-3)
    assert int((end.compression > 0).sum()) == 12
    whole = guarded_move(small, flat, above(0.05), REACH, 2e-3)
    assert (whole.indentation[np.hypot(x, y) > 0.004] == -np.inf).all()


@pytest.mark.parametrize("count", [40, pytest.param(400, marks=pytest.mark.slow)])
def test_random_exponents_and_tilts_agree_with_the_definition(count, flat):
    rng = np.random.default_rng(6)
    worst, hits = 0.0, 0
    for _ in range(count):
        solid = Superquadric(rng.uniform(0.01, 0.04, 3), rng.uniform(0.02, 2.0, 2))
        out = rng.normal(size=3)
        place = out / solid.gauge(out[None])[0]
        into = -out / np.linalg.norm(out) + 0.5 * rng.normal(size=3)
        into /= np.linalg.norm(into)
        across = np.cross(into, rng.normal(size=3))
        across /= np.linalg.norm(across)
        axes = np.column_stack([across, np.cross(into, across), into])
        end = guarded_move(solid, flat, pose_of(place - 0.08 * into, axes), 0.1, 1e-3)
        assert end.outcome == "hit"
        error = _errors(solid, flat, end, axes)
        worst, hits = max(worst, float(error.max())), hits + len(error)
    assert hits > 50 * count
    assert worst < EXACT


def test_the_gauge_does_not_overflow_at_the_smallest_exponents(flat):
    for exponents in ((0.02, 0.02), (0.02, 2.0), (2.0, 0.02)):
        solid = Superquadric(np.array([0.03, 0.001, 0.04]), np.array(exponents))
        for far in (0.1, 9.0):
            end = guarded_move(solid, flat, above(far), 10.0, 1e-3)
            assert end.outcome == "hit"
            assert np.isfinite(end.compression).all()
            assert _errors(solid, flat, end, FACING_DOWN).max() < 1e-11
            assert guarded_move(solid, flat, above(-far), 10.0, 1e-3).outcome == "miss"


def test_an_edge_met_at_45_degrees_and_a_corner_along_its_diagonal_are_exact(flat):
    for exponent, corner in ((0.05, (1.0, 1.0, 0.0)), (0.1, (1.0, 1.0, 1.0))):
        solid = Superquadric(np.full(3, 0.02), np.full(2, exponent))
        out = np.array(corner) / math.sqrt(sum(corner))
        across = np.cross([0.3, 0.0, 1.0], out)
        across /= np.linalg.norm(across)
        axes = np.column_stack([across, np.cross(-out, across), -out])
        end = guarded_move(solid, flat, pose_of(0.08 * out, axes), REACH, 1e-3)
        assert end.outcome == "hit"
        error = _errors(solid, flat, end, axes)
        assert len(error) > 100
        assert error.max() < EXACT


@pytest.mark.parametrize("warp", [False, True])
def test_rays_along_a_face_meet_what_is_within_it_and_miss_what_is_beside(warp, flat):
    """A pad over the edge of a box: half its rays run along the side."""
    solid = Superquadric(np.array([0.0075, 0.03, 0.04]), np.full(2, 0.05))
    shape: Shape = unwarped(solid) if warp else solid
    end = guarded_move(
        shape, flat, pose_of(np.array([0.0075, 0.0, 0.06]), FACING_DOWN), REACH, 1e-3
    )
    over = end.pose[0] + flat.grid()[0]
    assert end.outcome == "hit"
    assert np.isfinite(end.indentation[np.abs(over) < 0.0074]).all()
    assert (end.indentation[np.abs(over) > 0.0076] == -np.inf).all()
    error = _errors(solid, flat, end, FACING_DOWN)
    assert error.max() < EXACT


def _errors(solid, pad, end, axes):
    """Distances of what was measured from the surface along the rays, in extended precision, m."""
    wide = np.longdouble
    met = np.isfinite(end.indentation).ravel()
    gaps = end.advance - end.indentation.ravel()[met] + pad.thickness
    start = end.pose[:3] - end.advance * axes[:, 2]
    origins = (pad.transducers() @ axes.T + start)[met].astype(wide)
    towards = axes[:, 2].astype(wide)
    e1, e2 = solid.exponents.astype(wide)

    def height(ways):
        x, y, z = np.abs((origins + ways[:, None] * towards) / solid.size.astype(wide)).T
        across = np.maximum(x, y)
        across = across * ((x / across) ** (2 / e2) + (y / across) ** (2 / e2)) ** (e2 / 2)
        most = np.maximum(across, z)
        gauge = most * ((across / most) ** (2 / e1) + (z / most) ** (2 / e1)) ** (e1 / 2)
        return np.asarray(gauge - 1)

    step = wide(1e-9)
    ways = gaps.astype(wide)
    slope = np.maximum((height(ways - step) - height(ways)) / step, 0)
    least = 1e-3 / float(solid.size.max())
    return np.asarray(np.abs(height(ways)) / np.maximum(slope, least), float)


BACKENDS = [pytest.param(True, marks=NO_EMBREE), False]


def slab(half):
    """A box with sharp edges, of twelve faces."""
    corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)]
    return corners, np.array(faces, np.int32)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_sharp_plate_of_1_mm_pressed_by_2_mm_is_touched_exactly(backend, flat):
    plate = TriangleShape(*slab(np.array([0.03, 0.03, 0.0005])), backend)
    end = guarded_move(plate, flat, above(0.05), REACH, 2e-3)
    assert end.outcome == "hit"
    assert np.allclose(end.compression, 2e-3, rtol=0, atol=EXACT)


@pytest.mark.parametrize("backend", BACKENDS)
def test_nothing_is_touched_through_a_hole_but_the_wall_behind_it(backend, flat):
    corners, faces = slab(np.array([0.03, 0.03, 0.02]))
    top = (corners[faces][:, :, 2] > 0).all(axis=1)
    assert top.sum() == 2
    whole = TriangleShape(corners, faces, backend)
    holed = TriangleShape(corners, faces[~top], backend)
    assert (whole.closed, holed.closed) == (True, False)
    assert guarded_move(whole, flat, above(0.05), REACH, 1e-3).outcome == "hit"
    # The bottom is seen from behind: it is no surface that could be met from there.
    assert guarded_move(holed, flat, above(0.05), REACH, 1e-3).outcome == "miss"
    assert guarded_move(holed, flat, above(0.0), REACH, 1e-3).outcome == "miss"
    # The side is met as ever, and from within the open box the far side is not.
    into = np.array([-1.0, 0.0, 0.0])
    axes = np.column_stack([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], into])
    end = guarded_move(holed, flat, pose_of(np.array([0.05, 0.0, 0.0]), axes), REACH, 1e-3)
    assert end.outcome == "hit"
    assert end.advance == pytest.approx(0.021, abs=EXACT)


@pytest.mark.parametrize("backend", BACKENDS)
def test_through_a_hole_a_ray_goes_on_to_the_next_front_face(backend, flat):
    corners, faces = slab(np.array([0.03, 0.03, 0.01]))
    top = (corners[faces][:, :, 2] > 0).all(axis=1)
    lower = corners - [0.0, 0.0, 0.04]
    both = np.concatenate([corners, lower]), np.concatenate([faces[~top], faces + 8])
    end = guarded_move(TriangleShape(*both, backend), flat, above(0.05), REACH, 1e-3)
    assert end.outcome == "hit"
    assert end.advance == pytest.approx(0.05 + 0.03 + 1e-3, abs=EXACT)
    assert np.allclose(end.compression, 1e-3, rtol=0, atol=EXACT)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_mesh_that_is_inside_out_is_turned(backend, ball, flat, signed_volume):
    vertices, faces = ball.mesh(4)
    right = TriangleShape(vertices, faces, backend)
    turned = TriangleShape(vertices, faces[:, ::-1], backend)
    assert (right.flipped, turned.flipped) == (False, True)
    assert signed_volume(turned.mesh(0)) == pytest.approx(signed_volume(right.mesh(0)))
    for height, outcome in ((0.05, "hit"), (0.0, "inside")):
        first, second = (guarded_move(s, flat, above(height), REACH, 1e-3) for s in (right, turned))
        assert first.outcome == second.outcome == outcome
        assert np.allclose(first.compression, second.compression, rtol=0, atol=EXACT)


@pytest.mark.parametrize("backend", BACKENDS)
def test_rays_along_the_silhouette_of_a_mesh_do_not_start_inside(backend, flat):
    """Edges and side faces seen edge-on show a back face as near as a front face."""
    box = TriangleShape(*slab(np.array([0.0075, 0.0035, 0.02])), backend)
    for aside in (0.0, 0.5e-3, 1e-3, 7e-3, 15e-3):  # taxels run exactly along the sides
        start = pose_of(np.array([aside, 0.0, 0.05]), FACING_DOWN)
        assert guarded_move(box, flat, start, REACH, 1e-3).outcome == "hit"
    for turn in np.linspace(0.0, 3.0, 40):
        cosine, sine = math.cos(turn), math.sin(turn)
        axes = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]])
        posed = PosedShape(box, pose_of(np.zeros(3), axes))
        assert guarded_move(posed, flat, above(0.05), REACH, 1e-3).outcome == "hit"


@NO_EMBREE
def test_embree_and_the_z_buffer_feel_the_same(ball, domed):
    corners, faces = slab(np.array([0.03, 0.02, 0.01]))
    shapes = [tuple(ball.mesh(4)), (corners, faces)]
    shapes += [(corners, faces[:, ::-1]), (corners, faces[1:]), (corners, faces[4:, ::-1])]
    rng, outcomes = np.random.default_rng(1), set()
    for vertices, some in shapes:
        first, second = TriangleShape(vertices, some, True), TriangleShape(vertices, some, False)
        assert (first.closed, first.flipped) == (second.closed, second.flipped)
        for _ in range(25):
            matrix = np.linalg.qr(rng.normal(size=(3, 3)))[0]
            matrix[:, 0] *= np.linalg.det(matrix)
            away = rng.choice([0.0, 0.06])
            start = pose_of(rng.uniform(-0.02, 0.02, 3) - away * matrix[:, 2], matrix)
            ends = [guarded_move(shape, domed, start, REACH, 1e-3) for shape in (first, second)]
            assert ends[0].outcome == ends[1].outcome
            assert np.allclose(ends[0].compression, ends[1].compression, rtol=0, atol=1e-9)
            outcomes.add(ends[0].outcome)
    assert outcomes == {"hit", "miss", "inside"}
