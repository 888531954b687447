"""Template of a node: where the surface bends most, of all that was touched. Make it yours.

It joins the graph by its launch file; start palpate in the folder of this file:

    palpate launch template.yaml

Topics and their messages: `palpate.messages.types`, and docs/messages.md. A handler gets the
parameters, what the node remembers and a message, and returns what it remembers then and what it
publishes; it changes none of them, reads no clock and opens no file: so a run can be repeated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta, Struct
from palpate.messages import Count, PerMetre, Seconds, Vector
from palpate.messages.types import SurfacePatch
from palpate.nodes import Node, Outputs


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    least: Annotated[float, Meta(ge=0)] = 10.0  # Curvatures below are not told of, 1/m


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Template:
    """A place that bends more than all before. On ``/template``."""

    goal: Count  # Number of the contour or probe that the touch belongs to
    touch: Count  # Number of the touch within the goal
    place: Vector  # Where the middle of the pad was, world frame
    curvature: PerMetre  # Largest principal curvature; convex is positive
    error: PerMetre  # Its standard error
    robot_time: Seconds  # Robot time at the end of the touch


def start(params: Params) -> tuple[float, Outputs]:
    """Begin with nothing touched; what is remembered is the curvature to be exceeded, 1/m."""
    return params.least, []


def take_patch(params: Params, most: float, patch: SurfacePatch) -> tuple[float, Outputs]:
    """Tell of the touch if it is smooth and bends more than all before."""
    if patch.kind != "smooth" or patch.k1 <= most:
        return most, []
    found = Template(
        goal=patch.goal,
        touch=patch.touch,
        place=patch.pose[:3],
        curvature=patch.k1,
        error=patch.k1_error,
        robot_time=patch.robot_time,
    )
    return patch.k1, [("/template", found)]


NODE = Node(
    params=Params,
    start=start,
    inputs={"/touch/patch": (SurfacePatch, take_patch)},
    outputs={"/template": Template},
)
