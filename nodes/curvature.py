"""Curvature node: tactile images in, surface patches out."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np
from msgspec import Struct

from palpate.core import touch
from palpate.core.plugins import class_by_name, entry_points_of
from palpate.core.poses import Pose
from palpate.messages.types import SensorInfo, SurfacePatch, TactileImage
from palpate.nodes.runtime.node import Node, Outputs
from palpate.nodes.specs.sensors import pad_of_info

JET = "jet"  # name of the default estimator


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    # Estimator of normal and curvatures: jet, a polynomial fitted to the touched taxels; bspline,
    # the thesis's interpolating surface; or a user's own, ``module:function``.
    estimator: str = JET

    def __post_init__(self) -> None:
        try:
            estimator_of(self.estimator)
        except LookupError as error:
            raise ValueError(error.args[0]) from None


def estimator_of(name: str) -> touch.Estimator:
    """An estimator by its name; LookupError if there is none, ValueError if unusable."""
    if name == JET:
        return touch.fit_jet
    estimator: object
    entry_points = {} if ":" in name else entry_points_of("palpate.curvature_estimators")
    if name in entry_points:
        estimator = entry_points[name].load()
    else:
        names = (JET, *entry_points)
        estimator = class_by_name(
            name, what="estimator of curvature", names=names, package="palpate"
        )
    if not callable(estimator):
        raise ValueError(f"the estimator of curvature {name!r} must be a function, as fit_jet is")
    return cast(touch.Estimator, estimator)


class State(NamedTuple):
    """The estimator and the sensor."""

    estimator: touch.Estimator
    pad: touch.Pad | None = None  # None until it is known
    noise: float = 0.0  # standard deviation of one taxel [m]


def know_sensor(params: Params, state: State, info: SensorInfo) -> tuple[State, Outputs]:
    """Remember the sensor."""
    return state._replace(pad=pad_of_info(info), noise=info.noise), []


def on_image(params: Params, state: State, image: TactileImage) -> tuple[State, Outputs]:
    """Normal, curvatures and kind of the surface under one touch."""
    pad, pose = state.pad, Pose.from_array(image.pose)
    assert pad is not None
    surface = pad.surface(image.compression, image.mask)
    if image.fault == "none":
        direction = pose.axes.T @ image.direction
        fit = touch.fit_patch(pad, surface, image.mask, direction, state.noise, state.estimator)
    else:
        fit = touch.Patch("invalid", fault=image.fault)
    is_cut = np.zeros_like(image.mask) if fit.cut is None else fit.cut
    height, mask = np.where(is_cut, 0.0, surface), image.mask & ~is_cut
    contacts = touch.surface_points(pad, pose, height, mask, fit.jet)
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
        points=contacts.points,
        normals=contacts.normals,
        fault=fit.fault,
        **_local_surface(fit, pose),
    )
    return state, [("/touch/patch", patch)]


def _local_surface(fit: touch.Patch, pose: Pose) -> dict[str, Any]:
    """Fields of a patch for the fitted surface, in the world."""
    return {
        "jet": np.zeros(0) if fit.jet is None else fit.jet.coefficients,
        "jet_scale": 1.0 if fit.jet is None else fit.jet.scale,
        "normal": pose.axes @ fit.normal,
        "normal_error": fit.normal_error,
        "k1": fit.principal[0],
        "k2": fit.principal[1],
        "k1_error": fit.principal_error[0],
        "k2_error": fit.principal_error[1],
        "principal_direction": pose.axes @ fit.principal_direction,
        "umbilic": fit.umbilic,
        "curvature_across": fit.across,
        "curvature_across_error": fit.across_error,
        "kind": fit.kind,
        "confidence": fit.confidence,
        "residual": fit.residual,
    }


NODE = Node(
    params=Params,
    step="curvature",
    start=lambda params: (State(estimator_of(params.estimator)), []),
    inputs={"/touch/info": (SensorInfo, know_sensor), "/touch/image": (TactileImage, on_image)},
    outputs={"/touch/patch": SurfacePatch},
    needs=("/touch/info",),
)
