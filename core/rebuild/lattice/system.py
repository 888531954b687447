"""Layers of a control lattice along its axis, and the control points of its sections.

The loft is a spline along its parameter with a closed curve for each coefficient. Its knots are
the lattice's; only the height, which is no spline in that parameter, is followed with knots put
in. The rim cannot see a whole section: what it leaves open is settled by the bending energy of
the map, which costs nothing to move, turn, stretch or shear a layer; where that would fold the
inside, rings between middle and rim are drawn towards copies of the rim.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from scipy.linalg import cho_solve, lapack
from scipy.sparse import csr_array, vstack

from palpate.core.arrays import Floats
from palpate.core.rebuild.lattice.section import ANGULAR, RADIAL, Section, section_matrix
from palpate.core.rebuild.loft import ContourSurface
from palpate.core.splines import CUBIC, Basis, clamped_basis, insert_knots

ENOUGH = 1e-6  # Of the height between the ends: how closely heights are followed
MOST_LAYERS = 400
STEPS = 4  # Places between knots at which the height is compared
SAMPLES = 3  # Places for each layer to which a given number of layers is fitted
# What settles the inside: bending alone; rings on which lobes fade with the square of the way to
# the middle; or straight with the way, which folds no star.
SectionFill = Literal["bending", "rings", "cones"]
# Of second differences of the control points, over the bending: for those that lie where neither
# the rim nor the section is.
EVEN = 1e-3
HELD = 1e-13  # Weight of the displacements themselves: bounds the condition
RINGS = (0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.88)


class Layers(NamedTuple):
    """Layers of a skin, from its lowest to its highest."""

    basis: Basis  # Along the axis, from 0 to 1; cubic
    curves: Floats  # Coefficients of each layer's closed spline (l, k, 2) in the plane, m
    heights: Floats  # Coefficients (l,) of the height, m
    pinned: tuple[bool, bool]  # Whether the first and the last layer are points


def layers_of(surface: ContourSurface, count: int | None = None) -> Layers:
    """Layers of a skin.

    Parameters
    ----------
    surface : ContourSurface
        The skin.
    count : int, optional
        How many layers; as many as the skin has, and further ones for the height, if left out.

    Raises
    ------
    ValueError
        If the count is less than 4.
    """
    if count is not None and count <= CUBIC:
        raise ValueError(f"layers must be at least {CUBIC + 1}, got {count}")
    control = surface.control + surface.middle
    low, high = surface.along.domain
    own = Basis((surface.along.knots - low) / (high - low), surface.along.degree)
    pinned = _is_point(control[0], control), _is_point(control[-1], control)
    if count is None:
        basis, curves = _cubic(own, control)
        basis, curves = _for_heights(surface, basis, curves)
        heights = _interpolated(basis, _height(surface, basis.greville()))
    else:
        basis = clamped_basis(count)
        places = np.linspace(0.0, 1.0, SAMPLES * max(count, own.count))
        values = (own.matrix(places) @ control.reshape(own.count, -1)).reshape(len(places), -1)
        values = np.column_stack([values, _height(surface, places)])
        found = _fitted(basis, places, values)
        curves, heights = found[:, :-1].reshape(count, -1, 2), found[:, -1]
    return Layers(basis, curves, heights, pinned)


def _is_point(curve: Floats, control: Floats) -> bool:
    size = float(np.ptp(control, axis=(0, 1)).max())
    return float(np.ptp(curve, axis=0).max()) <= 1e-12 * size


def _cubic(basis: Basis, control: Floats) -> tuple[Basis, Floats]:
    """The same spline with cubic functions; lower degrees, of few contours, have no inner knots."""
    if basis.degree == CUBIC:
        return basis, control
    raised = clamped_basis(CUBIC + 1)
    values = basis.matrix(raised.greville()) @ control.reshape(basis.count, -1)
    return raised, _interpolated(raised, values).reshape(CUBIC + 1, -1, 2)


def _for_heights(surface: ContourSurface, basis: Basis, curves: Floats) -> tuple[Basis, Floats]:
    """With a knot in the middle of each interval in which the height is not yet followed."""
    extent = surface.latitude.high - surface.latitude.low
    while basis.count < MOST_LAYERS:
        heights = _interpolated(basis, _height(surface, basis.greville()))
        breaks = np.unique(basis.knots)
        shares = (np.arange(STEPS) + 0.5) / STEPS
        places = breaks[:-1, None] + np.diff(breaks)[:, None] * shares
        off = basis.matrix(places.ravel()) @ heights - _height(surface, places.ravel())
        wrong = np.abs(off).reshape(places.shape).max(axis=1) > ENOUGH * extent
        if not wrong.any():
            break
        new = 0.5 * (breaks[:-1] + breaks[1:])[wrong]
        basis, curves = insert_knots(basis, curves, new)
    return basis, curves


def _interpolated(basis: Basis, values: Floats) -> Floats:
    """Coefficients with values at the Greville abscissae."""
    matrix = basis.matrix(basis.greville()).toarray()
    found: Floats = np.linalg.solve(matrix, values)
    return found


def _height(surface: ContourSurface, shares: Floats) -> Floats:
    low, high = surface.along.domain
    return surface.latitude.height(low + (high - low) * shares)


def _fitted(basis: Basis, places: Floats, values: Floats) -> Floats:
    """Coefficients nearest to values (n, d), with the first and the last taken as they are."""
    matrix = basis.matrix(places).toarray()
    ends = matrix[:, [0, -1]] @ values[[0, -1]]
    inner = np.linalg.lstsq(matrix[:, 1:-1], values - ends, rcond=None)[0]
    return np.concatenate([values[:1], inner, values[-1:]])


class Strengths(NamedTuple):
    """Of what settles the inside, over the mean weight of the rim."""

    bending: float  # Of the bending energy
    drawn: float  # Of the rings
    fading: float  # Power of the way from the middle with which the lobes of the rings fade


class SectionSystem(NamedTuple):
    """What a section's control points are solved with, for any curves."""

    section: Section  # The undeformed one
    basis: Basis  # Across it, each way
    rim: Floats  # Places of the rim in the box, (k, 2)
    seen: csr_array  # Functions at the rim, (k, side^2)
    form: Floats  # Their quadratic form, over its mean diagonal
    bending: Floats  # That of the bending energy, in the same measure


