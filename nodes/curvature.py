"""Curvature node: tactile images in, surface patches out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec import Struct

from palpate.core import split_pose
from palpate.core.touch import Pad, fit_patch
from palpate.messages import derive
from palpate.messages.types import SensorInfo, SurfacePatch, TactileImage
from palpate.nodes.runtime import Node, Outputs
from palpate.nodes.specs import pad_of_info


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """There is nothing to set."""


class Sensor(NamedTuple):
    """What the node remembers of the sensor."""

    pad: Pad  # The array
    noise: float  # Standard deviation of one taxel, m


State = Sensor | None


def start(params: Params) -> tuple[State, Outputs]:
    """Begin without a sensor."""
    return None, []


def know_sensor(params: Params, state: State, info: SensorInfo) -> tuple[State, Outputs]:
    """Remember the sensor."""
    return Sensor(pad_of_info(info), info.noise), []


def on_image(params: Params, sensor: Sensor, image: TactileImage) -> tuple[State, Outputs]:
    """Normal, curvatures and verdict of one touch."""
    _, axes = split_pose(image.pose)
    pad = sensor.pad
    surface = pad.surface(image.compression, image.mask)
    felt = fit_patch(pad, surface, image.mask, axes.T @ image.direction, sensor.noise)
    patch = derive(
        SurfacePatch,
        image,
        felt,
        height=surface,
        jet=np.zeros(0) if felt.jet is None else felt.jet.coefficients,
        jet_scale=1.0 if felt.jet is None else felt.jet.scale,
        normal=axes @ felt.normal,
        k1=felt.principal[0],
        k2=felt.principal[1],
        k1_error=felt.principal_error[0],
        k2_error=felt.principal_error[1],
        principal_direction=axes @ felt.principal_direction,
        curvature_across=felt.across,
        curvature_across_error=felt.across_error,
    )
    return sensor, [("/touch/patch", patch)]


NODE = Node(
    params=Params,
    start=start,
    inputs={"/touch/info": (SensorInfo, know_sensor), "/touch/image": (TactileImage, on_image)},
    outputs={"/touch/patch": SurfacePatch},
    needs=("/touch/info",),
)
