"""The curvature node by itself: an image in, normal and curvatures out."""

import numpy as np
import pytest

from palpate.messages.types import TactileImage
from palpate.nodes import curvature
from palpate.nodes.specs.sensors import PadSpec, SensorSpec, info_of
from palpate.testing import drive, example, messages_on

INFO = info_of(SensorSpec(pad=PadSpec(radius=None)), noise=1e-6)  # a flat pad
x, y = np.meshgrid(*[(np.arange(16) - 7.5) * 1e-3] * 2)


def patch_of(compression):
    pose = np.array([0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 1.0])  # position, then quaternion x, y, z, w
    image = example(
        TactileImage, finger=1, outcome="hit", fault="none", pose=pose,
        direction=np.array([0.0, 1.0, 0.0]), compression=compression, mask=compression > 0.0,
    )  # fmt: skip
    published = drive(curvature.NODE, [("/touch/info", INFO), ("/touch/image", image)])
    [patch] = messages_on(published, "/touch/patch")
    return patch


@pytest.mark.parametrize("radius", [0.02, 0.05])
def test_ball_has_curvatures_of_its_radius(radius):
    patch = patch_of(np.maximum(1e-3 - radius + np.sqrt(radius**2 - x**2 - y**2), 0.0))
    assert patch.kind == "smooth"
    assert patch.k1 == pytest.approx(1 / radius, rel=0.01)
    assert patch.k2 == pytest.approx(1 / radius, rel=0.01)
    assert patch.normal == pytest.approx([0.0, 0.0, -1.0], abs=1e-3)  # towards the pad


def test_rod_is_curved_only_across():
    patch = patch_of(np.maximum(1e-3 - 0.02 + np.sqrt(0.02**2 - x**2), 0.0))
    assert patch.k1 == pytest.approx(50.0, rel=0.01) and abs(patch.k2) < 0.5
    assert abs(patch.principal_direction[0]) > 0.999


def test_edge_has_no_curvature():
    assert patch_of(np.maximum(2e-3 - 0.2 * np.abs(x), 0.0)).kind == "edge"
