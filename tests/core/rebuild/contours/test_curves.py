from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.contours import curves
from palpate.core.rebuild.contours.curves import (
    FINE,
    are_nearly_star_shaped,
    are_star_shaped,
    chord_places,
    curve_places,
    height_residual_of,
    same_steps,
    slice_curve,
    slice_parameters,
)
from palpate.core.splines.closed_curves import fit_closed_curve, order_closed_points


def around(z: Floats) -> Floats:
    angle = 2 * np.pi * np.arange(len(z)) / len(z)
    return np.column_stack([5 + 2 * np.cos(angle), np.sin(angle), z])


def test_a_level_contour_does_not_sway():
    assert height_residual_of(around(np.full(30, 7.3))) == (0.0, 0.0)


@pytest.mark.parametrize("harmonic", [1, 2])
def test_a_tilt_and_a_saddle_are_shape(harmonic):
    z = 1e6 + 0.3 * np.cos(harmonic * 2 * np.pi * np.arange(30) / 30)
    shape, noise = height_residual_of(around(z))
    assert shape == pytest.approx(0.3 / np.sqrt(2), rel=1e-6)
    assert noise < 1e-6


def test_noise_is_not_shape():
    rng = np.random.default_rng(0)
    shapes, noises = np.transpose(
        [height_residual_of(around(0.2 * rng.normal(size=60))) for _ in range(50)]
    )
    assert noises.mean() == pytest.approx(0.2, rel=0.05)
    assert np.sqrt(np.mean(shapes**2)) < 0.05


def test_of_few_points_all_is_shape():
    shape, noise = height_residual_of(around(np.array([0.0, 1.0, 0.0, -1.0])))
    assert shape == pytest.approx(np.sqrt(0.5))
    assert noise == 0.0


def lobed(turns: Floats) -> Floats:
    angle = 2 * np.pi * turns
    radius = 1.0 + 0.2 * np.cos(3 * angle)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def even_ring(count: int, noise: float = 0.0, seed: int = 0) -> Floats:
    angle = 2 * np.pi * np.arange(count) / count
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    return ring + noise * np.random.default_rng(seed).normal(size=ring.shape)


@pytest.mark.parametrize("count", [3, 4, 24, 81])
def test_the_curve_is_that_through_all_points(count):
    rng = np.random.default_rng(count)
    for points in (even_ring(count), lobed(np.sort(rng.random(count)))):
        found = slice_curve(points)
        wanted = fit_closed_curve(points, parameters="even", smoothing=None)
        assert np.array_equal(found.curve.used, wanted.used)
        assert np.abs(found.curve.at(wanted.parameters) - points[wanted.used]).max() < 1e-12
        turns = np.arange(FINE) / FINE
        assert np.abs(found.fine - wanted.at(turns)).max() < 1e-12
        assert found.curve.flags == wanted.flags


def test_points_of_no_curve_are_degenerate():
    assert slice_curve(np.ones((5, 2))).curve.flags.degenerate
    line = np.outer(np.arange(6.0), [1.0, 2.0])
    assert slice_curve(line).curve.flags.degenerate
    assert not slice_curve(line).star


def test_noise_does_not_make_even_steps_uneven():
    for seed in range(5):
        assert same_steps(slice_parameters(order_closed_points(even_ring(81, 0.02, seed)).points))


def test_uneven_steps_are_told_from_noise():
    rng = np.random.default_rng(0)
    for noise in (0.0, 0.002):
        turns = (np.arange(81) + rng.uniform(-0.45, 0.45, 81)) / 81
        points = lobed(turns) + noise * rng.normal(size=(81, 2))
        assert not same_steps(slice_parameters(order_closed_points(points).points))
    dense = np.concatenate([np.linspace(0, 0.5, 60, False), np.linspace(0.5, 1, 20, False)])
    points = lobed(dense) + 0.02 * rng.normal(size=(80, 2))
    assert not same_steps(slice_parameters(order_closed_points(points).points))


def test_even_steps_lose_less_to_noise_than_chords():
    truth = 1.0
    errors: dict[str, list[float]] = {"even": [], "chords": []}
    for seed in range(5):
        points = even_ring(200, 0.02, seed)
        turns = np.arange(400) / 400
        for name, curve in (
            ("even", slice_curve(points).curve),
            ("chords", fit_closed_curve(points, parameters="chord", smoothing=None)),
        ):
            off = np.linalg.norm(curve.at(turns), axis=1) - truth
            errors[name].append(float(np.sqrt((off**2).mean())))
    assert np.mean(errors["even"]) < 0.9 * np.mean(errors["chords"])


def test_many_curves_are_evaluated_at_once():
    curves = [slice_curve(even_ring(n)).curve for n in (5, 24)]
    curves.append(slice_curve(lobed(np.sort(np.random.default_rng(0).random(30)))).curve)
    turns = np.random.default_rng(1).uniform(-1, 2, (3, 17))
    found = curve_places(curves, turns)
    for curve, row, places in zip(curves, turns, found, strict=True):
        assert np.abs(curve.at(row) - places).max() < 1e-13


def test_chords_of_a_fine_curve_are_near_it():
    fine = slice_curve(lobed(np.arange(80) / 80)).fine[None]
    turns = np.linspace(-0.5, 1.5, 41)
    assert np.array_equal(chord_places(fine, np.zeros((1, 1)))[0, 0], fine[0, 0])
    exact = slice_curve(lobed(np.arange(80) / 80)).curve.at(turns)
    assert np.abs(chord_places(fine, turns[None])[0] - exact).max() < 2e-4


TURN = 2 * np.pi * np.arange(256) / 256
CIRCLE = np.stack([np.cos(TURN), np.sin(TURN)], axis=-1)


def test_noise_that_goes_back_a_little_is_told_from_a_shape_that_does():
    rng = np.random.default_rng(0)
    noisy = CIRCLE + 0.02 * rng.normal(size=CIRCLE.shape)
    # A hook: the outline goes back behind itself by half a radian.
    angle = TURN + 0.6 * np.sin(4 * TURN)
    hooked = (1 + 0.3 * np.cos(4 * TURN))[:, None] * np.stack(
        [np.cos(angle), np.sin(angle)], axis=-1
    )
    clockwise = CIRCLE[::-1]
    figures = np.stack([CIRCLE, noisy, hooked, clockwise, CIRCLE + [3.0, 0.0]])
    assert are_star_shaped(figures).tolist() == [True, False, False, False, False]
    assert are_nearly_star_shaped(figures).tolist() == [True, True, False, False, False]


def test_curves_of_even_steps_are_sampled_by_one_matrix():
    ring = order_closed_points(even_ring(24, 0.01))
    fit = curves._through(ring.points, np.arange(24) / 24)
    fine = curves._even_matrix(24) @ fit.control
    assert np.array_equal(curves._seen(ring, fit).fine, ring.middle + ring.size * fine)
