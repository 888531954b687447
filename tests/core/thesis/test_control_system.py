"""Laws of (4.25): solved where points determine the control points, else refused."""

import numpy as np
import pytest

from palpate.core.splines import SplineVolume, clamped_basis
from palpate.core.thesis import rebuild_thesis, solve_control_points
from tests.core.thesis.contours import vase

SHAPE = (4, 5, 6)


def deformed(rng: np.random.Generator) -> SplineVolume:
    bases = tuple(clamped_basis(count) for count in SHAPE)
    return SplineVolume(rng.normal(size=(*SHAPE, 3)), bases)


def test_points_inside_lattice_recover_control_points():
    rng = np.random.default_rng(3)
    volume, triples = deformed(rng), rng.random((2000, 3))
    fit = solve_control_points(volume.at(triples), triples, SHAPE)
    assert np.allclose(fit.volume.control, volume.control, rtol=0, atol=1e-14 * fit.condition)
    assert fit.condition < 1e5 and fit.rms < 1e-12


def test_noise_is_amplified_by_condition_at_most():
    rng = np.random.default_rng(4)
    volume, triples = deformed(rng), rng.random((4000, 3))
    noise = 1e-6 * rng.normal(size=(4000, 3))
    exact, noisy = (
        solve_control_points(volume.at(triples) + add, triples, SHAPE) for add in (0.0, noise)
    )
    off = np.linalg.norm(noisy.volume.control - exact.volume.control)
    assert off <= exact.condition * np.linalg.norm(noise)
    assert noisy.rms == pytest.approx(np.sqrt(3.0) * 1e-6, rel=0.1)


def test_surface_points_do_not_determine_lattice():
    solid = rebuild_thesis(vase(9, 40))  # 5 by 5 by 9 control points, as in the thesis
    triples = solid.parameters.reshape(-1, 3)
    with pytest.raises(ValueError, match=r"condition number \S+ for 225 control points") as caught:
        solve_control_points(vase(9, 40).reshape(-1, 3), triples, (5, 5, 9))
    assert float(str(caught.value).split("number ")[1].split()[0]) > 1e15


@pytest.mark.parametrize(("count", "shape", "words"), [
    (100, (4, 4, 3), "at least 4, got"),
    (60, (4, 4, 4), "as many points as control points, 64, got 60"),
])  # fmt: skip
def test_too_few_points_raise(count, shape, words):
    points = np.random.default_rng(5).random((count, 3))
    with pytest.raises(ValueError, match=words):
        solve_control_points(points, points, shape)
    with pytest.raises(ValueError, match="parameters must lie between 0 and 1"):
        solve_control_points(points, 2.0 + points, (4, 4, 4))
