"""How much a spline's surface bends, and which points show how their touch is displaced.

A spline rounds off a sharp edge, so touched points beside an edge lie off it however exact their
poses are. If these points decided on the displacement of their touch, a fit would move whole faces
with all touches on them, to lie closer to the points beside edges: by 0.1 mm on a block, and by
0.5 mm with fewer touches. So the more the surface bends at a point, the less the point takes part
in the displacement of its touch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.geometry import axes_across
from palpate.core.rebuild.general.band import Band


@dataclass(frozen=True, slots=True, kw_only=True)
class BendSettings:
    """How the bend of a surface is measured, and where touches are too bent to be displaced."""

    reach: float = 3e-3  # [m] distance over which the bend is measured, an angle of normals
    n_directions: int = 6  # azimuths about a place at which normals are compared
    # Bend at which a point takes part in half of its touch's displacement [rad]. On a block 0.3
    # leaves faces 0.07 mm inside, 0.8 up to 0.25 mm outside.
    half_share: float = 0.5


DEFAULT_BENDS = BendSettings()


def surface_bends(
    band: Band, control: Floats, places: Floats, cell: float, settings: BendSettings
) -> Floats:
    """Largest angle (n,) between the normals at places (n, 3) and `reach` beside them [rad].

    Places are in cells of an edge `cell` [m]. Where the band ends nothing is known of the surface,
    which counts as flat.
    """

    def unit_gradients(at: Floats) -> Floats:
        gradient = band.evaluate(control, at)[1]
        return np.asarray(gradient / np.linalg.norm(gradient, axis=1, keepdims=True))

    bends, reach = np.zeros(len(places)), settings.reach / cell
    normals = unit_gradients(places)
    known = np.isfinite(normals).all(axis=1)
    places, normals = places[known], normals[known]
    axes = axes_across(normals)
    least = np.ones(len(places))  # cosine
    for turn in np.linspace(0.0, 2.0 * np.pi, settings.n_directions, endpoint=False):
        there = unit_gradients(
            places + reach * (np.cos(turn) * axes[:, 0] + np.sin(turn) * axes[:, 1])
        )
        least = np.fmin(least, np.einsum("ni,ni->n", normals, there))
    bends[known] = np.arccos(np.clip(least, -1.0, 1.0))
    return bends


def displacement_shares(bends: Floats, settings: BendSettings) -> Floats:
    """Shares (n,) of their touches' displacements in which points take part, by bends [rad]."""
    return np.asarray(1.0 / (1.0 + (bends / settings.half_share) ** 4))
