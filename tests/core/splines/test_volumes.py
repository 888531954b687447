"""Laws of spline volumes, their frames, and the inversion of points."""

import functools
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from palpate.core.arrays import Floats
from palpate.core.splines import (
    Bases,
    Basis,
    Inversion,
    Parallelepiped,
    SplineVolume,
    affine_fit,
    clamped_basis,
    invert_points,
    upright_parallelepiped,
)

RNG = np.random.default_rng(7)
EPSILON = np.finfo(float).eps
UNIFORM = Basis(np.arange(-2, 6) / 3.0, 2)  # Even knots that continue beyond [0, 1]
BASES: Bases = (clamped_basis(6), clamped_basis(3, 2), UNIFORM)
CONTROL = RNG.normal(size=(6, 3, 5, 3))
WEIGHTS = RNG.uniform(0.3, 3.0, (6, 3, 5))
AT = np.concatenate([RNG.random((40, 3)), [[0, 0, 0], [1, 1, 1], [0, 1, 0.5]]])
VOLUMES = [SplineVolume(CONTROL, BASES), SplineVolume(CONTROL, BASES, WEIGHTS)]


@pytest.mark.parametrize("volume", VOLUMES, ids=["polynomial", "rational"])
def test_points_and_derivatives_are_those_of_weighted_means(volume: SplineVolume):
    rows = [basis.matrix(x).toarray() for basis, x in zip(BASES, AT.T, strict=True)]
    shares = np.einsum("na,nb,nc->nabc", *rows)
    shares = shares * (1.0 if volume.weights is None else WEIGHTS)
    shares = (shares / shares.sum(axis=(1, 2, 3), keepdims=True)).reshape(len(AT), -1)
    assert np.allclose(volume.shares(AT).toarray(), shares, rtol=0, atol=1e-14)
    assert np.allclose(volume.at(AT), shares @ CONTROL.reshape(-1, 3), rtol=0, atol=1e-14)
    axes = np.linspace(0, 1, 4), np.linspace(0, 1, 3), np.linspace(0, 1, 5)
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    wanted = volume.at(places.reshape(-1, 3)).reshape(places.shape)
    assert np.allclose(volume.grid(*axes), wanted, rtol=0, atol=1e-14)
    assert volume.shares(np.zeros((0, 3))).shape == (0, 90)
    matrix, shift = RNG.normal(size=(3, 3)), RNG.normal(size=3)
    image = SplineVolume(CONTROL @ matrix + shift, BASES, volume.weights)
    assert np.allclose(image.at(AT), volume.at(AT) @ matrix + shift, rtol=0, atol=1e-13)
    # Derivatives are quotients of differences.
    at, step = RNG.uniform(0.01, 0.99, (30, 3)), 1e-6
    points, slopes, bends = volume.second(at)
    assert np.allclose(points, volume.at(at), rtol=0, atol=1e-14)
    assert np.allclose(volume.first(at)[0], points, rtol=0, atol=1e-14)
    assert np.allclose(volume.first(at)[1], slopes, rtol=0, atol=1e-12)
    for axis, unit in enumerate(np.eye(3)):
        (high, rising), (low, falling) = (volume.first(at + k * step * unit) for k in (1, -1))
        assert np.allclose(slopes[:, :, axis], (high - low) / (2 * step), rtol=0, atol=1e-6)
        quotient = (rising - falling) / (2 * step)
        assert np.allclose(bends[:, :, :, axis], quotient, rtol=0, atol=1e-4)


EDGES = np.array([[0.5, 0.1, 0.0], [-0.1, 0.25, 0.0], [0.3, 0.0, 2.0]])
CORNER = np.array([-0.1, 0.2, 0.3])
FRAME = Parallelepiped(CORNER, EDGES)


@pytest.mark.parametrize("size", [1e-200, 1e-9, 1.0, 1e9, 1e150])
def test_frame_coordinates_are_affine_at_any_size(size: float):
    frame = Parallelepiped(size * CORNER, size * EDGES)
    assert not frame.local(size * CORNER[None]).any()
    assert np.allclose(frame.local(size * (CORNER + EDGES)), np.eye(3), rtol=0, atol=1e-14)
    points = size * RNG.normal(size=(50, 3))
    local = np.linalg.solve(EDGES.T, (points / size - CORNER).T).T
    assert np.allclose(frame.local(points), local, rtol=0, atol=1e-13)
    assert np.allclose(frame.points(frame.local(points)), points, rtol=0, atol=1e-13 * size)
    beyond = np.abs(frame.local(size * (CORNER + EDGES)) - np.eye(3)).max()
    assert beyond <= frame.rounding(size * (CORNER + EDGES)) < 1e-12
    if size == 1.0:
        assert frame.volume == pytest.approx(np.linalg.det(EDGES))
        assert Parallelepiped(CORNER, EDGES[::-1]).volume < 0.0


