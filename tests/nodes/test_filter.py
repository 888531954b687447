from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.poses import pad_rotation, pose_of
from palpate.core.touch.filters import FilterOrder, clean
from palpate.core.touch.pad import guarded_move
from palpate.launch.scene import load_scene
from palpate.messages.types.touch import TactileFrame, TactileImage
from palpate.messages.types.world import SensorInfo
from palpate.nodes.filter import Params, calibrate, take_frame
from palpate.nodes.specs.objects import build_shape
from palpate.nodes.specs.sensors import SensorSpec, calibration_of_info, info_of, pad_of_spec


def frame_of(compression: Floats, pose: Floats, info: SensorInfo, **changes: Any) -> TactileFrame:
    fields: dict[str, Any] = {
        "goal": 3,
        "touch": 4,
        "finger": 1,
        "direction": np.array([0.0, 0.0, 1.0]),
        "pose": pose,
        "outcome": "hit",
        "array": calibration_of_info(info).encode(compression),
        "robot_time": 5.0,
    }
    return TactileFrame(**{**fields, **changes})


def cleaned(info: SensorInfo, frame: TactileFrame, **params: Any) -> TactileImage:
    state, _ = calibrate(Params(), None, info)
    assert state is not None
    _, [(topic, image)] = take_frame(Params(**params), state, frame)  # type: ignore[misc]
    assert topic == "/touch/image"
    assert isinstance(image, TactileImage)
    return image


@pytest.fixture
def bump() -> Floats:
    """A ball's imprint, 1 mm deep."""
    axis = (np.arange(16) - 7.5) * 1e-3
    squared = axis[:, None] ** 2 + axis**2
    return np.maximum(1e-3 - squared / (2 * 0.02), 0.0)


def test_a_quiet_frame_comes_through_as_it_is(
    info: SensorInfo, bump: Floats, sideways: Callable[[float], Floats]
):
    image = cleaned(info, frame_of(bump, sideways(0.0), info))
    assert np.allclose(image.compression, bump, rtol=0, atol=1e-15)
    assert np.array_equal(image.mask, bump > 50e-6)
    assert (image.goal, image.touch, image.robot_time) == (3, 4, 5.0)


def test_an_impulse_is_removed_and_counted(
    info: SensorInfo, bump: Floats, sideways: Callable[[float], Floats]
):
    hit = bump.copy()
    hit[1, 1], hit[7, 8] = 2.4e-3, 0.0
    image = cleaned(info, frame_of(hit, sideways(0.0), info))
    assert image.impulses == 2
    assert not image.mask[1, 1] and not image.mask[7, 8]
    # A quartic stands for the ball there; the taxels themselves are kept as they are.
    assert np.abs(image.compression - bump).max() < 2e-6


@pytest.mark.parametrize(
    ("order", "most"),
    [
        ("auto", 1.01),
        ("none", 1.01),
        ("wiener", 0.6),  # nine taxels are averaged; their variance is itself a guess
        ("median", 0.6),
        ("median-first", 0.5),
        ("wiener-first", 0.5),
    ],
)
def test_each_filter_takes_away_its_share_of_noise(
    order: FilterOrder, most: float, info: SensorInfo, sideways: Callable[[float], Floats]
):
    sigma = 10e-6
    rng = np.random.default_rng(0)
    flat = np.full((16, 16), 1e-3)
    noisy = replace(info, noise=sigma)
    noise = rng.normal(0.0, sigma, flat.shape)
    frame = frame_of(flat + noise, sideways(0.0), info)
    left = np.std(cleaned(noisy, frame, order=order).compression - flat)
    assert left < most * np.std(noise)


def test_without_impulses_the_frame_stays_as_it_is(
    info: SensorInfo, bump: Floats, sideways: Callable[[float], Floats]
):
    noisy = bump + np.random.default_rng(0).normal(0.0, 10e-6, bump.shape)
    told = replace(info, noise=10e-6)
    image = cleaned(told, frame_of(noisy, sideways(0.0), info))
    assert image.impulses == 0
    assert np.allclose(image.compression, noisy, rtol=0, atol=1e-15)


def test_a_taxel_that_the_calibration_does_not_trust_reads_like_its_neighbours(
    info: SensorInfo, bump: Floats, sideways: Callable[[float], Floats]
):
    gain = np.ones(bump.shape)
    gain[7, 7] = 0.0
    image = cleaned(replace(info, gain=gain), frame_of(bump, sideways(0.0), info))
    assert not image.mask[7, 7]
    assert image.impulses == 0
    assert image.compression[7, 7] == pytest.approx(bump[7, 7], abs=0.1e-3)


def test_untouched_noise_is_not_taken_for_a_touch(
    info: SensorInfo, sideways: Callable[[float], Floats]
):
    rng = np.random.default_rng(1)
    noisy = replace(info, noise=30e-6)
    nothing = rng.normal(0.0, 30e-6, (16, 16))
    assert not cleaned(noisy, frame_of(nothing, sideways(0.0), info)).mask.any()


def test_the_least_contact_can_be_set(
    info: SensorInfo, bump: Floats, sideways: Callable[[float], Floats]
):
    image = cleaned(info, frame_of(bump, sideways(0.0), info), contact=0.5e-3)
    assert np.array_equal(image.mask, bump > 0.5e-3)


