"""Curvature node: tactile images in, surface patches out."""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np
from msgspec import Struct

from palpate.core import touch
from palpate.core.plugins import class_by_name, entry_points_of
from palpate.core.poses import Pose
from palpate.messages.types import SensorInfo, SurfacePatch, TactileImage
from palpate.nodes.runtime.node import Node, Outputs
from palpate.nodes.specs.sensors import pad_of_info

JET = "jet"  # The estimator that is not looked for


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    # What normal and curvatures come from: jet, a polynomial fitted to the touched taxels; bspline,
    # the thesis's interpolating surface; or one's own, ``module:function``.
    estimator: str = JET

    def __post_init__(self) -> None:
        try:
            estimator_of(self.estimator)
        except LookupError as error:
            raise ValueError(error.args[0]) from None


def estimator_of(name: str) -> touch.Estimator:
    """An estimator by its name; LookupError if there is none, ValueError if it is of no use."""
    if name == JET:
        return touch.fit_jet
    found: object
    others = {} if ":" in name else entry_points_of("palpate.curvature_estimators")
    if name in others:
        found = others[name].load()
    else:
        names = (JET, *others)
        found = class_by_name(name, what="estimator of curvature", names=names, package="palpate")
    if not callable(found):
        raise ValueError(f"the estimator of curvature {name!r} must be a function, as fit_jet is")
    return cast(touch.Estimator, found)


class State(NamedTuple):
    """What the node works with."""

    estimator: touch.Estimator
    pad: touch.Pad | None = None  # The array, once it is known
    noise: float = 0.0  # Standard deviation of one taxel, m


def know_sensor(params: Params, state: State, info: SensorInfo) -> tuple[State, Outputs]:
    """Remember the sensor."""
    return state._replace(pad=pad_of_info(info), noise=info.noise), []


def on_image(params: Params, state: State, image: TactileImage) -> tuple[State, Outputs]:
    """Normal, curvatures and verdict of one touch."""
    assert state.pad is not None
    pose = Pose.from_array(image.pose)
    axes = pose.axes
    pad = state.pad
    surface = pad.surface(image.compression, image.mask)
    if image.fault == "none":
        along = axes.T @ image.direction
        found = touch.fit_patch(pad, surface, image.mask, along, state.noise, state.estimator)
    else:
        found = touch.Patch("invalid", fault=image.fault)
    cut = np.zeros_like(image.mask) if found.cut is None else found.cut
    height, mask = np.where(cut, 0.0, surface), image.mask & ~cut
    met = touch.surface_points(pad, pose, height, mask, found.jet)
    patch = SurfacePatch(
        goal=image.goal,
        touch=image.touch,
        finger=image.finger,
        placement=image.placement,
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
    return state, [("/touch/patch", patch)]


NODE = Node(
    params=Params,
    step="curvature",
    start=lambda params: (State(estimator_of(params.estimator)), []),
    inputs={"/touch/info": (SensorInfo, know_sensor), "/touch/image": (TactileImage, on_image)},
    outputs={"/touch/patch": SurfacePatch},
    needs=("/touch/info",),
)
