"""Superquadrics: gauge, inside-outside function, norms and their derivatives, points, measures."""

import math
from typing import Any

import mpmath
import numpy as np
import pytest
import trimesh

from palpate.core import shapes
from palpate.core.arrays import Floats
from palpate.core.geometry import areas_and_normals, solidity
from palpate.core.poses import Pose, rotations_from_vectors

SIZE = np.array([0.03, 0.02, 0.04])
PAIRS = [[0.02, 0.02], [0.02, 2.0], [0.15, 0.15], [1.0, 1.0], [0.4, 1.6], [2.0, 0.1], [2.0, 2.0]]
POINTS = np.random.default_rng(0).uniform(-1, 1, (300, 3))
pairs = pytest.mark.parametrize("pair", PAIRS)


def shape_of(pair: Any, size: Any = SIZE) -> shapes.Superquadric:
    return shapes.Superquadric(np.array(size), np.array(pair))


def differences(function: Any, at: Any, shift: Any, step: float = 1e-6) -> Any:
    return (function(at + step * shift) - function(at - step * shift)) / (2 * step)


def test_log_f_agrees_with_50_digits_near_far_and_beside_the_axes():
    rng = np.random.default_rng(0)
    for number in range(16):
        exponents = np.exp(rng.uniform(math.log(0.01), math.log(2.0), 2))
        points = np.exp(rng.uniform(math.log(0.01), math.log(100.0), (20, 3)))
        points[:6] = 1.0 + 1e-6 * rng.normal(size=(6, 3))  # near a corner of the box
        points[6:10] = points[6:10, :1]  # on a diagonal
        if number % 2:
            points = 10.0 ** rng.uniform(-200, 5, (20, 3))
        result = shapes.inside_outside(points, exponents).value
        with mpmath.workdps(50):
            e1, e2 = (mpmath.mpf(float(e)) for e in exponents)
            for point, value in zip(points.tolist(), result.tolist(), strict=True):
                x, y, z = (mpmath.mpf(coordinate) for coordinate in point)
                across = x ** (2 / e2) + y ** (2 / e2)
                wanted = e1 * mpmath.log(across ** (e2 / e1) + z ** (2 / e1))
                assert abs(value - wanted) <= (16 + 2 * abs(value)) * np.finfo(float).eps


@pairs
def test_f_is_finite_homogeneous_and_the_same_in_all_octants(pair):
    wanted = shapes.inside_outside(np.abs(POINTS), pair)
    # Euler; a power of 100 costs two digits.
    assert np.allclose(wanted.by_log.sum(axis=1), 2.0, rtol=0, atol=1e-12)
    far = shapes.inside_outside(1e5 * np.abs(POINTS), pair)
    assert np.allclose(far.value, wanted.value + 2 * math.log(1e5), rtol=0, atol=1e-13)
    assert np.allclose(far.by_log, wanted.by_log, rtol=0, atol=1e-11)
    for signs in np.array(np.meshgrid([1, -1], [1, -1], [1, -1])).reshape(3, 8).T:
        result = shapes.inside_outside(np.abs(POINTS) * signs, pair)
        assert np.array_equal(result.value, wanted.value)
        assert np.array_equal(result.by_place * signs, wanted.by_place)
    tiny = [[1e-200, 1, 1], [1, 1e-200, 1e-200], [1e-200] * 3, [1e5] * 3, [1e-300, 0, 1e5]]
    result = shapes.inside_outside(tiny, pair)
    assert all(np.isfinite(part).all() for part in result)
    assert result.value[2] == pytest.approx(result.value[3] - 2 * math.log(1e205), abs=1e-11)
    # Powers of 30 that overflow when squared leave no trace on the axes.
    axes = shapes.inside_outside(30.0 * np.eye(3), np.maximum(pair, 0.01)).value
    assert np.exp(axes) == pytest.approx(900.0, rel=1e-14)


@pytest.mark.parametrize("pair", [[0.1, 0.1], [1.0, 1.0], [0.3, 1.7], [1.9, 1.9]])
def test_derivatives_of_log_f_are_those_of_differences(pair):
    points = np.random.default_rng(3).uniform(0.2, 2.0, (60, 3)) * [1, -1, 1]
    result = shapes.inside_outside(points, pair)
    for axis, shift in enumerate(np.eye(3)):
        wanted = differences(lambda at: shapes.inside_outside(at, pair).value, points, shift)
        assert np.allclose(result.by_place[:, axis], wanted, atol=1e-7)
        assert np.allclose(result.by_log[:, axis], result.by_place[:, axis] * points[:, axis])
    for which, shift in enumerate(np.eye(2)):
        by = np.array(pair)
        wanted = differences(lambda e: shapes.inside_outside(points, e).value, by, shift)
        assert np.allclose(result.by_exponents[:, which], wanted, atol=1e-6)


