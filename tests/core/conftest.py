"""Fixtures of several rooms."""

import numpy as np
import pytest


@pytest.fixture
def rotations():
    """Random rotation matrices (n, 3, 3) of a fixed seed."""

    def draw(count):
        matrices = np.linalg.qr(np.random.default_rng(5).normal(size=(count, 3, 3)))[0]
        matrices[:, :, 0] *= np.linalg.det(matrices)[:, None]
        return np.asarray(matrices)

    return draw