def test_arrays_of_volumes_and_frames_are_private_copies():
    edges, control = EDGES.copy(), CONTROL.copy()
    frame, volume = Parallelepiped(CORNER, edges), SplineVolume(control, BASES, WEIGHTS)
    edges[0, 0] = control[0, 0, 0, 0] = 9.0
    assert frame.edges[0, 0] == 0.5 and volume.control[0, 0, 0, 0] == CONTROL[0, 0, 0, 0]
    for kept in (frame.inverse, frame.corner, volume.control, volume.weights, volume.spline):
        with pytest.raises(ValueError, match="read-only"):
            kept[0] = 1.0


CUBE = Parallelepiped(-np.ones(3), 2.0 * np.eye(3))
SKEWED = Parallelepiped(
    np.array([3.0, -1.0, 0.5]), np.array([[2, 0.3, 0], [-0.4, 1, 0], [0.5, 0, 3.0]])
)
FINE: Bases = (clamped_basis(7), clamped_basis(7), clamped_basis(9))
LONG: Bases = (clamped_basis(5), clamped_basis(5), clamped_basis(27))
PLACES = np.random.default_rng(0).random((300, 3))


def noisy(amplitude: float, seed: int = 0) -> SplineVolume:
    """A deformed volume; the amplitude is a fraction of a quarter of its size."""
    control = CUBE.greville_control(FINE)
    noise = np.random.default_rng(seed).normal(size=control.shape)
    return SplineVolume(control + 0.5 * amplitude * noise, FINE)


def inverted(volume: SplineVolume, points: Floats) -> Inversion:
    """The inversion, after a check that its residuals are those of its parameters."""
    result = invert_points(volume, points)
    assert ((result.parameters >= 0.0) & (result.parameters <= 1.0)).all()
    left = np.linalg.norm(volume.at(result.parameters) - points, axis=1)
    size = float(np.abs(volume.control).max())
    assert np.allclose(result.residual, left, rtol=1e-6, atol=64 * EPSILON * size)
    return result


@pytest.mark.parametrize("frame", [CUBE, SKEWED], ids=["upright", "skewed"])
def test_undeformed_volumes_are_inverted_in_closed_form(frame: Parallelepiped):
    for turn in [Rotation.identity(), *Rotation.random(3, random_state=1)]:
        for weights in (None, np.full((5, 5, 27), 3.0)):
            volume = SplineVolume(frame.greville_control(LONG) @ turn.as_matrix(), LONG, weights)
            points = frame.points(PLACES) @ turn.as_matrix()
            result = inverted(volume, points)
            assert np.allclose(result.parameters, PLACES, rtol=0, atol=32 * EPSILON)
            assert result.residual.max() <= 16 * EPSILON * np.abs(volume.control).max()
            assert result.converged.all() and not result.folded.any() and not result.steps.any()
            fit = affine_fit(volume)
            assert np.allclose(points @ fit[:3] + fit[3], PLACES, rtol=0, atol=1e-12)


@given(
    st.integers(1, 5),
    st.lists(st.floats(1e-6, 1.0), min_size=6, max_size=12),
    st.sampled_from([1e-9, 1.0, 1e9]),
)
@settings(derandomize=True, deadline=None, max_examples=30)
def test_any_rising_planes_are_inverted_to_rounding(degree: int, rises: list[float], scale: float):
    planes = np.cumsum([0.0, *rises])
    bases = clamped_basis(len(planes), degree), clamped_basis(4), clamped_basis(4)
    axes = planes, np.arange(4.0), np.arange(4.0)
    control = scale * np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    volume = SplineVolume(control, bases)
    along = np.concatenate([np.random.default_rng(0).random(30), bases[0].breaks()])
    points = volume.at(np.column_stack([along, 0.3 + 0 * along, 0.6 + 0 * along]))
    result = inverted(volume, points)
    assert result.converged.all() and result.steps.max() <= 60
    reached = volume.at(result.parameters)
    assert np.abs(reached - points).max() <= 32 * EPSILON * scale * max(planes[-1], 3.0)


def test_spline_with_nearly_no_slope_is_inverted():
    # The slope is nearly 3 x^2: Newton's method alone creeps to a root near 0.
    axes = np.array([0, 1e-12, 2e-12, 1.0]), np.arange(4.0), np.arange(4.0)
    control = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    volume = SplineVolume(control, (clamped_basis(4), clamped_basis(4), clamped_basis(4)))
    result = inverted(volume, np.array([[0, 1.5, 1.5], [1e-9, 1.5, 1.5], [1.0, 1.5, 1.5]]))
    assert result.parameters[[0, 2], 0].tolist() == [0.0, 1.0]
    assert result.parameters[1, 0] == pytest.approx(1e-3, rel=1e-5)