@pairs
def test_centre_has_f_0_finite_slopes_and_a_normal_upwards(pair):
    result = shapes.inside_outside(np.zeros((1, 3)), pair)
    assert all(np.isfinite(part).all() for part in result)
    assert np.exp(result.value[0]) == 0.0
    assert not np.concatenate([result.by_place, result.by_log], axis=1).any()
    assert not result.by_exponents.any()
    shape = shape_of(pair)
    near = np.outer([1e-3, 1e-9, 1e-200], [1.0, 0.0, 0.0])
    radial = near[:, 0] - near[:, 0] / shape.gauge(near)  # |x| (1 - 1 / gauge)
    assert radial == pytest.approx([-0.029, -0.03, -0.03], abs=1e-8)
    assert shape.normals(np.zeros((1, 3))).tolist() == [[0.0, 0.0, 1.0]]
    crease = shape.normals(np.array([[0.0, 0.0, 0.04], [0.0, 0.01, 0.02], [0.03, 0.0, 0.0]]))
    assert crease[0].tolist() == [0, 0, 1] and crease[2].tolist() == [1, 0, 0] and crease[1, 0] == 0


@pytest.mark.parametrize("pair", [[2.0, 2.0], [1.0, 2.0], [2.0, 1.0], [1.5, 1.5]])
def test_gradient_in_a_crease_is_the_mean_of_both_sides(pair):
    on = np.array([[0.0, 0.6, 0.4], [0.6, 0.0, 0.4], [0.6, 0.4, 0.0], [0.0, 0.0, 1.0]])
    result = shapes.inside_outside(on, pair)
    assert all(np.isfinite(part).all() for part in result)
    gauge = np.exp(0.5 * result.value)
    assert (np.abs(result.by_place) <= 2.0 / gauge[:, None] * (1 + 1e-15)).all()
    for row, axis in enumerate([0, 1, 2]):
        sides = [on[row] + side * 1e-9 * np.eye(3)[axis] for side in (1, -1)]
        mean = shapes.inside_outside(sides, pair).by_place.mean(axis=0)
        assert result.by_place[row] == pytest.approx(mean, abs=1e-4)


@pairs
def test_gauge_is_a_root_of_f_and_its_slope_bounded_in_growth(pair):
    shape, rng = shape_of(pair), np.random.default_rng(4)
    f = shapes.inside_outside(POINTS / SIZE, pair)
    assert np.allclose(shape.gauge(POINTS), np.exp(0.5 * f.value), rtol=1e-13)
    value, slope = shape.inside_out(POINTS, np.tile([1.0, 2.0, -1.0], (300, 1)))
    assert np.array_equal(value, shape.gauge(POINTS) - 1.0)
    along = 0.5 * shape.gauge(POINTS) * (f.by_place / SIZE @ [1.0, 2.0, -1.0])
    assert np.allclose(slope, along, rtol=1e-9, atol=1e-12 * np.abs(slope).max())
    # Ball, Carlen and Lieb, 1994: the second derivative is at most smoothness times speed squared.
    if max(pair) > 1.0:
        assert shape.smoothness() == math.inf
        return
    points, direction = shape.mesh(4).vertices, rng.normal(size=3)
    slopes = [
        shape.inside_out(at, np.tile(direction, (len(at), 1)))[1]
        for at in (points, points + 1e-7 * direction)
    ]
    bound = shape.smoothness() * shape.gauge(direction[None])[0] ** 2
    largest = (slopes[1] - slopes[0]).max() / 1e-7
    assert 1e-3 * bound < largest <= bound * (1 + 1e-3)


