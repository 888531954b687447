"""One guarded move of the same simulated finger that palpate explores with."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.aim import PRESS
from palpate.core.frames import pad_rotation, pose_of, split_pose
from palpate.core.rebuild.felt.felt_points import FeltPoints, felt_points
from palpate.core.touch.jet import Jet
from palpate.launch.bench_explore_trial import way_of
from palpate.launch.scene import load_scene
from palpate.messages.types import SurfacePatch, TactileFrame, TouchGoal
from palpate.nodes import curvature, filter, simulator
from palpate.nodes.node import Finished
from palpate.nodes.sensor import pad_of_spec

LEAST_UP = -0.7
"""Of a normal's z: the finger comes from no farther below."""


class Touched(NamedTuple):
    """What one touch came to."""

    outcome: str
    """As in a tactile frame."""
    end: Floats
    """Where the middle of the face then was, (3,), m."""
    felt: FeltPoints
    """Everything that touched; none after a miss."""
    smooth: bool
    """Whether the normals are to be trusted."""
    way: float
    """Of the finger, m."""


class Finger:
    """Simulator, filter and curvature as plain calls.

    Parameters
    ----------
    scene : Path
        The scene that is explored.
    """

    def __init__(self, scene: Path):
        spec = load_scene(scene).spec
        self._pad, self._made = pad_of_spec(spec.sensor), 0
        params = simulator.Params(
            object=spec.object,
            sensor=spec.sensor,
            effects=spec.effects,
            reach=spec.world.reach,
            seed=spec.seed,
        )
        given = ((simulator, params), (filter, filter.Params()), (curvature, curvature.Params()))
        self._nodes = [(module.NODE, own) for module, own in given]
        started = [node.start(own) for node, own in self._nodes]
        self._states: list[Any] = [state for state, _ in started]
        said = [one for _, outputs in started for one in outputs if not isinstance(one, Finished)]
        info = dict(said)["/touch/info"]
        for index in (1, 2):
            self._hear(index, "/touch/info", info)

    def touch(self, place: Floats, normal: Floats, standoff: float, beyond: float) -> Touched:
        """Come along a normal from before a place, and go no farther than behind it.

        Parameters
        ----------
        place, normal : (3,) arrays
            Where the surface is expected, m, and its outward unit normal.
        standoff, beyond : float
            How far before the place the pad starts, and how far behind it the way ends, m.
        """
        upward = max(float(normal[2]), LEAST_UP)
        heading = float(np.arctan2(normal[1], normal[0]))
        axes = pad_rotation(heading, float(np.arcsin(min(upward, 1.0))))
        goal = TouchGoal(
            goal=self._made,
            touch=0,
            finger=1,
            pose=pose_of(place - standoff * axes[:, 2], axes),
            reach=standoff + beyond,
            depth=PRESS,
            direction=axes[:, 1],
            not_before=0.0,
        )
        self._made += 1
        frame, *_ = self._hear(0, "/finger/goal", goal)  # a link may deliver it twice
        [image] = self._hear(1, "/touch/raw", frame)
        [patch] = self._hear(2, "/touch/image", image)
        return self._touched(frame, patch)

    def _touched(self, frame: TactileFrame, patch: SurfacePatch) -> Touched:
        jet = Jet(patch.jet, patch.jet_scale) if len(patch.jet) else None
        felt = felt_points(self._pad, patch.pose, patch.height, patch.mask, jet)
        end, _ = split_pose(patch.pose)
        return Touched(frame.outcome, end, felt, patch.kind == "smooth", way_of(frame.move))

    def _hear(self, index: int, topic: str, message: object) -> list[Any]:
        node, params = self._nodes[index]
        _, handler = node.inputs[topic]
        self._states[index], said = handler(params, self._states[index], message)
        return [one[1] for one in said if not isinstance(one, Finished)]
