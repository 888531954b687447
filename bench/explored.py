"""The objects of the benches that explore: each as a scene describes it, or as a radius.

They are about 90 mm high and star-shaped in every slice. Add an object at the end of the table;
no setting of palpate may be tuned on those that are held out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from palpate.bench.radii import HELD_OUT
from palpate.core import shapes
from palpate.core.arrays import Floats
from palpate.core.explore.planners import TUNED
from palpate.core.geometry import close_rings

Radius = Callable[[Floats, Floats], Floats]  # Distance from the axis, by height and azimuth
# An object as a scene describes it, as a radius (heights from 0 to 1; radius and height as
# fractions of the object's height), or as a mesh [m]; each stands on z = 0.
ExploreObject = Mapping[str, Any] | Radius | shapes.Mesh
EXPLORED_HEIGHT = 0.09  # [m] of every object that is defined by its radius


def radial_rings(radii: Floats, heights: Floats, angles: Floats) -> Floats:
    """Points (m, n, 3) at radii about the z axis, heights (m,) and azimuths (n,) [rad]."""
    radii = np.broadcast_to(radii, (len(heights), len(angles)))
    levels = np.broadcast_to(heights[:, None], radii.shape)
    return np.stack([radii * np.cos(angles), radii * np.sin(angles), levels], axis=-1)


def closed_mesh(
    rings: Floats, low: Floats | None = None, high: Floats | None = None
) -> shapes.Mesh:
    """A mesh of rings (m, n, 3), closed at two points; by default the centres of the end rings."""
    low = rings[0].mean(axis=0) if low is None else low
    return shapes.Mesh(*close_rings(low, rings, rings[-1].mean(axis=0) if high is None else high))


def mesh_of_radius(radius: Radius, n_rings: int = 400, n_azimuths: int = 288) -> shapes.Mesh:
    """Mesh [m] of the solid with this radius, standing on z = 0 with flat or pointed ends.

    By default its facets deviate by 2 um, a tenth of the error of a touch.
    """
    # Rings are denser towards the ends, where a rounding or a pole has most curvature.
    z = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, n_rings))
    t = 2.0 * np.pi * np.arange(n_azimuths) / n_azimuths
    radii = EXPLORED_HEIGHT * np.asarray(radius(z[:, None], t[None, :]))
    rings = radial_rings(radii, EXPLORED_HEIGHT * z, t)
    return closed_mesh(rings, np.zeros(3), np.array([0.0, 0.0, EXPLORED_HEIGHT]))


def rounded(
    radius: Radius, rounding: float = 4e-3, min_width: float = 2.0, n_azimuths: int = 288
) -> Radius:
    """The same object with its flat ends rounded off.

    `rounding`: radius [m] between the side and a flat end. `min_width`: an end is left as it
    is unless its smallest radius / rounding is larger. `n_azimuths`: where the end is sampled.
    """
    share = rounding / EXPLORED_HEIGHT
    azimuths = np.linspace(0.0, 2.0 * np.pi, n_azimuths)
    widths = {end: float(np.min(radius(np.array(end), azimuths))) for end in (0.0, 1.0)}
    ends = [end for end, width in widths.items() if width > min_width * share]

    def rounded_radius(z: Floats, t: Floats) -> Floats:
        radii = radius(z, t)
        for end in ends:
            inside = np.clip(1.0 - np.abs(z - end) / share, 0.0, 1.0)
            radii = radii - share * (1.0 - np.sqrt(1.0 - inside**2))
        return np.asarray(radii)

    return rounded_radius


def described(x: float, y: float, z: float, e1: float, e2: float, **more: Any) -> dict[str, Any]:
    """A tapered or bent superquadric that stands on z = 0, as a scene describes it."""
    superquadric = {"size": [x, y, z], "exponents": [e1, e2], **more}
    return {"superquadric": superquadric, "pose": {"position": [0.0, 0.0, z]}}


LATTICE: Mapping[str, Any] = {
    **described(0.029, 0.025, 0.045, 0.4, 0.8),
    "lattice": [
        *({"scale": 0.8}, {"scale": 1.15}, {"scale": 1.25, "shift": [0.002, 0.0]}),
        *({"scale": 0.8, "turn": 10.0}, {"scale": 0.75, "turn": 15.0}, {"turn": 15.0}),
    ],
}
EXPLORED_OBJECTS: Mapping[str, ExploreObject] = {
    "sphere": described(0.045, 0.045, 0.045, 1.0, 1.0),
    "ellipsoid": described(0.036, 0.029, 0.045, 1.0, 1.0),
    "cylinder": described(0.028, 0.028, 0.045, 0.1, 1.0),
    "box": described(0.03, 0.022, 0.045, 0.2, 0.2),
    "egg": described(0.032, 0.032, 0.045, 1.0, 1.0, taper=[-0.2, -0.2]),
    "tapered and bent": described(0.028, 0.022, 0.045, 0.5, 0.7, taper=[0.3, 0.3], bend=5.0),
    "cone": rounded(lambda z, t: 0.36 - 0.2 * z + 0.0 * t),
    **{name: rounded(TUNED[name]) for name in ("bottle", "vase", "pear", "groove")},
    "step": rounded(TUNED["stepped"]),
    "twist": rounded(TUNED["twisted"]),
    **{name: rounded(TUNED[name]) for name in ("star", "hourglass")},
    "lattice": LATTICE,
    **{name: rounded(HELD_OUT[name]) for name in ("goblet", "potato")},
}
