"""A ball, a sensor and a world, and the nodes of one finger as plain calls in one process."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.poses import Pose, pad_rotation
from palpate.messages.types import World
from palpate.nodes import curvature, filter, simulator, tracer
from palpate.nodes.runtime.testing import drive_together
from palpate.nodes.specs.objects import ObjectSpec, PoseSpec, SuperquadricSpec
from palpate.nodes.specs.sensors import SensorSpec, info_of

Published = list[tuple[str, Any]]
RADIUS = 0.03  # Of the ball [m]
INFO = info_of(SensorSpec(), noise=0.0)
ALONE = World(platform=0.0, reach=0.15, fingers=1, seed=0)


def ball_spec(radius: float = RADIUS, middle: tuple[float, ...] | None = None) -> ObjectSpec:
    """A ball, which stands on height 0 unless it is said where its middle is."""
    solid = SuperquadricSpec(size=(radius,) * 3, exponents=(1.0, 1.0))
    return ObjectSpec(superquadric=solid, pose=PoseSpec(position=middle or (0.0, 0.0, radius)))


def sideways(height: float) -> Floats:
    """Pose of a pad that faces the z axis from the +x side."""
    return Pose(np.array([0.1, 0.0, height]), pad_rotation(0.0, 0.0)).array


def touching(
    goals: Iterable[tuple[str, Any]],
    simulated: simulator.Params,
    most_touches: int = 150,
    **filtered: Any,
) -> Published:
    """All that simulator, filter, curvature and tracer of a finger publish, goal after goal."""
    traced = tracer.Params(finger=simulated.finger, most_touches=most_touches)
    nodes = [(simulator.NODE, simulated), (filter.NODE, filtered), (curvature.NODE, None)]
    published = drive_together([*nodes, (tracer.NODE, traced)], goals)
    return [one for one in published if isinstance(one, tuple)]