@pytest.mark.parametrize("e", [0.02, 0.1, 0.7, 1.0, 1.6, 2.0])
def test_norm_and_its_first_and_second_derivatives(e):
    x, y = np.random.default_rng(0).uniform(0.05, 1.0, (2, 300))
    power = np.longdouble(2) / np.longdouble(e)
    wide = [power * np.log(side.astype(np.longdouble)) for side in (x, y)]
    at = shapes.p_norm(x, y, np.asarray(e))
    assert np.allclose(at.value, np.exp(np.logaddexp(*wide) / power).astype(float), rtol=1e-15)
    assert np.allclose([at.share_x, at.share_y], [x / at.value, y / at.value], rtol=1e-15)
    if e in (0.02, 2.0):
        return
    along = np.random.default_rng(1).normal(size=(2, 300))
    curved = shapes.p_norm_curvature(at, *along, np.asarray(e))

    def norm(place: Any) -> Any:
        return shapes.p_norm(place[0], place[1], place[2])

    def slope(place: Any) -> Any:
        return norm(place).by_x * along[0] + norm(place).by_y * along[1]

    here, clear = np.stack([x, y, np.full(300, e)]), np.minimum(x, y) > 2e-3 * np.maximum(x, y)
    firsts = at.by_x, at.by_y, at.by_exponent
    seconds = curved.by_x, curved.by_y, curved.by_exponent
    for first, second, shift in zip(firsts, seconds, np.eye(3)[:, :, None], strict=True):
        wanted = differences(lambda place: norm(place).value, here, shift)
        assert np.allclose(first, wanted, rtol=0, atol=1e-8)
        wanted = differences(slope, here, shift)
        assert np.allclose(second[clear], wanted[clear], rtol=1e-6, atol=1e-6)
    assert np.allclose(curved.slope, slope(here), rtol=1e-14)
    edge = np.array([0.0, 1.0, 0.0, 1e-200, 1.0]), np.array([1.0, 0.0, 0.0, 1.0, 1e-12])
    bent = shapes.p_norm_curvature(
        shapes.p_norm(*edge, np.asarray(e)), np.ones(5), -np.ones(5), np.asarray(e)
    )
    assert all(np.isfinite(part).all() for part in bent)


@pairs
def test_points_by_angles_lie_on_the_surface_with_its_normals(pair):
    shape = shape_of(pair)
    eta = np.repeat(np.linspace(-0.5 * math.pi, 0.5 * math.pi, 31), 40)
    omega = np.tile(-math.pi + 2.0 * math.pi / 40 * np.arange(40), 31)
    signs = np.column_stack([np.cos(omega), np.sin(omega), np.sin(eta)])
    clear = (np.abs(signs) > 1e-9).all(axis=1) & (np.abs(eta) < 1.5)
    ends = [0.5 * math.pi, -0.5 * math.pi, 0.0, 0.0], [0.3, 0.3, -math.pi, 0.5 * math.pi]
    wanted = np.array([[0, 0, 1], [0, 0, -1], [-1, 0, 0], [0, 1, 0]])  # poles, seam, quarter
    for points_of in (shapes.trigonometric_points, shapes.regular_points):
        points, normals = points_of(shape, eta, omega)
        assert np.abs(shape.gauge(points) - 1.0).max() < 1e-14
        assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-15)
        inner = np.abs(points / SIZE).min(axis=1) > 1e-3  # off the creases
        assert np.abs(normals[inner] - shape.normals(points[inner])).max() < 1e-9
        assert (np.sign(points) == np.sign(signs))[clear & inner].all()
        points, normals = points_of(shape, *ends)
        assert np.array_equal(points[2:], wanted[2:] * SIZE)
        assert np.allclose(points[:2], wanted[:2] * SIZE, atol=1e-16)
        assert (np.einsum("ni,ni->n", normals, wanted) > 0.2).all()


def test_bounds_are_the_semi_axes_where_it_stands():
    shape, shift = shape_of([0.1, 0.1]), np.array([0.1, -0.2, 0.3])
    assert np.array_equal([shape.bounds(), shape.enclosure()], [[-SIZE, SIZE]] * 2)
    axes = rotations_from_vectors(np.array([[0.3, -0.8, 0.5]]))[0]
    upright, turned = (shapes.PosedShape(shape, Pose(shift, a)) for a in (np.eye(3), axes))
    assert np.array_equal(upright.bounds(), shape.bounds() + shift)
    vertices = turned.mesh(6).vertices
    assert np.array_equal(turned.bounds(), [vertices.min(axis=0), vertices.max(axis=0)])


