"""Objects by chance, of the same families: none had a say in any number of palpate.

What no pad could enter is left out: each is drawn anew until a ball of the dome's radius, rolled
along its side, comes near to all of it.
"""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.launch.explore_objects import HEIGHT, ExploreObject, rounded
from palpate.launch.planner_objects import Radius, drawn_objects

DOME = 0.015
"""Radius of the default pad, m."""
DEEPEST = 2.2e-3
"""How far the pad is pressed at most, m: what lies deeper under the ball cannot be felt."""
SAMPLES = 361
"""Along the height: a quarter of a millimetre apart."""
AZIMUTHS = 24
DRAWS = 200


def held_out(seed: int) -> ExploreObject:
    """An object by chance: round or straight, plain, lobed, twisted, necked, stepped or wavy.

    Parameters
    ----------
    seed : int
        The same seed, the same object.

    Raises
    ------
    ValueError
        If the seed is negative.
    """
    if seed < 0:
        raise ValueError(f"seed must be 0 or more, got {seed}")
    for radius in drawn_objects(DRAWS, seed).values():
        if hidden(radius) <= DEEPEST:
            return ExploreObject("featured", radius=rounded(radius))
    raise ValueError(f"seed must lead to an object that a pad can feel, {seed} does not")


def hidden(radius: Radius) -> float:
    """How deep the side lies at most under a ball of the dome's radius, m."""
    from scipy.ndimage import grey_closing

    step = HEIGHT / (SAMPLES - 1)
    reach = int(DOME / step)
    away = step * np.arange(-reach, reach + 1)
    ball = np.sqrt(DOME**2 - away**2) - DOME
    z, t = np.linspace(0.0, 1.0, SAMPLES), 2.0 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
    side = HEIGHT * np.asarray(radius(z[:, None], t[None, :]))
    beyond = ((2 * reach, 2 * reach), (0, 0))  # nothing holds the ball off there
    padded = np.pad(side, beyond, constant_values=-1.0)
    closed: Floats = grey_closing(padded, structure=ball[:, None])
    return float((closed - padded)[2 * reach : -2 * reach].max())