@pytest.mark.parametrize(
    "scene", ["sphere", "box", "cylinder", "egg", "vase", "twisted", "from_mesh"]
)
def test_no_clean_frame_of_a_shipped_scene_holds_an_impulse(scene: str):
    spec = load_scene(scene).spec
    shape, pad = build_shape(spec.object), pad_of_spec(spec.sensor)
    low, high = shape.bounds()
    middle = 0.5 * (low + high)
    for height in np.linspace(low[2] + 0.002, high[2] - 0.002, 12):
        for tilt in (-1.0, 0.0, 1.0):
            axes = pad_rotation(0.3 * height / high[2], tilt)
            start = pose_of(np.array([*middle[:2], height]) - 0.12 * axes[:, 2], axes)
            pressed = guarded_move(shape, pad, start, 0.2, 2.2e-3)
            assert clean(pad, pressed.compression, 0.0, 50e-6, "auto").impulses == 0


def test_a_frame_that_comes_twice_is_taken_once(
    info: SensorInfo, bump: Floats, sideways: Callable[[float], Floats]
):
    frame = frame_of(bump, sideways(0.0), info)
    state, _ = calibrate(Params(), None, info)
    state, first = take_frame(Params(), state, frame)
    state, again = take_frame(Params(), state, frame)
    _, following = take_frame(Params(), state, replace(frame, touch=5))
    assert [len(first), len(again), len(following)] == [1, 0, 1]


def test_forces_are_read_by_the_stiffness_of_a_taxel(
    bump: Floats, sideways: Callable[[float], Floats]
):
    info = info_of(SensorSpec(signal="force"), noise=0.0)
    frame = frame_of(bump, sideways(0.0), info)
    assert frame.array.max() == pytest.approx(info.taxel_stiffness * bump.max())
    assert np.allclose(cleaned(info, frame).compression, bump, rtol=0, atol=1e-15)


def test_gain_and_offset_of_the_calibration_are_applied(
    info: SensorInfo, bump: Floats, sideways: Callable[[float], Floats]
):
    gain = np.random.default_rng(2).uniform(0.9, 1.1, bump.shape)
    found = replace(info, gain=gain, offset=np.full(bump.shape, 1e-5))
    image = cleaned(found, frame_of((bump - 1e-5) / gain, sideways(0.0), info))
    assert np.allclose(image.compression, bump, rtol=0, atol=1e-15)


def test_a_dead_a_saturated_and_an_impossible_frame_touch_nothing_and_say_why(
    info: SensorInfo, bump: Floats, sideways: Callable[[float], Floats]
):
    pose, limit = sideways(0.0), info.saturation * info.thickness
    frames = {
        "dead": frame_of(np.zeros((16, 16)), pose, info),
        "saturated": frame_of(np.full((16, 16), limit), pose, info),
        "impossible": frame_of(bump, pose, info, array=np.zeros((16, 16))),
    }
    frames["less"] = frame_of(bump - 3e-3, pose, info)
    frames["negative"] = replace(frames["impossible"], array=np.full((16, 16), -1e-6))
    for name, frame in frames.items():
        image = cleaned(info, frame)
        assert image.fault == (name if name in ("dead", "saturated") else "impossible")
        assert not image.mask.any()
    missed = frame_of(np.zeros((16, 16)), pose, info, outcome="miss")
    assert cleaned(info, missed).fault == "none"


def test_a_frame_with_noise_that_comes_again_from_elsewhere_is_frozen(
    info: SensorInfo, bump: Floats, sideways: Callable[[float], Floats]
):
    def faults(noise: float, array: Floats) -> list[str]:
        state, _ = calibrate(Params(), None, replace(info, noise=noise))
        found = []
        for touch in range(3):
            frame = frame_of(array, sideways(0.1 * touch), info, touch=touch)
            state, [(_, image)] = take_frame(Params(), state, frame)  # type: ignore[misc]
            found.append(image.fault)  # type: ignore[attr-defined]
        return found

    noisy = bump + np.random.default_rng(0).normal(0.0, 10e-6, bump.shape)
    rounded = 5e-6 * np.rint(bump / 5e-6)
    assert faults(10e-6, noisy) == ["none", "frozen", "frozen"]
    assert faults(10e-6, 5e-6 * np.rint(noisy / 5e-6)) == ["none", "frozen", "frozen"]
    assert faults(5e-6 / 12**0.5, rounded) == ["none"] * 3  # an even surface
    assert faults(0.0, bump) == ["none"] * 3


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (np.zeros((3, 3)), r"a frame must have shape \(16, 16\), got \(3, 3\)"),
        (np.full((16, 16), 5.5), "times are in seconds; multiply microseconds by 1e-6"),
    ],
)
def test_a_frame_of_another_array_or_unit_is_refused(
    info: SensorInfo, bump: Floats, sideways: Callable[[float], Floats], array: Floats, words: str
):
    with pytest.raises(ValueError, match=words):
        cleaned(info, replace(frame_of(bump, sideways(0.0), info), array=array))
