import numpy as np
import pytest

from palpate.core.splines import coons_patch


def test_the_printed_patch_has_a_corner_twice_and_no_boundary_curves():
    rng = np.random.default_rng(3)
    corners = rng.normal(size=(2, 2, 3))  # C(u, v) by u, then by v
    u, v = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 7))
    weights = (1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v
    named = (0, 0), (0, 1), (0, 1), (1, 1)  # as the second line of (1.3) expands the first
    printed = sum(w[..., None] * corners[one] for w, one in zip(weights, named, strict=True))
    assert printed[0, -1] == pytest.approx(corners[0, 1])  # where u is 1 and v is 0
    assert np.linalg.norm(printed[0, -1] - corners[1, 0]) > 1.0
    # Mended, it is still a bilinear surface: it leaves any boundary that is not straight.
    right = sum(
        w[..., None] * corners[one]
        for w, one in zip(weights, ((0, 0), (0, 1), (1, 0), (1, 1)), strict=True)
    )
    arch = np.sin(np.pi * u[0])[:, None] * [0.0, 0.0, 1.0]
    low = right[0] + arch
    patch = coons_patch(low, right[-1], right[:, 0], right[:, -1])
    assert np.abs(right[0] - low).max() == pytest.approx(1.0)
    assert np.abs(patch[0] - low).max() < 1e-15
    assert np.abs(patch[-1] - right[-1]).max() < 1e-15
