"""Filter and curvature nodes: frames in, cleaned images and surface patches out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.poses import Pose, pad_rotation
from palpate.core.touch import clean, guarded_move
from palpate.launch.scene import load_scene
from palpate.messages.types import SensorInfo, SurfacePatch, TactileFrame, TactileImage
from palpate.nodes import curvature, filter
from palpate.nodes.runtime.testing import drive, example, messages_on
from palpate.nodes.specs.objects import build_shape
from palpate.nodes.specs.sensors import SensorSpec, calibration_of_info, info_of, pad_of_spec
from tests.messages.cases import cases
from tests.nodes.loop import sideways

SIDE = (np.arange(16) - 7.5) * 1e-3
SQUARED = SIDE[:, None] ** 2 + SIDE**2
BUMP = np.maximum(1e-3 - SQUARED / (2 * 0.02), 0.0)  # Of a ball, 1 mm deep
NOISE = np.random.default_rng(0).normal(0.0, 10e-6, (16, 16))


def ball(radius: float) -> Floats:
    """Imprint of a ball on a domed pad of 15 mm, 1 mm deep."""
    gap = radius - np.sqrt(radius**2 - SQUARED) + SQUARED / (2 * 0.015)
    return np.maximum(1e-3 - gap, 0.0)


def frame_of(info: SensorInfo, compression: Floats, **changes: Any) -> TactileFrame:
    fields: dict[str, Any] = {
        "goal": 3,
        "touch": 4,
        "finger": 1,
        "direction": np.array([0.0, 0.0, 1.0]),
        "pose": sideways(0.0),
        "outcome": "hit",
        "array": calibration_of_info(info).encode(compression),
        "robot_time": 5.0,
    }
    return example(TactileFrame, **{**fields, **changes})


def cleaned(info: SensorInfo, *frames: TactileFrame, **params: Any) -> list[TactileImage]:
    raw = [("/touch/raw", frame) for frame in frames]
    return messages_on(drive(filter.NODE, [("/touch/info", info), *raw], params), "/touch/image")


def patch_of(info: SensorInfo, compression: Floats, **changes: Any) -> SurfacePatch:
    frame = frame_of(info, compression)
    fields = {"compression": compression, "mask": compression > 50e-6, **changes}
    names = ("goal", "touch", "finger", "direction", "pose", "outcome", "robot_time")
    copied = {name: getattr(frame, name) for name in names}
    image = example(TactileImage, **{**copied, **fields})
    published = drive(curvature.NODE, [("/touch/info", info), ("/touch/image", image)])
    [patch] = messages_on(published, "/touch/patch")
    return patch


@pytest.mark.parametrize("noise", [0.0, 10e-6])
def test_frame_without_impulses_comes_through_as_it_is(info: SensorInfo, noise: float):
    told = replace(info, noise=noise)
    noisy = BUMP + (NOISE if noise else 0.0)
    frame = frame_of(told, noisy, move=np.array([0.0, 1.0, 2.0, 0.07, 4.0]))
    [image] = cleaned(told, frame)
    assert np.allclose(image.compression, noisy, rtol=0, atol=1e-15)
    assert noise or np.array_equal(image.mask, BUMP > 50e-6)
    assert (image.impulses, image.fault, image.advance) == (0, "none", 0.07)
    assert (image.goal, image.touch, image.robot_time) == (3, 4, 5.0)
    [image] = cleaned(info, frame_of(info, BUMP), contact=0.5e-3)
    assert np.array_equal(image.mask, BUMP > 0.5e-3)


def test_impulse_is_removed_and_counted(info: SensorInfo):
    hit = BUMP.copy()
    hit[1, 1], hit[7, 8] = 2.4e-3, 0.0
    [image] = cleaned(info, frame_of(info, hit))
    assert image.impulses == 2 and not image.mask[1, 1] and not image.mask[7, 8]
    # A quartic stands for the ball there; the taxels themselves are kept as they are.
    assert np.abs(image.compression - BUMP).max() < 2e-6


@cases(
    "order, most",
    ("auto", 1.01),
    ("none", 1.01),
    ("wiener", 0.6),  # nine taxels are averaged; their variance is itself a guess
    ("median", 0.6),
    ("median-first", 0.5),
    ("wiener-first", 0.5),
)
def test_each_filter_removes_its_share_of_noise(order: str, most: float, info: SensorInfo):
    told, flat = replace(info, noise=10e-6), np.full((16, 16), 1e-3)
    [image] = cleaned(told, frame_of(told, flat + NOISE), order=order)
    assert np.std(image.compression - flat) < most * np.std(NOISE)
    [untouched] = cleaned(replace(info, noise=30e-6), frame_of(info, 3.0 * NOISE), order=order)
    assert not untouched.mask.any()


def test_calibration_is_applied_and_lost_taxel_reads_like_neighbours(info: SensorInfo):
    gain = np.random.default_rng(2).uniform(0.9, 1.1, BUMP.shape)
    told = replace(info, gain=gain, offset=np.full(BUMP.shape, 1e-5))
    sent = calibration_of_info(info).encode((BUMP - 1e-5) / gain)
    [image] = cleaned(told, frame_of(info, BUMP, array=sent))
    assert np.allclose(image.compression, BUMP, rtol=0, atol=1e-15)
    gain = np.ones(BUMP.shape)
    gain[7, 7] = 0.0
    [image] = cleaned(replace(info, gain=gain), frame_of(info, BUMP))
    assert not image.mask[7, 7] and image.impulses == 0
    assert image.compression[7, 7] == pytest.approx(BUMP[7, 7], abs=0.1e-3)


def test_forces_are_read_by_stiffness_of_a_taxel():
    info = info_of(SensorSpec(signal="force"), noise=0.0)
    frame = frame_of(info, BUMP)
    assert frame.array.max() == pytest.approx(info.taxel_stiffness * BUMP.max())
    [image] = cleaned(info, frame)
    assert np.allclose(image.compression, BUMP, rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    "scene",
    ["sphere", "box", "cylinder", pytest.param("vase", marks=pytest.mark.slow), "from_mesh"],
)
def test_no_clean_frame_of_a_shipped_scene_holds_an_impulse(scene: str):
    spec = load_scene(scene).spec
    shape, pad = build_shape(spec.object), pad_of_spec(spec.sensor)
    low, high = shape.bounds()
    middle = 0.5 * (low + high)
    for height in np.linspace(low[2] + 0.002, high[2] - 0.002, 5):
        for tilt in (-1.0, 0.0, 1.0):
            axes = pad_rotation(0.3 * height / high[2], tilt)
            start = Pose(np.array([*middle[:2], height]) - 0.12 * axes[:, 2], axes)
            pressed = guarded_move(shape, pad, start, 0.2, 2.2e-3)
            assert clean(pad, pressed.compression, 0.0, 50e-6, "auto").impulses == 0


def test_frame_that_comes_twice_is_taken_once(info: SensorInfo):
    frames = [frame_of(info, BUMP, touch=touch) for touch in (4, 4, 5)]
    assert [image.touch for image in cleaned(info, *frames)] == [4, 5]


@cases(
    "array, fault",
    (np.zeros((16, 16)), "dead"),
    (np.full((16, 16), 0.8 * 3e-3), "saturated"),
    (BUMP - 3e-3, "impossible"),
    (np.full((16, 16), 3.1e-3), "impossible"),
)
def test_frame_of_a_faulty_sensor_touches_nothing_and_says_why(array, fault, info: SensorInfo):
    [image] = cleaned(info, frame_of(info, array))
    assert (image.fault, image.mask.any()) == (fault, False)
    [missed] = cleaned(info, frame_of(info, np.zeros((16, 16)), outcome="miss"))
    assert missed.fault == "none"


@cases(
    "noise, array, frozen",
    (10e-6, BUMP + NOISE, True),
    (10e-6, 5e-6 * np.rint((BUMP + NOISE) / 5e-6), True),
    (5e-6 / 12**0.5, 5e-6 * np.rint(BUMP / 5e-6), False),  # an even surface
    (0.0, BUMP, False),
)
def test_noisy_frame_that_comes_again_elsewhere_is_frozen(noise, array, frozen, info: SensorInfo):
    told = replace(info, noise=noise)
    frames = [frame_of(told, array, touch=n, pose=sideways(0.1 * n)) for n in range(3)]
    faults = [image.fault for image in cleaned(told, *frames)]
    assert faults == ["none", *(["frozen"] * 2 if frozen else ["none"] * 2)]


@cases(
    "array, words",
    (np.zeros((3, 3)), r"a frame must have shape \(16, 16\), got \(3, 3\)"),
    (np.full((16, 16), 5.5), "times are in seconds; multiply microseconds by 1e-6"),
)
def test_frame_of_another_array_or_unit_is_refused(array: Floats, words: str, info: SensorInfo):
    with pytest.raises(ValueError, match=words):
        cleaned(info, frame_of(info, BUMP, array=array))


def test_patch_of_a_ball_has_its_curvature_and_outward_normal(info: SensorInfo):
    patch = patch_of(info, ball(0.03))
    assert (patch.kind, patch.fault, patch.goal, patch.touch) == ("smooth", "none", 3, 4)
    # A quartic leaves out the sixth order: (r / R)^4 of the curvature at the contact's rim.
    found = (patch.k1, patch.k2, patch.curvature_across)
    assert found == pytest.approx((1 / 0.03,) * 3, rel=2e-3)
    assert patch.normal == pytest.approx(-Pose.from_array(sideways(0.0)).axes[:, 2], abs=1e-9)
    assert (
        len(patch.jet) and patch.jet_scale > 0.0 and np.array_equal(patch.mask, ball(0.03) > 5e-5)
    )


def test_patch_of_a_cylinder_has_directions_and_curvature_across(info: SensorInfo):
    flat = replace(info, dome=0.0)
    along = np.maximum(1e-3 - (0.02 - np.sqrt(0.02**2 - SIDE**2)) + 0.0 * SIDE[:, None], 0.0)
    rows, columns = patch_of(flat, along), patch_of(flat, along.T)
    for patch in (rows, columns):
        assert sorted((abs(patch.k1), abs(patch.k2))) == pytest.approx([0.0, 50.0], abs=0.2)
    assert {round(rows.curvature_across), round(columns.curvature_across)} == {0, 50}
    assert abs(rows.principal_direction @ columns.principal_direction) < 1e-6
    assert abs(rows.principal_direction @ rows.normal) < 1e-9


@cases(
    "compression, changes, kind",
    (np.zeros((16, 16)), {"outcome": "miss"}, "miss"),
    (np.where(SQUARED < 1e-6, 1e-3, 0.0), {}, "insufficient"),
    (np.maximum(2e-3 - np.abs(SIDE) + 0 * SIDE[:, None], 0.0), {}, "edge"),
    (np.maximum(2e-3 - 0.3 * np.abs(SIDE) + 0 * SIDE[:, None], 0.0), {}, "edge"),
    *(
        (ball(0.03), {"fault": fault, "mask": np.zeros((16, 16), bool)}, "invalid")
        for fault in ("dead", "saturated", "frozen", "impossible")
    ),
)
def test_patch_without_a_surface_has_no_curvature(compression, changes, kind, info: SensorInfo):
    patch = patch_of(replace(info, dome=0.0), compression, **changes)
    assert (patch.kind, patch.k1, patch.k2) == (kind, 0.0, 0.0)
    assert patch.fault == changes.get("fault", "none")
    if kind in ("miss", "invalid"):
        assert patch.confidence == 0.0 and not len(patch.jet)
        assert not patch.mask.any() and not patch.height.any()


def test_taxels_that_are_cut_off_are_no_surface(info: SensorInfo):
    cut = np.minimum(ball(0.03), 0.7e-3)
    patch = patch_of(info, cut)
    assert (patch.kind, patch.fault) == ("smooth", "saturated")
    assert not patch.mask[cut >= 0.7e-3].any() and patch.mask.any()
    assert not patch.height[cut >= 0.7e-3].any()
    assert abs(patch.k1 - 1 / 0.03) < 2.0 * patch.k1_error
