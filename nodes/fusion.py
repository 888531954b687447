"""Fusion node: surface patches in, the same with curvatures fused over overlapping touches out.

It stands between curvature and tracer: Fung, 1999, section 6.1. The filter restarts at a patch that
is not smooth, or does not overlap the one before. The jet of a patch is corrected to the fused
curvatures, because the tracer reads them from the jet.
"""

from __future__ import annotations

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

MEASURED = "/touch/measured"  # topic of the curvature node's patches in this graph


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    # Largest distance between the middles of two touches that overlap, fraction of the pad's width.
    overlap: Annotated[float, Meta(gt=0, le=1, description="1")] = 1.0


class State(NamedTuple):
    """The pad and the last fused curvature."""

    width: float = 0.0  # of the pad [m]
    fused: touch.FusedCurvature | None = None  # of the last overlapping touches; None: begin anew
    goal: int = -1  # contour or probe of these touches


def know_sensor(params: Params, state: State, info: SensorInfo) -> tuple[State, Outputs]:
    """Remember the width of the pad."""
    pad = pad_of_info(info)
    return state._replace(width=pad.pitch * max(pad.rows, pad.cols)), []


def take_patch(params: Params, state: State, patch: SurfacePatch) -> tuple[State, Outputs]:
    """Fuse a smooth patch with those that it overlaps; other patches are passed unchanged."""
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
    distance = np.linalg.norm(measured.point - state.fused.place.point)
    return bool(patch.goal == state.goal and distance < params.overlap * state.width)


def _measured(patch: SurfacePatch) -> touch.LocalCurvature:
    """The curvature of a patch in its principal directions."""
    tangent = patch.principal_direction
    tangents = np.stack([tangent, np.cross(patch.normal, tangent)])
    shape = touch.ShapeOperator(tangents, patch.normal, (patch.k1, 0.0, patch.k2))
    v1, v2 = patch.k1_error**2, patch.k2_error**2
    covariance = np.diag([v1, 0.25 * (v1 + v2), v2])
    return touch.LocalCurvature(patch.points.mean(axis=0), shape, covariance)


def _fused(patch: SurfacePatch, fused: touch.FusedCurvature) -> SurfacePatch:
    """The patch with the curvatures of all overlapping touches."""
    shape, covariance = fused.place.shape, fused.place.covariance
    k1, k2, direction, umbilic = touch.principal_curvatures(shape)
    across = np.cross(shape.normal, direction)
    return replace(
        patch,
        k1=k1,
        k2=k2,
        k1_error=touch.curvature_error(shape, covariance, direction),
        k2_error=touch.curvature_error(shape, covariance, across),
        principal_direction=direction,
        umbilic=umbilic or patch.umbilic,
        curvature_across=touch.curvature_along(shape, patch.direction),
        curvature_across_error=touch.curvature_error(shape, covariance, patch.direction),
        jet=_corrected_jet(patch, shape),
    )


def _corrected_jet(patch: SurfacePatch, fused: touch.ShapeOperator) -> Floats:
    """Coefficients of the patch's jet with the fused curvatures."""
    if not len(patch.jet):
        return patch.jet
    pose = Pose.from_array(patch.pose)
    axes, (x, y, _) = pose.axes, pose.to_local(patch.points.mean(axis=0)[None])[0].tolist()
    in_pad = fused._replace(tangents=fused.tangents @ axes, normal=fused.normal @ axes)
    measured = in_pad._replace(parts=(patch.k1, 0.0, patch.k2))
    jet = touch.Jet(patch.jet, patch.jet_scale)
    return touch.corrected_jet(jet, measured, in_pad, (x, y)).coefficients


NODE = Node(
    params=Params,
    step="fusion",
    start=lambda params: (State(), []),
    inputs={"/touch/info": (SensorInfo, know_sensor), MEASURED: (SurfacePatch, take_patch)},
    outputs={"/touch/patch": SurfacePatch},
    needs=("/touch/info",),
)
