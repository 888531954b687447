"""The fusion node: overlapping touches tell together of the curvature, and no others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.core.poses import Pose
from palpate.core.touch import Jet
from palpate.launch.files.source_map import SourceMapped
from palpate.launch.launch_file import describe
from palpate.launch.launch_source import find_launch_file
from palpate.messages.types import SurfacePatch, TactileImage
from palpate.nodes import curvature, fusion
from palpate.nodes.runtime.testing import drive, example, messages_on
from palpate.nodes.specs.sensors import PadSpec, SensorSpec, info_of

RADIUS, NOISE = 0.03, 5e-6
INFO = ("/touch/info", info_of(SensorSpec(pad=PadSpec(radius=None)), noise=NOISE))
SIDE = (np.arange(16) - 7.5) * 1e-3
SQUARED = SIDE[:, None] ** 2 + SIDE**2


def measured(touches: int, step: float = 2e-3, lean: float = 0.0) -> list[SurfacePatch]:
    """Noisy touches of a ball, each so much farther along [m]; the pad leans [rad]."""
    rng, images = np.random.default_rng(0), []
    slope = np.tan(lean) * SIDE
    for touch in range(touches):
        height = RADIUS - np.sqrt(RADIUS**2 - SQUARED) + slope - 1.5e-3
        compression = np.maximum(-height - NOISE * rng.normal(size=height.shape), 0.0)
        turned = np.array([0.0, 0.0, np.sin(0.3 * touch), np.cos(0.3 * touch)])
        fields: dict[str, Any] = {
            "goal": 3, "touch": touch, "finger": 1, "outcome": "hit", "fault": "none",
            "pose": np.concatenate([[step * touch, 0.0, 0.0], turned]),
            "direction": np.array([0.0, 1.0, 0.0]),
            "compression": compression, "mask": compression > 0.0,
        }  # fmt: skip
        images.append(("/touch/image", example(TactileImage, **fields)))
    return messages_on(drive(curvature.NODE, [INFO, *images]), "/touch/patch")


def fused(patches: list[SurfacePatch], **params: Any) -> list[SurfacePatch]:
    given = [(fusion.MEASURED, one) for one in patches]
    return messages_on(drive(fusion.NODE, [INFO, *given], params), "/touch/patch")


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
        for one, other in zip(alone[1:], fused(alone)[1:], strict=True):
            pose = Pose.from_array(one.pose)
            at = pose.to_local(one.points.mean(axis=0)[None])[0]
            seconds = []
            for patch in (one, other):
                xx, xy, yy = Jet(patch.jet, patch.jet_scale).second_derivatives(at[:1], at[1:2])
                seconds.append(np.array([xx[0] + yy[0], xy[0]]))
            more = (other.k1 + other.k2) - (one.k1 + one.k2)
            assert seconds[1][0] - seconds[0][0] == pytest.approx(more, rel=0.2, abs=0.05)


@pytest.mark.parametrize("apart", ["far", "goal", "edge"])
def test_what_does_not_overlap_begins_anew(apart):
    alone = measured(3, step=30e-3 if apart == "far" else 1e-3)
    if apart == "goal":
        alone = [replace(one, goal=one.touch) for one in alone]
    if apart == "edge":
        alone = [replace(one, kind="edge") if one.touch == 1 else one for one in alone]
    for one, other in zip(alone, fused(alone), strict=True):
        assert (one.k1, one.k1_error) == (other.k1, other.k1_error)


def test_shipped_graph_has_it_between_curvature_and_tracer(tmp_path):
    args = {"scene": SourceMapped("sphere", "test"), "fingers": SourceMapped(2, "test")}
    graph = describe(find_launch_file(Path("fusion")), args, tmp_path).graph
    wirings = {one.name: one for one in graph.wirings()}
    [link] = [one for one in wirings["tracer_2"].inputs if one.topic.endswith("/touch/patch")]
    assert link.publisher == "fusion_2"
    [link] = [one for one in wirings["fusion_2"].inputs if one.topic.endswith("/touch/measured_2")]
    assert link.publisher == "curvature_2"
