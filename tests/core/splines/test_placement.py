from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.splines.basis import Basis, clamped_basis
from palpate.core.splines.frame import Frame
from palpate.core.splines.knots import uniform_knots
from palpate.core.splines.placement import affine_fit, affine_image, regular_planes
from palpate.core.splines.volume import Volume

BASES = clamped_basis(6), clamped_basis(4, 2), Basis(uniform_knots(5), 3)
FRAME = Frame(np.array([10.0, -3.0, 2.0]), np.array([[0.5, 0.1, 0], [-0.1, 0.25, 0], [0.3, 0, 2]]))
GREVILLE = FRAME.greville_control(BASES)


def test_an_affine_image_of_the_greville_abscissae_is_found_with_its_frame(
    rotations: Callable[[int], Floats],
) -> None:
    for rotation in rotations(4):
        found = affine_image(Volume(GREVILLE @ rotation, BASES))
        assert found is not None
        assert np.allclose(found.corner, FRAME.corner @ rotation, rtol=0, atol=1e-13)
        assert np.allclose(found.edges, FRAME.edges @ rotation, rtol=0, atol=1e-13)


def test_weights_that_are_all_alike_hide_nothing() -> None:
    assert affine_image(Volume(GREVILLE, BASES, np.full((6, 4, 5), 3.0))) is not None


@pytest.mark.parametrize("find", [affine_image, regular_planes])
def test_what_is_bent_weighted_or_flat_has_no_frame(find: Callable[[Volume], object]) -> None:
    bent = GREVILLE.copy()
    bent[2, 1, 3] += 1e-9
    weights = np.ones((6, 4, 5))
    weights[1, 1, 1] = 1.0 + 1e-9
    assert find(Volume(bent, BASES)) is None
    assert find(Volume(GREVILLE, BASES, weights)) is None
    assert find(Volume(GREVILLE * [1, 1, 0], BASES)) is None
    assert find(Volume(np.zeros_like(GREVILLE), BASES)) is None


def test_even_control_points_are_regular_but_no_affine_image() -> None:
    volume = Volume(FRAME.even_control((6, 4, 5)), BASES)
    assert affine_image(volume) is None
    found = regular_planes(volume)
    assert found is not None
    for planes, count in zip(found.planes, (6, 4, 5), strict=True):
        assert np.allclose(planes, np.linspace(0, 1, count), rtol=0, atol=1e-13)


def test_planes_that_do_not_rise_are_not_regular() -> None:
    places = [np.array([0, 0.3, 0.2, 0.5, 0.8, 1]), np.linspace(0, 1, 4), np.linspace(0, 1, 5)]
    control = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1)
    assert regular_planes(Volume(control, BASES)) is None
    assert regular_planes(Volume(np.sort(control, axis=0), BASES)) is not None


def test_the_affine_fit_gives_the_parameters_of_an_affine_image() -> None:
    at = np.random.default_rng(0).random((20, 3))
    points = FRAME.points(at)
    fit = affine_fit(Volume(GREVILLE, BASES))
    assert np.allclose(points @ fit[:3] + fit[3], at, rtol=0, atol=1e-12)


@pytest.mark.parametrize("squeeze", [[1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
def test_the_affine_fit_of_what_is_squeezed_flat_is_finite(squeeze: list[float]) -> None:
    fit = affine_fit(Volume(GREVILLE * squeeze, BASES))
    assert np.isfinite(fit).all()
