"""How much of a deformed prism is turned inside out.

Heights are the same all over a layer, so that the change of volume is the change of area within
a layer times the rise from layer to layer.
"""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.lattice.section import Section
from palpate.core.rebuild.lattice.section_basis import section_matrix
from palpate.core.splines.basis import Basis, clamped_basis

RADII, TURNS, LAYERS = 7, 24, 3
"""Places at which folds are looked for: across a section, and for each layer."""


def folded_share(section: Section, along: Basis, control: Floats) -> float:
    """Share of a prism's volume that is turned inside out, sampled.

    Parameters
    ----------
    section : Section
        Of the prism.
    along : Basis
        Along its axis.
    control : (side, side, l, 3) array
        Control points, whose heights are the same all over a layer.
    """
    basis = clamped_basis(control.shape[0])
    places, weights = section.inside(RADII, TURNS)
    steps = LAYERS * along.count
    shares = (np.arange(steps) + 0.5) / steps
    layers = control[..., :2].reshape(basis.count**2, -1)
    slopes = []
    for orders in ((1, 0), (0, 1)):
        found = (section_matrix(basis, places, orders) @ layers).reshape(len(places), -1, 2)
        slopes.append(np.tensordot(along.matrix(shares).toarray(), found, (1, 1)))
    by_s, by_t = slopes
    change = by_s[..., 0] * by_t[..., 1] - by_s[..., 1] * by_t[..., 0]
    rise = along.matrix(shares, 1) @ control[0, 0, :, 2]
    folded = (change * rise[:, None] <= 0.0).mean(axis=0)
    return float(weights @ folded / weights.sum())
