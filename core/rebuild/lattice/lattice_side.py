"""The side of a deformed prism, as a piece of a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, diags_array

from palpate.core.arrays import Floats
from palpate.core.rebuild.lattice.section import Section
from palpate.core.rebuild.lattice.section_basis import section_matrix
from palpate.core.splines.volume import Volume

BLOCK = 4096
"""Turns for which columns of layers are laid out at a time."""


@dataclass(frozen=True, slots=True, eq=False)
class LatticeSide:
    """What the side of a prism becomes, from 0 at its lower end to 1 at its upper one.

    Exact at every place: its derivatives are those of the volume, by the chain rule along the
    rim of the prism's section. For each turn the section's functions are summed once, to a
    spline along the side, however many places share the turn.
    """

    section: Section
    """Of the prism."""
    volume: Volume
    """The deformed one."""

    def at(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """Points (n, 3), m, at shares v and turns (n,), or derivatives by them, together to 2."""
        v, turns = np.asarray(v, float), np.mod(np.asarray(turns, float), 1.0)
        if self.volume.weights is None:
            return self._sums(v, turns, by)
        parts = {
            (i, j): self._sums(v, turns, (i, j)) for i in range(by[0] + 1) for j in range(by[1] + 1)
        }
        return _quotients(parts)[by]

    def parameters(self, v: Floats, turns: Floats) -> Floats:
        """s, t and u (n, 3) of places of the side."""
        return np.column_stack([self.section.rim(np.asarray(turns)), v])

    def _sums(self, v: Floats, turns: Floats, by: tuple[int, int]) -> Floats:
        """Sums of the functions (n, 3), or with the weights' own (n, 4), or derivatives."""
        spline = self.volume.spline
        columns = spline.reshape(-1, spline.shape[2] * spline.shape[3])
        found = np.empty((len(v), spline.shape[3]))
        distinct, which = np.unique(turns, return_inverse=True)
        local = self.volume.bases[2].nonzero(v, by[0])
        layers, values = local.columns(), local.values[by[0]]
        for start in range(0, len(distinct), BLOCK):
            rows = (which >= start) & (which < start + BLOCK)
            part = slice(None) if rows.all() else np.flatnonzero(rows)
            across = self._across(distinct[start : start + BLOCK], by[1])
            along = (across @ columns).reshape(-1, spline.shape[2], spline.shape[3])
            near = along[(which[part] - start)[:, None], layers[part]]
            found[part] = np.einsum("nk,nkc->nc", values[part], near)
        return found

    def _across(self, turns: Floats, derivative: int) -> csr_array:
        """Functions of the section along its rim, or a derivative by the turn, (n, side^2)."""
        basis = self.volume.bases[0]
        rim = self.section.rim(turns)
        if derivative == 0:
            return section_matrix(basis, rim)
        speed = self.section.rim(turns, 1)
        terms = [((1, 0), speed[:, 0]), ((0, 1), speed[:, 1])]
        if derivative == 2:
            bend = self.section.rim(turns, 2)
            terms = [((1, 0), bend[:, 0]), ((0, 1), bend[:, 1])]
            terms += [((2, 0), speed[:, 0] ** 2), ((0, 2), speed[:, 1] ** 2)]
            terms += [((1, 1), 2.0 * speed[:, 0] * speed[:, 1])]
        rows = [diags_array(factor) @ section_matrix(basis, rim, by) for by, factor in terms]
        return csr_array(sum(rows[1:], rows[0]))


def _quotients(parts: dict[tuple[int, int], Floats]) -> dict[tuple[int, int], Floats]:
    """Points and derivatives (n, 3) of a quotient from those of its parts (n, 4), lowest first.

    By the product rule for the points times the weight, solved for the highest derivative.
    """
    found: dict[tuple[int, int], Floats] = {}
    weight = parts[0, 0][:, 3:]
    for (i, j), part in parts.items():
        rest = part[:, :3].copy()
        for (a, b), lower in found.items():
            if a <= i and b <= j:
                rest -= _CHOOSE[i][a] * _CHOOSE[j][b] * lower * parts[i - a, j - b][:, 3:]
        found[i, j] = rest / weight
    return found


_CHOOSE = ((1, 0, 0), (1, 1, 0), (1, 2, 1))
