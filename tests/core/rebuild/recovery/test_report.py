"""Outliers, certainty, cover and canonical descriptions: small parts of the recovery."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.core.poses import rotations_from_vectors
from palpate.core.rebuild.recovery.report import (
    CanonicalSolid,
    canonical,
    caution,
    certainty,
    looseness,
    outlyingness,
    uncovered,
)
from palpate.core.shapes.deformed_superquadrics import DeformedSuperquadric
from palpate.core.shapes.global_deformations import Bend
from palpate.core.shapes.superquadrics import Superquadric
from palpate.core.shapes.tessellations import icosphere


def test_points_far_from_the_others_are_outlying_whichever_way_they_are_turned():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(60, 3)) * [1.0, 0.5, 0.1]
    points[:9] = rng.uniform(-1, 1, (9, 3)) * 5 + [0, 0, 3]
    apart = outlyingness(points)
    assert apart[:9].min() > np.quantile(apart[9:], 0.9)
    turn = rotations_from_vectors(np.array([[0.3, -1.0, 2.0]]))[0]
    assert np.allclose(outlyingness(1e-3 * points @ turn.T + 0.1), apart, rtol=1e-6)


def test_flat_and_identical_points_have_finite_distances():
    flat = np.random.default_rng(0).normal(size=(30, 3)) * [1.0, 1.0, 0.0]
    assert np.isfinite(outlyingness(flat)).all()
    assert np.isfinite(outlyingness(np.ones((30, 3)))).all()


def test_the_covariance_is_that_of_linear_least_squares():
    jacobian = np.random.default_rng(1).normal(size=(200, 4))
    covariance, rank, condition = certainty(jacobian, 1e-3, np.ones(4, bool))
    assert rank == 4
    assert condition < 2.0
    assert np.allclose(covariance, 1e-6 * np.linalg.inv(jacobian.T @ jacobian), rtol=1e-4)


def test_what_the_points_do_not_determine_keeps_a_bounded_variance():
    jacobian = np.random.default_rng(1).normal(size=(200, 4))
    jacobian[:, 1], jacobian[:, 3] = 0.0, jacobian[:, 2]
    covariance, rank, _ = certainty(jacobian, 1e-3, np.ones(4, bool))
    assert rank == 2
    assert covariance[1, 1] == pytest.approx(1.0)
    assert covariance[2, 2] == pytest.approx(0.5, rel=1e-3)
    assert np.isfinite(certainty(jacobian, 0.0, np.ones(4, bool))[0]).all()


def test_what_was_not_fitted_has_no_variance():
    jacobian = np.random.default_rng(1).normal(size=(200, 3))
    covariance, rank, _ = certainty(jacobian, 1e-3, np.array([True, False, True]))
    assert rank == 2
    assert not covariance[1].any()
    assert covariance[2, 2] > 0


def test_half_a_ball_without_points_is_half_uncovered():
    surface, area = icosphere(3)[0], 4 * np.pi
    points = np.random.default_rng(2).normal(size=(200, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    assert uncovered(surface, area, points, 0.0) < 0.06  # exp(-pi) is 0.043
    upper = points[points[:, 2] > 0]
    assert 0.3 < uncovered(surface, area, upper, 0.0) < 0.5
    assert uncovered(surface, area, points[:1], 10.0) == 0.0


@pytest.mark.parametrize("vector", [[0.1, 0.2, 0.3], [3.0, 0.1, 0.0], [1.0, 1.0, -2.0]])
def test_the_canonical_description_is_of_the_same_solid_and_the_least_turned(vector):
    given = CanonicalSolid(
        np.array([0.2, 0.5, 0.6]),
        np.array([0.4, 1.2]),
        rotations_from_vectors(np.array([vector]))[0],
        np.array([0.4, -0.2]),
        np.array([0.3, 0.7]),
    )
    found = canonical(given)
    assert found.size.tolist() == [0.5, 0.2, 0.6]
    assert np.linalg.det(found.axes) == pytest.approx(1.0)
    again = canonical(found)
    assert np.array_equal(again.axes, found.axes)

    def solid(one: CanonicalSolid) -> DeformedSuperquadric:
        bend = Bend(float(np.hypot(*one.bend)), float(np.arctan2(one.bend[1], one.bend[0])))
        return DeformedSuperquadric(Superquadric(one.size, one.exponents), one.taper, bend)

    places = solid(found).mesh(2).vertices @ found.axes.T
    assert np.abs(solid(given).gauge(places @ given.axes) - 1.0).max() < 1e-13


def test_the_scatter_of_few_points_may_be_far_larger_than_found():
    factors = [caution(left) for left in (1, 2, 9, 49, 5000)]
    assert factors == sorted(factors, reverse=True)
    assert factors[0] == pytest.approx(1.0 / 0.1257, rel=1e-3)  # of a normal deviate, one in ten
    assert factors[-1] == pytest.approx(1.0, abs=0.02)
    assert caution(0) == 1.0


def test_looseness_is_the_deviation_along_the_normal():
    jacobian, covariance = np.zeros((2, 11)), np.diag(np.arange(1.0, 12.0))
    jacobian[0, 0], jacobian[1, 8] = 3.0, 2.0
    assert looseness(jacobian, covariance, np.ones(2)) == pytest.approx(np.sqrt((9 + 36) / 2))


def test_an_exponent_near_0_that_might_be_anything_makes_nothing_loose():
    jacobian, covariance = np.zeros((1, 11)), np.zeros((11, 11))
    jacobian[0, 3] = covariance[3, 3] = 1.0
    assert looseness(jacobian, covariance, np.array([0.02, 1.0])) == pytest.approx(0.02)
    assert looseness(jacobian, covariance, np.array([1.5, 1.0])) == pytest.approx(1.0)
