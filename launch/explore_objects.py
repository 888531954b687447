"""Objects on which the whole exploration is measured: plain convex ones and featured ones.

Each is about 90 mm high, closed, and star-shaped in every slice. Some are solids that scenes know
by name; the others are fine meshes of a radius over height and azimuth, their ends rounded off.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.surface.rings import close_rings
from palpate.core.shapes.protocol import Mesh
from palpate.launch.planner_objects import TUNED, Radius

HEIGHT = 0.09
"""Of every object that is given by its radius, m."""
ROUNDING = 4e-3 / HEIGHT
"""Radius of the rounding where a side meets a flat end, over the height."""
BLUNT = 2.0
"""Roundings: an end that is narrower comes to a point by itself, and is not rounded."""
RINGS, TURNS = 400, 288
"""Of a mesh: its facets are off by 2 um, a tenth of what a touch tells."""

Kind = Literal["plain", "featured"]


class ExploreObject(NamedTuple):
    """Something to explore."""

    kind: Kind
    """Convex without features, or with some."""
    solid: Mapping[str, Any] | None = None
    """As a scene describes it, standing on z = 0; or else:"""
    radius: Radius | None = None
    """Radius over height and azimuth; heights and radii over `HEIGHT`."""

    def mesh(self) -> Mesh:
        """The object by its radius, standing on z = 0, m.

        Raises
        ------
        ValueError
            If it is none that is given by its radius.
        """
        if self.radius is None:
            raise ValueError("radius must be given for an object to have a mesh of its own")
        return mesh_of(self.radius)


def mesh_of(radius: Radius) -> Mesh:
    """The solid within a radius, with flat or pointed ends, as a closed mesh, m."""
    # Closer together towards the ends, where a rounding or a pole bends most.
    z = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, RINGS))
    t = 2.0 * np.pi * np.arange(TURNS) / TURNS
    wide = HEIGHT * np.asarray(radius(z[:, None], t[None, :]))
    level = np.broadcast_to(HEIGHT * z[:, None], wide.shape)
    rings = np.stack([wide * np.cos(t), wide * np.sin(t), level], axis=-1)
    low, high = np.zeros(3), np.array([0.0, 0.0, HEIGHT])
    return Mesh(*close_rings(low, rings, high))


def rounded(radius: Radius) -> Radius:
    """The same with its flat ends rounded off."""
    turns = np.linspace(0.0, 2.0 * np.pi, TURNS)
    low, high = (float(np.min(radius(np.array(z), turns))) for z in (0.0, 1.0))
    ends = [end for end, wide in ((0.0, low), (1.0, high)) if wide > BLUNT * ROUNDING]

    def shape(z: Floats, t: Floats) -> Floats:
        found = radius(z, t)
        for end in ends:
            inside = np.clip(1.0 - np.abs(z - end) / ROUNDING, 0.0, 1.0)
            found = found - ROUNDING * (1.0 - np.sqrt(1.0 - inside**2))
        return np.asarray(found)

    return shape


def _superquadric(
    size: tuple[float, float, float], exponents: tuple[float, float], **more: Any
) -> ExploreObject:
    described = {"size": list(size), "exponents": list(exponents), **more}
    return ExploreObject("plain", {"superquadric": described, **_on_the_floor(size[2])})


def _on_the_floor(half: float) -> dict[str, Any]:
    return {"pose": {"position": [0.0, 0.0, half]}}


def _featured(radius: Radius) -> ExploreObject:
    return ExploreObject("featured", radius=rounded(radius))


def _cone(z: Floats, t: Floats) -> Floats:
    return np.asarray(0.36 - 0.2 * z + 0.0 * t)


LATTICE: Mapping[str, Any] = {
    "superquadric": {"size": [0.029, 0.025, 0.045], "exponents": [0.4, 0.8]},
    "lattice": [
        *({"scale": 0.8}, {"scale": 1.15}, {"scale": 1.25, "shift": [0.002, 0.0]}),
        *({"scale": 0.8, "turn": 10.0}, {"scale": 0.75, "turn": 15.0}, {"turn": 15.0}),
    ],
    **_on_the_floor(0.045),
}

OBJECTS: Mapping[str, ExploreObject] = {
    "sphere": _superquadric((0.045, 0.045, 0.045), (1.0, 1.0)),
    "ellipsoid": _superquadric((0.036, 0.029, 0.045), (1.0, 1.0)),
    "cylinder": _superquadric((0.028, 0.028, 0.045), (0.1, 1.0)),
    "box": _superquadric((0.03, 0.022, 0.045), (0.2, 0.2)),
    "egg": _superquadric((0.032, 0.032, 0.045), (1.0, 1.0), taper=[-0.2, -0.2]),
    "tapered and bent": _superquadric(
        (0.028, 0.022, 0.045), (0.5, 0.7), taper=[0.3, 0.3], bend=5.0
    ),
    "cone": ExploreObject("plain", radius=rounded(_cone)),
    "bottle": _featured(TUNED["bottle"]),
    "vase": _featured(TUNED["vase"]),
    "pear": _featured(TUNED["pear"]),
    "groove": _featured(TUNED["groove"]),
    "step": _featured(TUNED["stepped"]),
    "twist": _featured(TUNED["twisted"]),
    "star": _featured(TUNED["star"]),
    "hourglass": _featured(TUNED["hourglass"]),
    "lattice": ExploreObject("featured", LATTICE),
}
"""All of the benches, by name."""
