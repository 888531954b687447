"""Template of a node: the touched place with the largest curvature so far. Adapt it.

It joins the graph by its launch file; start palpate in the folder of this file:

    palpate launch template.yaml

Topics and their messages: `palpate.messages.types`, and docs/messages.md. A handler gets the
parameters, the state of the node and a message, and returns the new state and what it publishes. It
changes none of its arguments, reads no clock and opens no file, so that a run can be repeated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta, Struct
from palpate.messages import Count, PerMetre, Seconds, Vector
from palpate.messages.types import SurfacePatch
from palpate.nodes import Node, Outputs


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Parameters that the launch file can set."""

    least: Annotated[float, Meta(ge=0)] = 10.0  # smallest published curvature, 1/m


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Template:
    """A place with a larger curvature than all before. On ``/template``."""

    goal: Count  # number of the contour or probe of the touch
    touch: Count  # number of the touch in the goal
    place: Vector  # middle of the pad, world frame
    curvature: PerMetre  # largest principal curvature; convex is positive
    error: PerMetre  # standard error of the curvature
    robot_time: Seconds  # robot time at the end of the touch


def start(params: Params) -> tuple[float, Outputs]:
    """The first state: the curvature to exceed, 1/m."""
    return params.least, []


def take_patch(params: Params, largest: float, patch: SurfacePatch) -> tuple[float, Outputs]:
    """Publish the touch if it is smooth and has a larger curvature than all before."""
    if patch.kind != "smooth" or patch.k1 <= largest:
        return largest, []
    message = Template(
        goal=patch.goal,
        touch=patch.touch,
        place=patch.pose[:3],
        curvature=patch.k1,
        error=patch.k1_error,
        robot_time=patch.robot_time,
    )
    return patch.k1, [("/template", message)]


NODE = Node(
    params=Params,
    start=start,
    inputs={"/touch/patch": (SurfacePatch, take_patch)},
    outputs={"/template": Template},
)