@pytest.mark.parametrize(("amplitude", "is_weighted"), [(0.1, False), (0.2, False), (0.1, True)])
def test_all_points_of_sound_volumes_are_inverted(amplitude: float, is_weighted: bool):
    weights = np.random.default_rng(3).uniform(0.3, 3, (7, 7, 9)) if is_weighted else None
    volume = SplineVolume(noisy(amplitude).control, FINE, weights)
    result = inverted(volume, volume.at(PLACES))
    assert result.converged.all() and not result.folded.any() and result.residual.max() <= 1e-11
    assert np.abs(result.parameters - PLACES).max() < 1e-8
    # Neither an affine image nor the unit changes the answer.
    matrix = np.array([[1.2, 0.3, 0], [-0.1, 0.8, 0.2], [0.4, 0, 1.1]])
    for control in (volume.control @ matrix + [5.0, 0.0, -2.0], volume.control * [-1, 1, 1]):
        image = SplineVolume(control, FINE, volume.weights)
        there = inverted(image, image.at(PLACES))
        assert np.allclose(there.parameters, PLACES, rtol=0, atol=1e-8) and not there.folded.any()
    for scale in (1e-140, 1e-9, 1e9, 1e140):
        scaled = SplineVolume(scale * volume.control, FINE, volume.weights)
        there = invert_points(scaled, scaled.at(PLACES))
        assert np.allclose(there.parameters, PLACES, rtol=0, atol=1e-8)
        assert np.array_equal(there.steps, result.steps) and not there.folded.any()


def test_faces_edges_and_corners_are_inverted_in_8_steps():
    volume = noisy(0.1, seed=3)
    ends = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
    face, edge = PLACES * [0.0, 1.0, 1.0], PLACES[:100] * [0.0, 0.0, 1.0] + [1.0, 0.0, 0.0]
    at = np.concatenate([ends, face, edge])
    result = inverted(volume, volume.at(at))
    assert result.converged.all() and 0 < result.steps.max() <= 8
    assert np.abs(result.parameters - at).max() < 1e-9


@pytest.mark.parametrize("change", [0.0, 1e-7])
def test_small_bend_is_not_taken_for_an_affine_image(change: float):
    control = CUBE.greville_control(FINE).copy()
    control[2, 1, 3] += change
    weights = np.ones((7, 7, 9))
    weights[1, 1, 1] += change
    for volume in (SplineVolume(control, FINE), SplineVolume(control, FINE, weights)):
        points = volume.at(PLACES)
        result = inverted(volume, points)
        assert result.converged.all() and result.steps.any() == (change > 0.0)
        assert np.abs(volume.at(result.parameters) - points).max() < 1e-11


@pytest.mark.parametrize("hand", [1.0, -1.0])
def test_ring_is_not_folded(hand: float):
    bases = clamped_basis(17), clamped_basis(4), clamped_basis(4)
    axes = 1.98 * np.pi * np.linspace(0, 1, 17), np.linspace(1, 2, 4), np.linspace(0, 1, 4)
    angle, radius, height = np.meshgrid(*axes, indexing="ij")
    ring = np.stack([radius * np.cos(angle), hand * radius * np.sin(angle), height], axis=-1)
    result = inverted(SplineVolume(ring, bases), SplineVolume(ring, bases).at(PLACES[:100]))
    assert result.converged.all() and not result.folded.any()
    assert np.allclose(result.parameters, PLACES[:100], rtol=0, atol=1e-9)


def test_folded_volumes_lose_few_points_and_flag_folds():
    volume = noisy(0.85, seed=9)
    points, slopes = volume.first(np.random.default_rng(0).random((1000, 3)))
    assert 0.15 < (np.linalg.det(slopes) < 0.0).mean() < 0.2
    result = inverted(volume, points)
    assert (~result.converged).mean() <= 0.01
    assert result.residual[result.converged].max() < 1e-8
    there = np.linalg.det(volume.first(result.parameters)[1]) <= 0.0
    assert result.folded.any() and np.array_equal(result.folded, there)


