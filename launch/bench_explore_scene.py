"""Scenes for the measurement of whole explorations: an object, its pose, its noise, its demand."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.frames import compose, pose_of
from palpate.core.rotation import rotations_of_vectors
from palpate.launch.explore_objects import HEIGHT, ExploreObject
from palpate.launch.mesh_export import write_mesh

EXACT: tuple[Mapping[str, Any], ...] = ()
NOISY: tuple[Mapping[str, Any], ...] = (
    {"pose_error": {"sigma": 1e-4}},
    {"gaussian_noise": {"sigma": 1e-5}},
)
"""The default noise: a place that is off by 0.1 mm along each axis, taxels by 10 um."""
NOISES = {"exact": EXACT, "noise": NOISY}
FEATURE = 3.0e-3
"""What may stay unfelt, m."""
MESH = "object.ply"


class Demand(NamedTuple):
    """What is asked of an exploration."""

    planner: str = "predicted"
    """Name of the rule."""
    tolerance: float = 0.002 * HEIGHT
    """Root mean square error, m."""
    settings: Mapping[str, Any] = {}
    """The rule's numbers."""
    axis: tuple[float, float, float] | None = None
    """Along which it is sliced; None for the object's own axis."""

    def keys(self) -> dict[str, Any]:
        """Its keys in a scene."""
        return {
            "planner": self.planner,
            "tolerance": self.tolerance,
            "feature": FEATURE,
            "settings": dict(self.settings),
            "axis": None if self.axis is None else list(self.axis),
        }


def write_scene(
    folder: Path,
    target: ExploreObject,
    noise: tuple[Mapping[str, Any], ...],
    demand: Demand,
    seed: int = 0,
    moved: Floats | None = None,
) -> Path:
    """A scene with one object.

    Parameters
    ----------
    folder : Path
        Where it is written; the object's mesh too, if it has one.
    target : ExploreObject
        What stands there.
    noise : tuple of maps
        Effects, as scenes list them.
    demand : Demand
        What is asked of the exploration.
    seed : int
        Of all that is random.
    moved : (7,) array, optional
        Pose of the object's own frame in the world, m.

    Returns
    -------
    Path
        The scene's file.
    """
    solid = dict(target.solid or {})
    if target.solid is None:
        write_mesh(folder / MESH, *target.mesh())
        solid["mesh"] = {"file": MESH, "unit": "m"}
    if moved is not None:
        place = solid.get("pose", {}).get("position", [0.0, 0.0, 0.0])
        found = compose(moved, pose_of(np.array(place), np.eye(3)))
        solid["pose"] = {"position": found[:3].tolist(), "rotation": found[3:].tolist()}
    scene = {"object": solid, "effects": list(noise), "explore": demand.keys(), "seed": seed}
    path = folder / "scene.yaml"
    path.write_text(json.dumps(scene), encoding="utf-8")  # JSON is YAML too
    return path


def leaning(degrees: float, away: float, lift: float) -> Floats:
    """Pose (7,) of an object that leans about the y axis and stands beside the world's, m."""
    turn = np.array([[0.0, np.radians(degrees), 0.0]])
    return pose_of(np.array([away, 0.0, lift]), rotations_of_vectors(turn)[0])
