"""Curvature node: tactile images in, surface patches out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec import Struct

from palpate.core import touch
from palpate.core.poses import Pose
from palpate.messages.types import SensorInfo, SurfacePatch, TactileImage
from palpate.nodes.runtime.node import Node, Outputs
from palpate.nodes.specs.sensors import pad_of_info


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """There is nothing to set."""


class Sensor(NamedTuple):
    """What the node remembers of the sensor."""

    pad: touch.Pad  # The array
    noise: float  # Standard deviation of one taxel, m


State = Sensor | None


def know_sensor(params: Params, state: State, info: SensorInfo) -> tuple[State, Outputs]:
    """Remember the sensor."""
    return Sensor(pad_of_info(info), info.noise), []


def on_image(params: Params, sensor: Sensor, image: TactileImage) -> tuple[State, Outputs]:
    """Normal, curvatures and verdict of one touch."""
    pose = Pose.from_array(image.pose)
    axes = pose.axes
    pad = sensor.pad
    surface = pad.surface(image.compression, image.mask)
    if image.fault == "none":
        found = touch.fit_patch(pad, surface, image.mask, axes.T @ image.direction, sensor.noise)
    else:
        found = touch.Patch("invalid", fault=image.fault)
    cut = np.zeros_like(image.mask) if found.cut is None else found.cut
    height, mask = np.where(cut, 0.0, surface), image.mask & ~cut
    met = touch.surface_points(pad, pose, height, mask, found.jet)
    patch = SurfacePatch(
        goal=image.goal,
        touch=image.touch,
        finger=image.finger,
        direction=image.direction,
        pose=image.pose,
        outcome=image.outcome,
        robot_time=image.robot_time,
        advance=image.advance,
        height=height,
        mask=mask,
        points=met.points,
        normals=met.normals,
        jet=np.zeros(0) if found.jet is None else found.jet.coefficients,
        jet_scale=1.0 if found.jet is None else found.jet.scale,
        normal=axes @ found.normal,
        normal_error=found.normal_error,
        k1=found.principal[0],
        k2=found.principal[1],
        k1_error=found.principal_error[0],
        k2_error=found.principal_error[1],
        principal_direction=axes @ found.principal_direction,
        umbilic=found.umbilic,
        curvature_across=found.across,
        curvature_across_error=found.across_error,
        kind=found.kind,
        fault=found.fault,
        confidence=found.confidence,
        residual=found.residual,
    )
    return sensor, [("/touch/patch", patch)]


NODE = Node(
    params=Params,
    step="curvature",
    start=lambda params: (None, []),
    inputs={"/touch/info": (SensorInfo, know_sensor), "/touch/image": (TactileImage, on_image)},
    outputs={"/touch/patch": SurfacePatch},
    needs=("/touch/info",),
)