class SolvedSection(NamedTuple):
    """Control points of a section's layers."""

    control: Floats  # (side, side, l, 2), m
    condition: float  # Estimated condition number of the system


def section_system(section: Section, turns: Floats, side: int) -> SectionSystem:
    """Prepare a section.

    Parameters
    ----------
    section : Section
        The undeformed one.
    turns : (k,) array
        Even, in turns.
    side : int
        Control points across the section each way, at least 4.
    """
    basis = clamped_basis(side)
    rim = section.rim(turns)
    seen = section_matrix(basis, rim)
    bending = _bending(section, basis) + EVEN * _differences(side)
    return SectionSystem(section, basis, rim, seen, _over_mean(seen), bending)


def _bending(section: Section, basis: Basis) -> Floats:
    """Bending energy over the section, over its mean diagonal."""
    side = basis.count
    places, weights = section.inside(max(RADIAL, side), max(ANGULAR, 5 * side))
    aspect = section.half_extent / np.sqrt(np.prod(section.half_extent))
    energy = np.zeros((side**2, side**2))
    for orders, factor in (((2, 0), 1.0), ((0, 2), 1.0), ((1, 1), 2.0)):
        measure = factor * weights / np.prod(aspect ** (2 * np.array(orders)))
        rows = section_matrix(basis, places, orders)
        rows.data *= np.repeat(np.sqrt(measure), np.diff(rows.indptr))
        energy += (rows.T @ rows).toarray()
    over: Floats = energy * (side**2 / np.trace(energy))
    return over


@lru_cache(maxsize=16)
def _differences(side: int) -> Floats:
    """Squared second differences over a section, the mixed ones twice, over their mean."""
    unit = np.eye(side)
    second, first = np.diff(unit, 2, axis=0), np.diff(unit, axis=0)
    bend, slope = second.T @ second, first.T @ first
    form = np.kron(bend, unit) + np.kron(unit, bend) + 2.0 * np.kron(slope, slope)
    form *= side**2 / np.trace(form)
    form.setflags(write=False)
    return np.asarray(form)


def _over_mean(rows: csr_array) -> Floats:
    form: Floats = (rows.T @ rows).toarray()
    return form / _mean(rows)


def solve_section(
    system: SectionSystem, curves: Floats, fill: SectionFill = "bending"
) -> SolvedSection:
    """Deform a section so that its rim becomes curves.

    Parameters
    ----------
    system : System
        The section.
    curves : (l, k, 2) array
        What the rim shall become in each layer, m.
    fill : str
        What settles the inside.
    """
    section, side = system.section, system.basis.count
    strengths = STRENGTHS[fill]
    form = system.form + strengths.bending * system.bending + HELD * np.eye(side**2)
    box = (2.0 * system.rim - 1.0) @ section.axes
    # The undeformed lattice is a map, too: what is solved for is how it must move.
    moves = curves - section.middle - box
    right = system.seen.T @ _layers_last(moves) / _mean(system.seen)
    if strengths.drawn:
        inner = [section_matrix(system.basis, 0.5 + q * (system.rim - 0.5)) for q in RINGS]
        rings = vstack(inner, "csr")
        share = strengths.drawn / _mean(rings)
        form = form + share * (rings.T @ rings).toarray()
        right = right + share * (rings.T @ _inner(box, _layers_last(moves), strengths.fading))
    factor, _ = lapack.dpotrf(form, lower=1)
    moved = cho_solve((factor, True), right)
    share = float(lapack.dpocon(factor, np.abs(form).sum(axis=0).max(), uplo="L")[0])
    level = 2.0 * system.basis.greville() - 1.0
    undeformed = np.stack(np.meshgrid(level, level, indexing="ij"), axis=-1) @ section.axes
    control = moved.reshape(side, side, len(curves), 2) + undeformed[:, :, None]
    return SolvedSection(control + section.middle, 1.0 / max(share, np.finfo(float).eps))


def _layers_last(values: Floats) -> Floats:
    """(l, k, 2) as (k, 2 l)."""
    flat: Floats = values.transpose(1, 0, 2).reshape(values.shape[1], -1)
    return flat


def _mean(rows: csr_array) -> float:
    """Mean diagonal of the quadratic form of rows."""
    return float(np.square(rows.data).sum() / rows.shape[1])


def _inner(box: Floats, moves: Floats, fading: float) -> Floats:
    """How the rings shall move, (rings k, 2 l): as the rim does, less and less of it.

    Its affine part goes on to the middle straight, what is left of it fades.
    """
    rows = np.column_stack([box, np.ones(len(box))])
    affine = np.linalg.lstsq(rows, moves, rcond=None)[0]
    rest = moves - rows @ affine
    return np.concatenate([q * (box @ affine[:2]) + affine[2] + q**fading * rest for q in RINGS])


# Weaker bending meets the skin hardly better, and folds far more.
STRENGTHS: dict[SectionFill, Strengths] = {
    "bending": Strengths(1e-3, 0.0, 0.0),
    "rings": Strengths(1e-5, 2e-2, 2.0),
    "cones": Strengths(1e-4, 2e-2, 1.0),
}