def test_volumes_agree_to_40_digits():
    for pair in ([1e-3, 1e-3], [0.02, 2.0], [0.3, 0.8], [1.0, 1.0], [2.0, 3.0]):
        with mpmath.workdps(40):
            e1, e2 = (mpmath.mpf(e) for e in pair)
            share = 2 * e1 * e2 * mpmath.beta(e1 / 2 + 1, e1) * mpmath.beta(e2 / 2, e2 / 2)
            wanted = float(share * mpmath.fprod(SIZE.tolist()))
        assert shapes.superquadric_volume(SIZE, pair) == pytest.approx(wanted, rel=2e-14)


@pytest.mark.parametrize("pair", [[0.2, 0.2], [1.0, 1.0], [0.5, 1.6], [2.0, 2.0]])
@pytest.mark.parametrize("taper", [[0.0, 0.0], [0.6, -0.4], [-0.9, -0.9]])
def test_moments_are_those_of_fine_meshes(pair, taper):
    shape = shape_of(pair, 10 * SIZE)
    result = shapes.superquadric_moments(shape, taper)
    meshes = [shapes.DeformedSuperquadric(shape, np.array(taper)).mesh(level) for level in (4, 5)]
    # The facets' error falls with the square of their size, but at edges.
    coarse, fine = (solidity(*mesh).volume for mesh in meshes)
    assert result.volume == pytest.approx(fine + (fine - coarse) / 3, rel=1e-4)
    coarse, fine = (
        trimesh.Trimesh(*mesh, process=False).moment_inertia_frame(np.eye(4)) for mesh in meshes
    )
    inertia = fine + (fine - coarse) / 3
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    assert np.allclose(result.second, second, rtol=2e-4, atol=2e-4 * np.abs(second).max())
    assert np.allclose(result.inertia(), np.trace(result.second) * np.eye(3) - result.second)
    # A taper adds what its polynomial says to volume and centroid, exactly.
    plain = shapes.superquadric_moments(shape)
    gain = taper[0] * taper[1] * plain.second[2, 2] / shape.size[2] ** 2
    volume = shapes.superquadric_volume(shape.size, pair) + gain
    assert result.volume == pytest.approx(volume, rel=1e-13)
    rise = sum(taper) * plain.second[2, 2] / shape.size[2] / result.volume
    assert result.centroid == pytest.approx([0.0, 0.0, rise], rel=1e-13)


@pytest.mark.parametrize(
    ("e", "taper", "curvature"),
    [(0.1, (0, 0), 0.0), (1.0, (0.7, -0.5), 0.0), (2.0, (0.4, 0.2), 1.8), (0.4, (0.4, 0.2), 1.8)],
)
def test_area_samples_are_uniform_and_reproducible(e, taper, curvature):
    base, bend = shape_of([e, e], 10 * SIZE), shapes.Bend(curvature, 0.7)
    solid = shapes.DeformedSuperquadric(base, np.array(taper), bend)
    vertices, faces = solid.mesh(6)
    areas = areas_and_normals(vertices[faces])[0]
    surface = shapes.sampled_surface(base, np.array(taper), bend)
    assert surface.area == pytest.approx(areas.sum(), rel=2e-3)

    def features(points: Floats) -> Floats:
        return np.column_stack([points, points**2, np.roll(points, 1, axis=1) * points])

    def deviations(sampled: Floats) -> Floats:
        """Of the features' means from those over the area, in standard errors."""
        wanted = areas @ features(vertices[faces].mean(axis=1)) / areas.sum()
        drawn = features(sampled)
        return np.asarray((drawn.mean(axis=0) - wanted) / (drawn.std(axis=0) / len(drawn) ** 0.5))

    sampled = shapes.area_samples(surface, 20_000, np.random.default_rng(0))
    assert np.abs(solid.gauge(sampled) - 1.0).max() < 1e-12
    assert np.abs(deviations(sampled)).max() < 4.0
    again, other = (shapes.area_samples(surface, 50, np.random.default_rng(n)) for n in (0, 4))
    assert again.shape == (50, 3) and not np.array_equal(again, other)
    assert np.array_equal(again, shapes.area_samples(surface, 50, np.random.default_rng(0)))
    assert shapes.area_samples(surface, 0, np.random.default_rng(3)).shape == (0, 3)
    if e == 0.1:  # even by solid angle is far from even by area
        rays = np.random.default_rng(0).normal(size=(20_000, 3))
        assert np.abs(deviations(rays / base.gauge(rays)[:, None])).max() > 10.0
