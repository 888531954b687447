"""Filter, curvature and fusion nodes: frames in, cleaned images and surface patches out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.poses import Pose
from palpate.core.touch import Jet, graph_shape_operator
from palpate.launch.files.source_map import SourceMapped
from palpate.launch.launch_file import describe
from palpate.launch.launch_source import find_launch_file
from palpate.messages.types import SensorInfo, SurfacePatch, TactileFrame, TactileImage
from palpate.nodes import curvature, filter, fusion
from palpate.nodes.runtime.testing import drive, example, messages_on
from palpate.nodes.specs.sensors import PadSpec, SensorSpec, calibration_of_info, info_of
from tests.messages.cases import cases
from tests.nodes.loop import INFO, sideways

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
def test_frame_without_impulses_comes_through_as_it_is(noise: float):
    info = replace(INFO, noise=noise)
    noisy = BUMP + (NOISE if noise else 0.0)
    frame = frame_of(info, noisy, move=np.array([0.0, 1.0, 2.0, 0.07, 4.0]))
    [image] = cleaned(info, frame)
    assert np.allclose(image.compression, noisy, rtol=0, atol=1e-15)
    assert noise or np.array_equal(image.mask, BUMP > 50e-6)
    assert (image.impulses, image.fault, image.advance) == (0, "none", 0.07)
    assert (image.goal, image.touch, image.robot_time) == (3, 4, 5.0)
    [image] = cleaned(INFO, frame_of(INFO, BUMP), contact=0.5e-3)
    assert np.array_equal(image.mask, BUMP > 0.5e-3)


def test_impulses_are_removed_and_calibration_is_applied_but_to_lost_taxels():
    hit = BUMP.copy()
    hit[1, 1], hit[7, 8] = 2.4e-3, 0.0
    [image] = cleaned(INFO, frame_of(INFO, hit))
    assert image.impulses == 2 and not image.mask[1, 1] and not image.mask[7, 8]
    # A quartic stands for the ball there; the taxels themselves are kept as they are.
    assert np.abs(image.compression - BUMP).max() < 2e-6
    gain = np.random.default_rng(2).uniform(0.9, 1.1, BUMP.shape)
    info = replace(INFO, gain=gain, offset=np.full(BUMP.shape, 1e-5))
    sent = calibration_of_info(INFO).encode((BUMP - 1e-5) / gain)
    [image] = cleaned(info, frame_of(INFO, BUMP, array=sent))
    assert np.allclose(image.compression, BUMP, rtol=0, atol=1e-15)
    gain = np.ones(BUMP.shape)
    gain[7, 7] = 0.0
    [image] = cleaned(replace(INFO, gain=gain), frame_of(INFO, BUMP))
    assert not image.mask[7, 7] and image.impulses == 0
    assert image.compression[7, 7] == pytest.approx(BUMP[7, 7], abs=0.1e-3)


def test_frame_that_comes_twice_is_taken_once_and_a_noisy_one_elsewhere_is_frozen():
    frames = [frame_of(INFO, BUMP, touch=touch) for touch in (4, 4, 5)]
    assert [image.touch for image in cleaned(INFO, *frames)] == [4, 5]
    for noise, array, fault in ((10e-6, BUMP + NOISE, "frozen"), (0.0, BUMP, "none")):
        told = replace(INFO, noise=noise)
        frames = [frame_of(told, array, touch=n, pose=sideways(0.1 * n)) for n in range(3)]
        assert [image.fault for image in cleaned(told, *frames)] == ["none", fault, fault]


@cases(
    "array, fault",
    (np.zeros((16, 16)), "dead"),
    (np.full((16, 16), 0.8 * 3e-3), "saturated"),
    (BUMP - 3e-3, "impossible"),
)
def test_frame_of_a_faulty_sensor_touches_nothing_and_says_why(array, fault):
    [image] = cleaned(INFO, frame_of(INFO, array))
    assert (image.fault, image.mask.any()) == (fault, False)
    [missed] = cleaned(INFO, frame_of(INFO, np.zeros((16, 16)), outcome="miss"))
    assert missed.fault == "none"


def test_patch_has_curvatures_directions_and_outward_normal_of_ball_and_cylinder():
    patch = patch_of(INFO, ball(0.03))
    assert (patch.kind, patch.fault, patch.goal, patch.touch) == ("smooth", "none", 3, 4)
    # A quartic leaves out the sixth order: (r / R)^4 of the curvature at the contact's rim.
    curvatures = (patch.k1, patch.k2, patch.curvature_across)
    assert curvatures == pytest.approx((1 / 0.03,) * 3, rel=2e-3)
    assert patch.normal == pytest.approx(-Pose.from_array(sideways(0.0)).axes[:, 2], abs=1e-9)
    assert len(patch.jet) and patch.jet_scale > 0.0
    assert np.array_equal(patch.mask, ball(0.03) > 5e-5)
    flat = replace(INFO, dome=0.0)
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
    (np.maximum(2e-3 - 0.3 * np.abs(SIDE) + 0 * SIDE[:, None], 0.0), {}, "edge"),
    (ball(0.03), {"fault": "dead", "mask": np.zeros((16, 16), bool)}, "invalid"),
)
def test_patch_without_a_surface_has_no_curvature(compression, changes, kind):
    patch = patch_of(replace(INFO, dome=0.0), compression, **changes)
    assert (patch.kind, patch.k1, patch.k2) == (kind, 0.0, 0.0)
    assert patch.fault == changes.get("fault", "none")
    if kind in ("miss", "invalid"):
        assert patch.confidence == 0.0 and not len(patch.jet)
        assert not patch.mask.any() and not patch.height.any()


def test_taxels_that_are_cut_off_are_no_surface():
    cut = np.minimum(ball(0.03), 0.7e-3)
    patch = patch_of(INFO, cut)
    assert (patch.kind, patch.fault) == ("smooth", "saturated")
    assert not patch.mask[cut >= 0.7e-3].any() and patch.mask.any()
    assert not patch.height[cut >= 0.7e-3].any()
    assert abs(patch.k1 - 1 / 0.03) < 2.0 * patch.k1_error


# Fusion: overlapping touches tell together of the curvature, and no others

RADIUS, DEVIATION = 0.03, 5e-6
FLAT_INFO = ("/touch/info", info_of(SensorSpec(pad=PadSpec(radius=None)), noise=DEVIATION))


def measured(touches: int, step: float = 2e-3, lean: float = 0.0) -> list[SurfacePatch]:
    """Noisy touches of a ball, each so much farther along [m]; the pad leans [rad]."""
    rng, images = np.random.default_rng(0), []
    slope = np.tan(lean) * SIDE
    for touch in range(touches):
        height = RADIUS - np.sqrt(RADIUS**2 - SQUARED) + slope - 1.5e-3
        compression = np.maximum(-height - DEVIATION * rng.normal(size=height.shape), 0.0)
        turned = np.array([0.0, 0.0, np.sin(0.3 * touch), np.cos(0.3 * touch)])
        fields: dict[str, Any] = {
            "goal": 3, "touch": touch, "finger": 1, "outcome": "hit", "fault": "none",
            "pose": np.concatenate([[step * touch, 0.0, 0.0], turned]),
            "direction": np.array([0.0, 1.0, 0.0]),
            "compression": compression, "mask": compression > 0.0,
        }  # fmt: skip
        images.append(("/touch/image", example(TactileImage, **fields)))
    return messages_on(drive(curvature.NODE, [FLAT_INFO, *images]), "/touch/patch")


def fused(patches: list[SurfacePatch], **params: Any) -> list[SurfacePatch]:
    inputs = [(fusion.MEASURED, one) for one in patches]
    return messages_on(drive(fusion.NODE, [FLAT_INFO, *inputs], params), "/touch/patch")


def off(patches: list[SurfacePatch]) -> float:
    return float(np.mean([abs(one.k1 - 1 / RADIUS) + abs(one.k2 - 1 / RADIUS) for one in patches]))


def test_touches_of_one_ball_tell_more_together():
    alone = measured(12)
    together = fused(alone)
    assert len(together) == 12 and off(together[4:]) < 0.7 * off(alone[4:])
    assert together[-1].k1_error < 0.8 * alone[-1].k1_error
    kept = ("touch", "pose", "height", "mask", "points", "normals", "normal", "kind", "confidence")
    for one, other in zip(alone, together, strict=True):
        assert all(np.array_equal(getattr(one, name), getattr(other, name)) for name in kept)


def test_jet_bends_as_the_fused_curvatures_say():
    for lean in (0.0, 0.15):
        alone = measured(6, lean=lean)
        for single, corrected in zip(alone[1:], fused(alone)[1:], strict=True):
            at = Pose.from_array(single.pose).to_local(single.points.mean(axis=0)[None])[0]
            means = []
            for patch in (single, corrected):
                jet = Jet(patch.jet, patch.jet_scale)
                p, q = jet.slopes(at[:1], at[1:2])
                xx, xy, yy = jet.second_derivatives(at[:1], at[1:2])
                shape = graph_shape_operator((p[0], q[0]), (xx[0], xy[0], yy[0]))
                means.append(shape.parts[0] + shape.parts[2])
            more = (corrected.k1 + corrected.k2) - (single.k1 + single.k2)
            assert means[1] - means[0] == pytest.approx(more, rel=0.01, abs=1e-3)


@pytest.mark.parametrize("apart", ["far", "goal", "edge"])
def test_what_does_not_overlap_begins_anew(apart):
    alone = measured(3, step=30e-3 if apart == "far" else 1e-3)
    if apart == "goal":
        alone = [replace(single, goal=single.touch) for single in alone]
    if apart == "edge":
        alone = [replace(single, kind="edge") if single.touch == 1 else single for single in alone]
    for single, passed in zip(alone, fused(alone), strict=True):
        assert (single.k1, single.k1_error) == (passed.k1, passed.k1_error)


def test_shipped_graph_has_it_between_curvature_and_tracer(tmp_path):
    args = {"scene": SourceMapped("sphere", "test"), "fingers": SourceMapped(2, "test")}
    graph = describe(find_launch_file(Path("fusion")), args, tmp_path).graph
    wirings = {one.name: one for one in graph.wirings()}
    [link] = [one for one in wirings["tracer_2"].inputs if one.topic.endswith("/touch/patch")]
    assert link.publisher == "fusion_2"
    [link] = [one for one in wirings["fusion_2"].inputs if one.topic.endswith("/touch/measured_2")]
    assert link.publisher == "curvature_2"
