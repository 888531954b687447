"""From a facet to the exact surface of a deformed solid, by Newton's method.

The unknowns are the place p in the undeformed solid and the way s along the ray:

    deform(p) = start + s direction,    f(p) = 0

with the solid's inside-outside function f. Eliminating p leaves one division a ray.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.shapes.protocol import ImplicitShape

if TYPE_CHECKING:
    from palpate.core.shapes.deformed import Deformation

MOST_STEPS = 12
STEP_TOLERANCE = 1e-8
"""Of the solid's size. The step after it would be its square."""
FARTHEST = 0.05
"""Of the solid's size: a place that moves farther is on another part of the surface."""


def polish(
    base: ImplicitShape,
    deformation: Deformation,
    places: Floats,
    starts: Floats,
    direction: Floats,
) -> tuple[Floats, Bools]:
    """Ways along parallel rays from near a deformed surface onto it.

    Parameters
    ----------
    base : ImplicitShape
        What is deformed.
    deformation : Deformation
        How.
    places : (n, 3) array
        Near the surface of the base, m.
    starts : (n, 3) array
        Where they are on the rays, about, m.
    direction : (3,) array
        The rays' unit direction.

    Returns
    -------
    ways : (n,) array
        To the surface, m; negative backwards.
    converged : (n,) array
        Where the way can be believed: the steps vanished, and on all of them the place stayed
        near and the surface faced the ray.
    """
    low, high = base.enclosure()  # a lattice says nothing of what lies beyond
    size = float((high - low).min())
    ways, first = np.zeros(len(places)), places
    lost = np.zeros(len(places), bool)
    for _ in range(MOST_STEPS):
        reached, slopes = deformation.deform_with_jacobian(places)
        residual = starts + ways[:, None] * direction - reached
        aside, along = _solved(slopes, residual, direction)
        value, slope_aside = base.inside_out(places, aside)
        slope = base.inside_out(places, along)[1]
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):  # those are lost
            way = -(value + slope_aside) / slope
            move = aside + way[:, None] * along
            step = np.maximum(np.abs(way), np.abs(move).max(axis=1))
            places, ways = np.clip(places + move, low, high), ways + way
            moved = np.maximum(np.abs(ways), np.abs(places - first).max(axis=1))
        lost |= ~((slope < 0.0) & (step < np.inf) & (moved <= FARTHEST * size))
        places, ways = np.where(lost[:, None], first, places), np.where(lost, 0.0, ways)
        done = ~lost & (step <= STEP_TOLERANCE * size)
        if (done | lost).all():
            break
    return ways, done


def _solved(matrices: Floats, first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Solutions (n, 3) of n systems of three equations for two right-hand sides.

    By Cramer's rule: the matrices are near to rotations, for no part of a solid is flattened.
    """
    x, y, z = matrices.transpose(2, 0, 1)
    rows = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1)
    volume = np.einsum("ni,ni->n", rows[:, 0], x)[:, None]
    return (rows @ first[:, :, None])[:, :, 0] / volume, (rows @ second) / volume
