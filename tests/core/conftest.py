"""Fixtures of several rooms."""

import pytest
from scipy.spatial.transform import Rotation


@pytest.fixture
def rotations():
    """Random rotation matrices (n, 3, 3) of a fixed seed."""
    return lambda count: Rotation.random(count, random_state=5).as_matrix()
