"""Fusion node: patches of overlapping touches in, the same with curvatures fused over them out.

The Kalman filter that Fung, 1999, section 6.1, wishes for, between curvature and tracer. A patch
that does not overlap the last one, or is not smooth, begins anew. Of a fused patch the jet bends as
the fused curvatures say, for the tracer and the planner look at that.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta, Struct

from palpate.core import touch
from palpate.core.arrays import Floats
from palpate.core.poses import Pose
from palpate.messages.types import SensorInfo, SurfacePatch
from palpate.nodes.runtime.node import Node, Outputs
from palpate.nodes.specs.sensors import pad_of_info

MEASURED = "/touch/measured"  # Where the curvature node's patches go instead of to the tracer
LEAST_COSINE = 0.1  # Cosine between normal and pad below which no jet tells of the surface
QUADRIC = slice(3, 6)  # The coefficients of a jet that bend it: x^2, xy, y^2


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    # Touches overlap whose middles are nearer than this share of the pad's width.
    overlap: Annotated[float, Meta(gt=0, le=1, description="1")] = 1.0


class State(NamedTuple):
    """What is known so far."""

    width: float = 0.0  # Of the pad [m]
    fused: touch.FusedCurvature | None = None  # Of the touches that overlap
    goal: int = -1  # The contour or probe that they belong to


def know_sensor(params: Params, state: State, info: SensorInfo) -> tuple[State, Outputs]:
    """Remember how wide the pad is."""
    pad = pad_of_info(info)
    return state._replace(width=pad.pitch * max(pad.rows, pad.cols)), []


def take_patch(params: Params, state: State, patch: SurfacePatch) -> tuple[State, Outputs]:
    """Fuse a smooth patch with those that it overlaps; hand on all others as they are."""
    if patch.kind != "smooth" or not len(patch.points):
        return state._replace(fused=None), [("/touch/patch", patch)]
    measured, before = _measured(patch), state.fused
    if before is not None and _overlaps(params, state, patch, measured):
        fused = touch.fuse(before, measured)
        patch = _fused(patch, fused)
    else:
        fused = touch.begin_fusion(measured)
    return state._replace(fused=fused, goal=patch.goal), [("/touch/patch", patch)]


def _overlaps(
    params: Params, state: State, patch: SurfacePatch, measured: touch.LocalCurvature
) -> bool:
    assert state.fused is not None
    away = np.linalg.norm(measured.point - state.fused.place.point)
    return bool(patch.goal == state.goal and away < params.overlap * state.width)


def _measured(patch: SurfacePatch) -> touch.LocalCurvature:
    """The curvature that a patch tells of, in its principal directions."""
    tangent = patch.principal_direction
    tangents = np.stack([tangent, np.cross(patch.normal, tangent)])
    shape = touch.ShapeOperator(tangents, patch.normal, (patch.k1, 0.0, patch.k2))
    one, two = patch.k1_error**2, patch.k2_error**2
    covariance = np.diag([one, 0.25 * (one + two), two])
    return touch.LocalCurvature(patch.points.mean(axis=0), shape, covariance)


def _fused(patch: SurfacePatch, fused: touch.FusedCurvature) -> SurfacePatch:
    """The patch with the curvatures that all touches so far tell of."""
    shape, covariance = fused.place.shape, fused.place.covariance
    k1, k2, direction, umbilic = touch.principal_curvatures(shape)
    errors = [
        _error_along(shape, covariance, one) for one in (direction, _across(shape, direction))
    ]
    jet = patch.jet
    if len(jet) >= QUADRIC.stop:
        jet = jet.copy()
        jet[QUADRIC] += _bending(patch, shape)
    return replace(
        patch,
        k1=k1,
        k2=k2,
        k1_error=errors[0],
        k2_error=errors[1],
        principal_direction=direction,
        umbilic=umbilic or patch.umbilic,
        curvature_across=touch.curvature_along(shape, patch.direction),
        curvature_across_error=_error_along(shape, covariance, patch.direction),
        jet=jet,
    )


def _across(shape: touch.ShapeOperator, direction: Floats) -> Floats:
    return np.cross(shape.normal, direction)


def _error_along(shape: touch.ShapeOperator, covariance: Floats, direction: Floats) -> float:
    """Standard error of the normal curvature along the tangential part of a direction."""
    u, v = (shape.tangents @ direction).tolist()
    size = math.hypot(u, v)
    if size == 0.0:
        return 0.0
    row = np.array([u * u, 2.0 * u * v, v * v]) / size**2
    return math.sqrt(max(float(row @ covariance @ row), 0.0))


def _bending(patch: SurfacePatch, shape: touch.ShapeOperator) -> Floats:
    """What a jet's x^2, xy and y^2 gain where the shape operator is another than it told."""
    axes = Pose.from_array(patch.pose).axes
    level = (shape.tangents @ axes)[:, :2].T  # from the tangents to the pad's x and y
    cosine = abs(float(patch.normal @ axes[:, 2]))  # its determinant, too: 1 where both agree
    if cosine < LEAST_COSINE:
        return np.zeros(3)
    s11, s12, s22 = shape.parts
    more = np.array([[s11 - patch.k1, s12], [s12, s22 - patch.k2]])
    # The second form of a graph is its second derivatives over the length of its normal.
    onto = np.linalg.inv(level)
    second = onto.T @ more @ onto / cosine
    return 0.5 * patch.jet_scale**2 * np.array([second[0, 0], 2.0 * second[0, 1], second[1, 1]])


NODE = Node(
    params=Params,
    step="fusion",
    start=lambda params: (State(), []),
    inputs={"/touch/info": (SensorInfo, know_sensor), MEASURED: (SurfacePatch, take_patch)},
    outputs={"/touch/patch": SurfacePatch},
    needs=("/touch/info",),
)
