from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.poses import split_pose
from palpate.messages.codec import encode
from palpate.messages.types.touch import SurfacePatch, TactileImage
from palpate.messages.types.world import SensorInfo
from palpate.nodes.curvature import Params, know_sensor, on_image


def image_of(compression: Floats, pose: Floats, **changes: Any) -> TactileImage:
    fields: dict[str, Any] = {
        "goal": 3,
        "touch": 4,
        "finger": 1,
        "direction": np.array([0.0, 0.0, 1.0]),
        "pose": pose,
        "outcome": "hit",
        "compression": compression,
        "mask": compression > 50e-6,
        "impulses": 0,
        "robot_time": 5.0,
    }
    return TactileImage(**{**fields, **changes})


def felt(info: SensorInfo, image: TactileImage) -> SurfacePatch:
    state, _ = know_sensor(Params(), None, info)
    assert state is not None
    _, [(topic, patch)] = on_image(Params(), state, image)  # type: ignore[misc]
    assert topic == "/touch/patch"
    assert isinstance(patch, SurfacePatch)
    assert encode(patch)
    return patch


def ball(radius: float) -> Floats:
    """Imprint of a ball on a domed pad of 15 mm, 1 mm deep."""
    axis = (np.arange(16) - 7.5) * 1e-3
    squared = axis[:, None] ** 2 + axis**2
    gap = radius - np.sqrt(radius**2 - squared) + squared / (2 * 0.015)
    return np.maximum(1e-3 - gap, 0.0)


def test_a_ball_has_its_curvature_both_ways(info: SensorInfo, sideways: Callable[[float], Floats]):
    patch = felt(info, image_of(ball(0.03), sideways(0.0)))
    assert patch.kind == "smooth"
    # A quartic leaves out the sixth order: (r / R)^4 of the curvature at the contact's rim.
    assert patch.k1 == pytest.approx(1 / 0.03, rel=2e-3)
    assert patch.k2 == pytest.approx(1 / 0.03, rel=2e-3)
    assert patch.curvature_across == pytest.approx(1 / 0.03, rel=2e-3)


def test_the_normal_points_out_of_the_object(info: SensorInfo, sideways: Callable[[float], Floats]):
    pose = sideways(0.0)
    patch = felt(info, image_of(ball(0.03), pose))
    assert patch.normal == pytest.approx(-split_pose(pose)[1][:, 2], abs=1e-9)


def test_a_miss_is_called_one(info: SensorInfo, sideways: Callable[[float], Floats]):
    patch = felt(info, image_of(np.zeros((16, 16)), sideways(0.0), outcome="miss"))
    assert (patch.kind, patch.confidence, len(patch.jet)) == ("miss", 0.0, 0)


def test_four_taxels_are_insufficient(info: SensorInfo, sideways: Callable[[float], Floats]):
    few = np.zeros((16, 16))
    few[7:9, 7:9] = 1e-3
    patch = felt(info, image_of(few, sideways(0.0)))
    assert (patch.kind, patch.k1, patch.k2) == ("insufficient", 0.0, 0.0)


@pytest.mark.parametrize("steepness", [1.0, 0.3])
def test_an_edge_has_no_curvature(
    info: SensorInfo, sideways: Callable[[float], Floats], steepness: float
):
    axis = (np.arange(16) - 7.5) * 1e-3
    roof = np.maximum(2e-3 - steepness * np.abs(axis) + 0 * axis[:, None], 0.0)
    patch = felt(replace(info, dome=0.0), image_of(roof, sideways(0.0)))
    assert (patch.kind, patch.k1, patch.k2) == ("edge", 0.0, 0.0)


@pytest.mark.parametrize("fault", ["dead", "saturated", "frozen", "impossible"])
def test_a_frame_at_fault_is_an_invalid_patch(
    info: SensorInfo, sideways: Callable[[float], Floats], fault: str
):
    patch = felt(
        info, image_of(ball(0.03), sideways(0.0), fault=fault, mask=np.zeros((16, 16), bool))
    )
    assert (patch.kind, patch.fault, patch.confidence) == ("invalid", fault, 0.0)
    assert not patch.mask.any() and not patch.height.any()


def test_taxels_that_were_cut_off_are_no_surface(
    info: SensorInfo, sideways: Callable[[float], Floats]
):
    cut = np.minimum(ball(0.03), 0.7e-3)
    patch = felt(info, image_of(cut, sideways(0.0)))
    assert (patch.kind, patch.fault) == ("smooth", "saturated")
    assert not patch.mask[cut >= 0.7e-3].any() and patch.mask.any()
    assert abs(patch.k1 - 1 / 0.03) < 2.0 * patch.k1_error
