"""Laws of the checks that public functions begin with, and of the spread of errors."""

import math

import numpy as np
import pytest

from palpate.core import arrays
from palpate.core.arrays import finite_array, not_negative, positive


def test_good_values_pass_as_floats():
    array = finite_array("size", [1, 2, 3], (3,))
    assert array.dtype == np.float64 and array.tolist() == [1.0, 2.0, 3.0]
    for count in (0, 1, 7):
        assert finite_array("points", np.zeros((count, 3)), (None, 3)).shape == (count, 3)
    for value in (5e-324, 1.0, 1e308, 3):
        for check in (positive, not_negative):
            passed = check("pitch", value, "m")
            assert passed == value and isinstance(passed, float)
    assert not_negative("pitch", 0, "m") == 0.0
    assert arrays.in_metres("reach", 2.0, 2.0) == 2.0
    arrays.check_extent("points", np.array([[1.0, 0.0], [3.0, 1.5]]), 2.0)
    arrays.check_extent("points", np.zeros((0, 3)), 2.0)


@pytest.mark.parametrize("sigma_of", [arrays.scaled_mad, arrays.probable_error_sigma])
def test_normal_noise_has_its_deviation_despite_gross_errors(sigma_of):
    errors = np.random.default_rng(1).normal(0.0, 2.5, 200_001)
    assert sigma_of(errors) == pytest.approx(2.5, rel=0.01)
    errors[:200] = 1e9
    assert sigma_of(errors) == pytest.approx(2.5, rel=0.01)
    assert sigma_of(-errors) == sigma_of(errors)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        *((lambda n=n: finite_array("size", np.zeros(n), (None, 4)),
           r"size must have shape \(any, 4\), got \(") for n in ((), (2,), (3, 1), (3, 3))),
        *((lambda x=x: finite_array("size", [1.0, x], (2,)), "size must be finite")
          for x in (math.nan, math.inf, -math.inf)),
        (lambda: finite_array("size", [[1.0, 2.0], [3.0]], (None,)),
         "size must be an array of numbers, got rows of many lengths"),
        (lambda: finite_array("size", ["1"], (None,)), "must be an array of real numbers, got <U1"),
        (lambda: finite_array("size", [1j], (None,)), "of real numbers, got complex128"),
        (lambda: finite_array("size", [None], (None,)), "of real numbers, got object"),
        *((lambda x=x: positive("pitch", x, "m"),
           rf"pitch must be positive and finite, got {x} m$")
          for x in (0.0, -1.0, math.inf, -math.inf, math.nan)),
        *((lambda x=x: not_negative("pitch", x, "m"),
           rf"pitch must be 0 or more and finite, got {x} m$")
          for x in (-1.0, math.inf, -math.inf, math.nan)),
        (lambda: arrays.in_metres("reach", 30.0, 2.0), "reach is 30 m, and at most 2 m .*milli"),
        (lambda: arrays.check_extent("points", np.array([[1.0], [-2.0]]), 2.0),
         r"points span 3 m, and at most 2 m is meant here.* multiply millimetres by 0\.001"),
    ],
)  # fmt: skip
def test_bad_values_are_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()
