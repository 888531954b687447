from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from palpate.core.shapes.bend import Bend
from palpate.core.shapes.protocol import Mesh
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.superquadric_measures import moments, volume
from palpate.core.shapes.warped import WarpedSuperquadric

SIZE = np.array([0.3, 0.2, 0.4])


def by_tetrahedra(mesh: Mesh) -> tuple[float, np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    """Volume and second moments of a closed mesh, exactly."""
    corners = mesh.vertices[mesh.faces]
    six = np.einsum("mi,mi->m", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    total = corners.sum(axis=1)
    second = np.einsum("m,mci,mcj->ij", six, corners, corners)
    second += np.einsum("m,mi,mj->ij", six, total, total)
    return float(six.sum() / 6.0), second / 120.0


def test_volumes_of_known_solids() -> None:
    product = float(np.prod(SIZE))
    assert volume(SIZE, [1.0, 1.0]) == pytest.approx(4 / 3 * math.pi * product, rel=1e-14)
    assert volume(SIZE, [1e-12, 1e-12]) == pytest.approx(8 * product, rel=1e-11)
    assert volume(SIZE, [2.0, 2.0]) == pytest.approx(4 / 3 * product, rel=1e-14)
    assert volume(SIZE, [1e-12, 1.0]) == pytest.approx(2 * math.pi * product, rel=1e-11)


@pytest.mark.parametrize("exponents", [[1e-3, 1e-3], [0.02, 2.0], [0.3, 0.8], [2.0, 1.5]])
def test_the_volume_has_14_digits(exponents: list[float]) -> None:
    with mpmath.workdps(40):
        e1, e2 = (mpmath.mpf(e) for e in exponents)
        beta = mpmath.beta
        shape = 2 * e1 * e2 * beta(e1 / 2 + 1, e1) * beta(e2 / 2, e2 / 2)
        wanted = float(shape * mpmath.fprod(SIZE.tolist()))
    assert volume(SIZE, exponents) == pytest.approx(wanted, rel=2e-14)


def test_the_moments_of_a_ball_and_of_a_nearly_square_box() -> None:
    ball = moments(Superquadric(np.full(3, 0.5), np.ones(2)))
    assert np.allclose(ball.second, 4 * math.pi / 15 * 0.5**5 * np.eye(3), rtol=1e-14)
    assert np.allclose(ball.inertia(), 8 * math.pi / 15 * 0.5**5 * np.eye(3), rtol=1e-14)
    box = moments(Superquadric(SIZE, np.full(2, 0.02)))
    assert np.diagonal(box.second) == pytest.approx(8 * np.prod(SIZE) * SIZE**2 / 3, rel=5e-3)


@pytest.mark.parametrize("exponents", [[0.2, 0.2], [1.0, 1.0], [0.5, 1.6], [2.0, 2.0]])
@pytest.mark.parametrize("taper", [[0.0, 0.0], [0.6, -0.4], [-0.9, -0.9]])
def test_moments_are_those_of_a_fine_mesh(exponents: list[float], taper: list[float]) -> None:
    shape = Superquadric(SIZE, np.array(exponents))
    found = moments(shape, taper)
    coarse, fine = (
        by_tetrahedra(WarpedSuperquadric(shape, np.array(taper)).mesh(level)) for level in (5, 6)
    )
    # The facets' error falls with the square of their size, but at edges.
    content = fine[0] + (fine[0] - coarse[0]) / 3
    second = fine[1] + (fine[1] - coarse[1]) / 3
    assert found.volume == pytest.approx(content, rel=3e-5)
    assert np.allclose(found.second, second, rtol=5e-5, atol=5e-5 * np.abs(second).max())


def test_a_taper_adds_the_moment_that_its_polynomial_says() -> None:
    shape = Superquadric(SIZE, np.array([0.7, 1.2]))
    plain, tapered = moments(shape), moments(shape, [0.5, -0.6])
    assert plain.volume == pytest.approx(volume(SIZE, [0.7, 1.2]), rel=1e-14)
    gain = 0.5 * -0.6 * plain.second[2, 2] / SIZE[2] ** 2
    assert tapered.volume == pytest.approx(plain.volume + gain, rel=1e-14)
    rise = (0.5 - 0.6) * plain.second[2, 2] / SIZE[2]
    assert tapered.centroid == pytest.approx([0.0, 0.0, rise / tapered.volume], rel=1e-13)


def test_a_bend_keeps_the_volume() -> None:
    shape = Superquadric(SIZE, np.array([0.7, 1.2]))
    taper = np.array([0.3, -0.2])
    straight, bent = (
        by_tetrahedra(WarpedSuperquadric(shape, taper, Bend(k, 0.4)).mesh(6))[0] for k in (0.0, 1.5)
    )
    assert bent == pytest.approx(straight, rel=2e-4)


def test_what_has_no_volume_is_refused() -> None:
    with pytest.raises(ValueError, match=r"size must be positive, got \[0.0, 1.0, 1.0\] m"):
        volume([0.0, 1.0, 1.0], [1.0, 1.0])
    with pytest.raises(ValueError, match=r"exponents must be positive, got \[0.0, 1.0\]"):
        volume(SIZE, [0.0, 1.0])
    with pytest.raises(ValueError, match="taper must lie between -1 and 1"):
        moments(Superquadric(SIZE, np.ones(2)), [1.0, 0.0])
