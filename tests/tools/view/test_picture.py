import numpy as np
import pytest

from palpate.core import geometry
from palpate.tools.view.picture import finger_mesh


def test_the_drawn_finger_is_closed_and_its_tip_is_at_the_pad():
    vertices, faces = finger_mesh(np.array([0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0]))
    assert geometry.is_closed(faces)
    assert geometry.signed_volume(vertices[faces]) > 0.0
    assert vertices[:, 2].max() == pytest.approx(0.3)
    assert np.abs(vertices - [0.1, 0.2, 0.3]).sum(axis=1).min() == 0.0
