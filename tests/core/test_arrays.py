import math

import numpy as np
import pytest

from palpate.core.arrays import finite_array, positive, probable_error_sigma, scaled_mad


def test_lists_and_integers_become_float_arrays():
    array = finite_array("size", [1, 2, 3], (3,))
    assert array.dtype == np.float64
    assert array.tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("count", [0, 1, 7])
def test_none_stands_for_any_length(count):
    assert finite_array("points", np.zeros((count, 3)), (None, 3)).shape == (count, 3)


@pytest.mark.parametrize("shape", [(), (2,), (3, 1), (3, 3)])
def test_another_shape_is_refused_with_both_shapes(shape):
    with pytest.raises(ValueError, match=r"size must have shape \(any, 4\), got \("):
        finite_array("size", np.zeros(shape), (None, 4))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_an_array_that_is_not_finite_is_refused(bad):
    with pytest.raises(ValueError, match="size must be finite"):
        finite_array("size", [1.0, bad, 3.0], (3,))


@pytest.mark.parametrize("value", [5e-324, 1.0, 1e308, 3])
def test_positive_numbers_pass_as_floats(value):
    passed = positive("pitch", value, "m")
    assert passed == value
    assert isinstance(passed, float)


@pytest.mark.parametrize("value", [0.0, -1.0, math.inf, -math.inf, math.nan])
def test_what_is_not_positive_and_finite_is_refused(value):
    with pytest.raises(ValueError, match=rf"pitch must be positive and finite, got {value} m$"):
        positive("pitch", value, "m")


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ([[1.0, 2.0], [3.0]], "size must be an array of numbers, got rows of many lengths"),
        (["1", "2"], "size must be an array of real numbers, got <U1"),
        ([1.0, 2.0 + 1.0j], "size must be an array of real numbers, got complex128"),
        ([None, 1.0], "size must be an array of real numbers, got object"),
    ],
)
def test_what_is_no_array_of_real_numbers_is_refused(value, words):
    with pytest.raises(ValueError, match=words):
        finite_array("size", value, (None,))


@pytest.mark.parametrize("sigma_of", [scaled_mad, probable_error_sigma])
def test_normal_noise_has_its_standard_deviation_though_a_few_errors_are_gross(sigma_of):
    errors = np.random.default_rng(1).normal(0.0, 2.5, 200_001)
    assert sigma_of(errors) == pytest.approx(2.5, rel=0.01)
    errors[:200] = 1e9
    assert sigma_of(errors) == pytest.approx(2.5, rel=0.01)
    assert sigma_of(-errors) == sigma_of(errors)