@pytest.mark.parametrize("squeeze", [[1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
def test_squeezed_volumes_have_finite_parameters_and_are_folded(squeeze: list[float]):
    volume = SplineVolume(CUBE.greville_control(FINE) * squeeze, FINE)
    assert np.isfinite(affine_fit(volume)).all()
    result, away = (inverted(volume, volume.at(PLACES[:20]) + [0, 0, z]) for z in (0.0, 0.5))
    assert result.converged.all() and not away.converged.any()
    assert result.folded.all() and away.folded.all()
    assert np.isfinite(away.residual).all()


def test_points_outside_get_the_nearest_point():
    volume = noisy(0.1, seed=3)
    away = np.random.default_rng(1).normal(size=(60, 3))
    points = 3.0 * away / np.linalg.norm(away, axis=1, keepdims=True)
    skewed = SplineVolume(SKEWED.greville_control(LONG), LONG)
    beyond = SKEWED.points(np.array([[1.2, 1.3, 0.5], [-0.4, 0.2, 1.2]]))
    axis = np.linspace(0.0, 1.0, 25)
    for solid, outside in ((volume, points), (skewed, beyond)):
        result = inverted(solid, outside)
        assert not result.converged.any()
        assert ((result.parameters == 0.0) | (result.parameters == 1.0)).any(axis=1).all()
        reached = solid.grid(axis, axis, axis).reshape(-1, 3)
        nearest = np.linalg.norm(outside[:, None] - reached, axis=2).min(axis=1)
        assert (result.residual <= 1.03 * nearest).all()
    clipped = SKEWED.points(np.array([[1.0, 1.0, 0.5]]))[0]
    result = inverted(skewed, np.insert(beyond, 1, SKEWED.points(PLACES[:1]), axis=0))
    assert result.converged.tolist() == [False, True, False]
    assert result.residual[0] < 0.999 * np.linalg.norm(clipped - beyond[0])


volume = functools.partial(SplineVolume, CONTROL, BASES)
LONGER = Basis(2.0 * clamped_basis(6).knots, 3)
METHODS, OUTSIDE = ("at", "first", "second", "shares"), np.array([[0.5, 0.5, 1.1]])


@pytest.mark.parametrize(("call", "words"), [
    (lambda: SplineVolume(CONTROL[:5], BASES), r"shape \(6, 3, 5, 3\), got \(5, 3, 5, 3\)"),
    (lambda: SplineVolume(CONTROL * math.nan, BASES), "control must be finite"),
    (lambda: volume(weights=WEIGHTS[:, :, :4]), r"weights must have shape \(6, 3, 5\)"),
    (lambda: volume(weights=WEIGHTS * math.inf), "weights must be finite"),
    (lambda: volume(weights=WEIGHTS - WEIGHTS.min()), "weights must be positive, got 0"),
    (lambda: volume(weights=0.0 * WEIGHTS - 1.0), "weights must be positive, got -1"),
    (lambda: SplineVolume(CONTROL, (LONGER, *BASES[1:])), r"along s must span 0 to 1, got \(0.0, "),
    (lambda: SplineVolume(CONTROL[:, :, 0], BASES[:2]), "must be three, for s, t and u, got 2"),
    (lambda: Parallelepiped(CORNER[:2], EDGES), r"corner must have shape \(3\)"),
    (lambda: Parallelepiped(CORNER, EDGES[:2]), r"edges must have shape \(3, 3\)"),
    (lambda: Parallelepiped(CORNER * math.inf, EDGES), "corner must be finite"),
    (lambda: Parallelepiped(CORNER, EDGES * math.nan), "edges must be finite"),
    (lambda: Parallelepiped(CORNER, EDGES * [[0], [1], [1]]), r"edges must have a length, got"),
    (lambda: Parallelepiped(CORNER, EDGES * [[1], [1], [0]]), r"edges must have a length, got"),
    (lambda: Parallelepiped(CORNER, EDGES[[0, 1, 0]]), "edges must not lie in a plane"),
    (lambda: upright_parallelepiped(CORNER, [1, 0, 1]), r"must be positive, got \[1.0, 0.0,"),
    (lambda: upright_parallelepiped(CORNER, -np.ones(3)), "extent must be positive"),
    (lambda: upright_parallelepiped(CORNER * math.inf, np.ones(3)), "low must be finite"),
    (lambda: FRAME.even_control((2, 1, 2)), r"must be at least 2 along each edge, got \(2, 1"),
    (lambda: invert_points(noisy(0.1), np.zeros(3)), r"points must have shape \(any, 3\)"),
    (lambda: invert_points(noisy(0.1), np.full((2, 3), math.nan)), "points must be finite"),
    *((lambda name=name: getattr(VOLUMES[0], name)(OUTSIDE), "x must lie in the domain from 0 to 1")
      for name in METHODS),
    *((lambda name=name: getattr(VOLUMES[0], name)(OUTSIDE[:, :2]), r"shape \(any, 3\), got \(1, 2")
      for name in METHODS),
])  # fmt: skip
def test_bad_input_is_refused(call, words: str):
    with pytest.raises(ValueError, match=words):
        call()
