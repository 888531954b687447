"""Control lattices that are made layer by layer: scaled, turned and shifted about the z axis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.splines.lattice import Lattice, box_lattice

SIDE = 4
"""Control points across a layer, each way: the fewest that a cubic basis takes."""
LEAST_CHANGE = 0.005
"""A lattice may shrink no part of its box to less than this share of its volume."""
ACROSS, ALONG = 5, 257
"""Places at which that is looked at, across the box each way and along it."""


class Layer(NamedTuple):
    """What happens to one layer of control points."""

    scale: float = 1.0
    """Widens it about the z axis."""
    turn: float = 0.0
    """Turns it about the z axis, rad."""
    shift: tuple[float, float] = (0.0, 0.0)
    """Moves it along x and y, m."""


def layered_lattice(box: Floats, layers: Sequence[Layer]) -> Lattice:
    """A control lattice over a box, each layer scaled, turned, then shifted.

    Parameters
    ----------
    box : (2, 3) array
        Smallest and largest coordinates, m.
    layers : sequence of layers
        From the bottom to the top; at least 4.
    """
    lattice = box_lattice(box[0], box[1] - box[0], (SIDE, SIDE, len(layers)))
    control = lattice.control.copy()
    for number, layer in enumerate(layers):
        cosine, sine = math.cos(layer.turn), math.sin(layer.turn)
        turn = np.array([[cosine, sine], [-sine, cosine]])
        across = control[:, :, number, :2]
        control[:, :, number, :2] = layer.scale * across @ turn + np.array(layer.shift)
    return lattice.with_control(control)


def flattened_share(lattice: Lattice) -> float:
    """Share of a lattice's box that is turned inside out or squeezed flat, 0 for a sound one."""
    across, along = np.linspace(0.0, 1.0, ACROSS), np.linspace(0.0, 1.0, ALONG)
    change = lattice.change_on_grid(across, across, along)
    return float((change <= LEAST_CHANGE).mean())
