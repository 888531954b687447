"""Sections of a control lattice: of the undeformed prism, and the control points of each layer.

The section is the superellipse that a side's sections resemble. Which place of it becomes which
place of the side is free: it is walked by the azimuths that the side's mean section has at the same
turns, so that little is left to deform. The side's knots along the axis are the lattice's; only the
height, which is no spline in that parameter, is followed with knots put in. The rim cannot see a
whole section: what it leaves open is settled by the bending energy of the map, which costs nothing
to move, turn, stretch or shear a layer; where that would fold the inside, rings between middle and
rim are drawn towards copies of the rim.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.rebuild.recovery import Recovery
from palpate.core.rebuild.side import SidePatch
from palpate.core.splines import (
    CUBIC,
    Basis,
    Parallelepiped,
    PeriodicBasis,
    clamped_basis,
)

ENOUGH = 1e-6  # Of the height between the ends: how closely heights are followed
MOST_LAYERS = 400
POINT = 1e-12  # Of the width: a layer that is narrower is a point
STEPS = 4  # Places between knots at which the height is compared
SAMPLES = 3  # Places for each layer to which a given number of layers is fitted
# What settles the inside: bending alone; rings on which lobes fade with the square of the way to
# the middle; or straight with the way, which folds no star.
SectionFill = Literal["bending", "rings", "cones"]
# Strengths of the bending energy, which if weaker meets the skin hardly better and folds far more,
# and of the rings, over the mean weight of the rim; and the power of the way from the middle with
# which the lobes of the rings fade.
STRENGTHS: dict[SectionFill, tuple[float, float, float]] = {
    "bending": (1e-3, 0.0, 0.0),
    "rings": (1e-5, 2e-2, 2.0),
    "cones": (1e-4, 2e-2, 1.0),
}
# Of second differences of the control points, over the bending: for those that lie where neither
# the rim nor the section is.
EVEN = 1e-3
HELD = 1e-13  # Weight of the displacements themselves: bounds the condition
RINGS = (0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.88)
# Exponents: beyond 1 the rim bends without bound where it crosses the axes, and a square on its
# corner is a turned one; a sharper one would turn its corners between two places.
ROUNDEST, SHARPEST = 1.0, 0.2
EXPONENTS = np.array([1.0, 0.8, 0.6, 0.45, 0.33, 0.25, SHARPEST])
ANGLES = 12  # Directions of the axes that are tried within a quarter turn, and the ellipse's
CLEARLY = 0.8  # Of the misfit of an ellipse along its own axes: another section must leave less
SECTION_EVEN = 1e-6  # Of a curve's first harmonic: less of the backward one is none
LEADS = 64  # Coefficients of the azimuths' lead
SLOWEST = 0.25  # Of the mean: least speed of the azimuth, so that no place is taken twice
THIN = 1e-3  # Least aspect of a section: a line cannot be a box
Complexes = NDArray[np.complex128]
RADIAL, ANGULAR = 7, 48  # Places of integrals over the section, at least


class Layers(NamedTuple):
    """Layers of a side, from its lowest to its highest."""

    basis: Basis  # Along the axis, from 0 to 1; cubic
    curves: Floats  # Coefficients of each layer's closed spline (l, k, 2) in the plane, m
    heights: Floats  # Coefficients (l,) of the height, m
    pinned: tuple[bool, bool]  # Whether the first and the last layer are points


def layers_of(patch: SidePatch, count: int | None = None) -> Layers:
    """As many layers as a side has, and more for the height, or `count`: ValueError if below 4."""
    if count is not None and count <= CUBIC:
        raise ValueError(f"layers must be at least {CUBIC + 1}, got {count}")
    basis = _for_heights(patch) if count is None else clamped_basis(count)
    places = basis.greville()
    if count is not None:
        places = np.linspace(0.0, 1.0, SAMPLES * max(count, patch.along.count))
    turns = np.arange(patch.around) / patch.around
    grid = patch.on_grid(places, turns)
    size = float(np.ptp(grid[..., :2], axis=(0, 1)).max())
    widths = [float(np.ptp(grid[end, :, :2], axis=0).max()) for end in (0, -1)]
    pinned = widths[0] <= POINT * size, widths[1] <= POINT * size
    circle = PeriodicBasis(patch.around).matrix(turns).toarray()
    around = np.linalg.solve(circle, grid[..., :2]).reshape(len(places), -1)
    values, matrix = np.column_stack([around, grid[:, 0, 2]]), basis.matrix(places).toarray()
    if count is None:
        found = np.linalg.solve(matrix, values)
    else:
        rest = values - matrix[:, [0, -1]] @ values[[0, -1]]
        inner = np.linalg.lstsq(matrix[:, 1:-1], rest, rcond=None)[0]
        found = np.concatenate([values[:1], inner, values[-1:]])  # the ends are taken as they are
    curves = found[:, :-1].reshape(basis.count, -1, 2)
    return Layers(basis, curves, found[:, -1], pinned)


def _for_heights(patch: SidePatch) -> Basis:
    """With a knot in the middle of each interval in which the height is not yet followed."""
    basis = patch.along
    low, high = _height(patch, np.array([0.0, 1.0]))
    while basis.count < MOST_LAYERS:
        sites = basis.greville()
        heights = np.linalg.solve(basis.matrix(sites).toarray(), _height(patch, sites))
        breaks = np.unique(basis.knots)
        shares = (np.arange(STEPS) + 0.5) / STEPS
        places = breaks[:-1, None] + np.diff(breaks)[:, None] * shares
        off = basis.matrix(places.ravel()) @ heights - _height(patch, places.ravel())
        wrong = np.abs(off).reshape(places.shape).max(axis=1) > ENOUGH * (high - low)
        if not wrong.any():
            break
        middles = 0.5 * (breaks[:-1] + breaks[1:])[wrong]
        basis = Basis(np.sort(np.concatenate([basis.knots, middles])), CUBIC)
    return basis


def _height(patch: SidePatch, shares: Floats) -> Floats:
    return np.asarray(patch.on_grid(shares, np.zeros(1))[:, 0, 2])


class SectionSystem(NamedTuple):
    """What a section's control points are solved with, for any curves."""

    section: Section  # The undeformed one
    basis: Basis  # Across it, each way
    rim: Floats  # Places of the rim in the box, (k, 2)
    seen: scipy.sparse.csr_array  # Functions at the rim, (k, side^2)
    form: Floats  # Their quadratic form, over its mean diagonal
    bending: Floats  # That of the bending energy, in the same measure


def section_system(section: Section, turns: Floats, side: int) -> SectionSystem:
    """Prepare a section for rims at even turns (k,), with so many control points each way."""
    basis = clamped_basis(side)
    rim = section.rim(turns)
    seen = section_matrix(basis, rim)
    form = (seen.T @ seen).toarray() / _mean(seen)
    bending = _bending(section, basis) + EVEN * _differences(side)
    return SectionSystem(section, basis, rim, seen, form, bending)


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
    return np.asarray(energy * (side**2 / np.trace(energy)))


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


def solve_section(
    system: SectionSystem, curves: Floats, fill: SectionFill = "bending"
) -> tuple[Floats, float]:
    """Control points (side, side, l, 2), m, for rims (l, k, 2), m, and the condition number."""
    section, side = system.section, system.basis.count
    bending, drawn, fading = STRENGTHS[fill]
    form = system.form + bending * system.bending + HELD * np.eye(side**2)
    box = (2.0 * system.rim - 1.0) @ section.axes
    moves = curves - section.middle - box  # The undeformed lattice is a map: how it must move
    right = system.seen.T @ _layers_last(moves) / _mean(system.seen)
    if drawn:
        inner = [section_matrix(system.basis, 0.5 + q * (system.rim - 0.5)) for q in RINGS]
        rings = scipy.sparse.vstack(inner, "csr")
        share = drawn / _mean(rings)
        form = form + share * (rings.T @ rings).toarray()
        # As the rim does: its affine part goes on to the middle straight, what is left of it fades.
        wanted, rows = _layers_last(moves), np.column_stack([box, np.ones(len(box))])
        affine = np.linalg.lstsq(rows, wanted, rcond=None)[0]
        rest = wanted - rows @ affine
        ways = [q * (box @ affine[:2]) + affine[2] + q**fading * rest for q in RINGS]
        right = right + share * (rings.T @ np.concatenate(ways))
    factor, _ = scipy.linalg.lapack.dpotrf(form, lower=1)
    moved = scipy.linalg.cho_solve((factor, True), right)
    share = float(scipy.linalg.lapack.dpocon(factor, np.abs(form).sum(axis=0).max(), uplo="L")[0])
    level = 2.0 * system.basis.greville() - 1.0
    undeformed = np.stack(np.meshgrid(level, level, indexing="ij"), axis=-1) @ section.axes
    control = moved.reshape(side, side, len(curves), 2) + undeformed[:, :, None]
    return control + section.middle, 1.0 / max(share, np.finfo(float).eps)


def _layers_last(values: Floats) -> Floats:
    """(l, k, 2) as (k, 2 l)."""
    return values.transpose(1, 0, 2).reshape(values.shape[1], -1)


def _mean(rows: scipy.sparse.csr_array) -> float:
    """Mean diagonal of the quadratic form of rows."""
    return float(np.square(rows.data).sum() / rows.shape[1])


def fit_section(curves: Floats, grasp: Recovery | None = None) -> Section:
    """Section of a prism for layers of closed curves (l, k, 2), m, of which some may be points.

    They run at even turns, counter-clockwise. Of a superquadric, the `grasp`, its second exponent,
    semi-axes, turn about the vertical and place are taken. Layers are laid upon each other by their
    first harmonics, which hold the place, size and turn of a closed curve, before averaging.
    """
    layers = curves[..., 0] + 1j * curves[..., 1]
    middles = layers.mean(axis=1)
    around = np.exp(-2j * np.pi * np.arange(curves.shape[1]) / curves.shape[1])
    first = ((layers - middles[:, None]) * around).mean(axis=1)
    weight = np.square(np.abs(first))
    total = max(float(weight.sum()), np.finfo(float).tiny)
    mean = (np.conj(first)[:, None] * (layers - middles[:, None])).sum(axis=0) / total
    middle = complex((weight * middles).sum() / total)
    usual = float(np.sqrt(total / len(layers)))
    toward = complex(first.sum())
    turn = toward / abs(toward) if abs(toward) > 0.0 else 1.0
    if grasp is None:
        return _resembling(mean * usual * turn, middle)
    return _grasped(mean * usual * turn, grasp)


def _resembling(mean: Complexes, middle: complex) -> Section:
    """The superellipse nearest to a curve about a place."""
    way = np.exp(2j * np.pi * np.arange(len(mean)) / len(mean))
    forwards, backwards = complex((mean / way).mean()), complex((mean * way).mean())
    even = abs(backwards) <= SECTION_EVEN * abs(forwards)
    own = 0.0 if even else 0.5 * float(np.angle(forwards * backwards))
    angles = np.concatenate([[own], 0.5 * np.pi * np.arange(ANGLES) / ANGLES])
    tried = [_boxed(mean, float(angle)) for angle in angles]
    misfits = np.empty((len(angles), len(EXPONENTS)))  # From the superellipse of each exponent
    for row, (places, half, _) in enumerate(tried):
        azimuth, radius = np.angle(places), np.abs(places)
        off = [radius - np.abs(rim_of(float(e), azimuth)[0]) for e in EXPONENTS]
        misfits[row] = np.sqrt(half[0] * half[1] * np.square(off).mean(axis=1))
    worst = float(misfits[0, 0])
    best, column = map(int, np.unravel_index(misfits.argmin(), misfits.shape))
    if misfits[best, column] > CLEARLY * worst:
        best, column = 0, 0
    places, half, centre = tried[best]
    return _section(middle + centre, half, float(angles[best]), float(EXPONENTS[column]), places)


def _boxed(mean: Complexes, angle: float) -> tuple[Complexes, Floats, complex]:
    """A curve in its upright box after a turn: places, half the box, and its middle."""
    turned = mean * np.exp(-1j * angle)
    low = np.array([turned.real.min(), turned.imag.min()])
    high = np.array([turned.real.max(), turned.imag.max()])
    half = 0.5 * (high - low)
    half = np.maximum(half, max(THIN * float(half.max()), np.finfo(float).tiny))
    centre = 0.5 * complex(*(low + high))
    off = turned - centre
    return off.real / half[0] + 1j * off.imag / half[1], half, centre * np.exp(1j * angle)


def _grasped(mean: Complexes, grasp: Recovery) -> Section:
    """The section of a superquadric, walked by a curve's azimuths about its own middle."""
    x, y, z, w = grasp.pose[3:]
    angle = float(np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z)))
    half = np.maximum(grasp.size[:2], THIN * float(grasp.size[:2].max()))
    turned = mean * np.exp(-1j * angle)
    places = turned.real / half[0] + 1j * turned.imag / half[1]
    exponent = float(np.clip(grasp.exponents[1], SHARPEST, ROUNDEST))
    return _section(complex(grasp.pose[0], grasp.pose[1]), half, angle, exponent, places)


def _section(
    middle: complex, half: Floats, angle: float, exponent: float, places: Complexes
) -> Section:
    """The section, walked by the azimuths of places (k,) at even turns in its box."""
    cos, sin = np.cos(angle), np.sin(angle)
    axes = half[:, None] * np.array([[cos, sin], [-sin, cos]])
    turns = np.arange(len(places)) / len(places)
    steps = np.angle(np.roll(places, -1) / np.where(places == 0.0, 1.0, places))
    azimuth = float(np.angle(places[0])) + np.concatenate([[0.0], np.cumsum(steps[:-1])])
    ahead = azimuth / (2.0 * np.pi) - turns
    if round(float(steps.sum()) / (2.0 * np.pi)) != 1:  # it does not run once around
        ahead = np.full(len(places), float(np.angle(places.mean() or 1.0)) / (2.0 * np.pi))
    basis = PeriodicBasis(min(LEADS, max(len(places) // 2, 4)))
    lead = np.linalg.lstsq(basis.matrix(turns).toarray(), ahead, rcond=None)[0]
    slope = float((basis.matrix(np.arange(4 * LEADS) / (4 * LEADS), 1) @ lead).min())
    if slope < SLOWEST - 1.0:
        lead = lead.mean() + (1.0 - SLOWEST) / -slope * (lead - lead.mean())
    return Section(np.array([middle.real, middle.imag]), axes, exponent, lead)


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """A superellipse in the plane."""

    middle: Floats  # (2,), m
    axes: Floats  # Rows are the semi-axes, (2, 2), m; the second counter-clockwise of the first
    exponent: float  # 1 is an ellipse, towards 0 it becomes a rectangle
    # By how much the azimuth runs ahead of the turn, in turns: coefficients of a closed spline,
    # (k,).
    lead: Floats

    @property
    def half_extent(self) -> Floats:
        """Semi-axes (2,), m."""
        return np.asarray(np.linalg.norm(self.axes, axis=1))

    def frame(self, low: float, high: float) -> Parallelepiped:
        """The box around the prism that stands on it, from one height to another, m."""
        edges = np.zeros((3, 3))
        edges[:2, :2], edges[2, 2] = 2.0 * self.axes, high - low
        return Parallelepiped(np.array([*(self.middle - self.axes.sum(axis=0)), low]), edges)

    def rim(self, turns: Floats, derivative: int = 0) -> Floats:
        """Places (n, 2) of the rim in the box, from 0 to 1, or a derivative by the turn, to 2."""
        basis = PeriodicBasis(len(self.lead))
        lead = [basis.matrix(turns, order) @ self.lead for order in range(derivative + 1)]
        around = rim_of(self.exponent, 2.0 * np.pi * (turns + lead[0]), derivative)
        found = around[derivative]
        if derivative:
            speed = 2.0 * np.pi * (1.0 + lead[1])
            found = found * speed**derivative
        if derivative == 2:
            found = found + around[1] * 2.0 * np.pi * lead[2]
        return np.column_stack([found.real, found.imag]) * 0.5 + (0.5 if derivative == 0 else 0.0)

    def inside(self, radial: int = RADIAL, angular: int = ANGULAR) -> tuple[Floats, Floats]:
        """Places (n, 2) in the box with weights (n,) of an integral; their sum is its share."""
        nodes, weights = np.polynomial.legendre.leggauss(radial)
        shares = 0.5 * (nodes + 1.0)
        rim = rim_of(self.exponent, 2.0 * np.pi * (np.arange(angular) + 0.5) / angular)[0]
        places = (shares[:, None] * rim).ravel()
        area = 0.25 * np.pi * (weights * shares)[:, None] * np.square(np.abs(rim)) / angular
        return 0.5 + 0.5 * np.column_stack([places.real, places.imag]), area.ravel()


def rim_of(exponent: float, azimuth: Floats, derivatives: int = 0) -> list[Complexes]:
    """Superellipse of semi-axes 1 at azimuths (n,), rad, as x + iy, with derivatives up to 2."""
    power = 2.0 / exponent
    c, s = np.cos(azimuth), np.sin(azimuth)
    a, b = np.abs(c), np.abs(s)
    gauge = a**power + b**power
    way = np.exp(1j * azimuth)
    radius = gauge ** (-1.0 / power)
    found = [radius * way]
    if derivatives:
        first = power * (b ** (power - 1.0) * np.sign(s) * c - a ** (power - 1.0) * np.sign(c) * s)
        slope = -radius / gauge * first / power
        found.append((slope + 1j * radius) * way)
    if derivatives == 2:
        bend = (power - 1.0) * (a ** (power - 2.0) * s**2 + b ** (power - 2.0) * c**2) - gauge
        second = -radius / gauge * (bend - (1.0 / power + 1.0) * first**2 / (gauge * power))
        found.append((second + 2j * slope - radius) * way)
    return found


def section_matrix(
    basis: Basis, places: Floats, orders: tuple[int, int] = (0, 0)
) -> scipy.sparse.csr_array:
    """Functions of a section at places (n, 2), or a derivative of them: sparse (n, side^2)."""
    width = basis.degree + 1
    one, other = (basis.nonzero(places[:, axis], orders[axis]) for axis in (0, 1))
    columns = one.columns()[:, :, None] * basis.count + other.columns()[:, None, :]
    values = one.values[orders[0]][:, :, None] * other.values[orders[1]][:, None, :]
    starts = np.arange(0, columns.size + 1, width**2)
    return scipy.sparse.csr_array(
        (values.ravel(), columns.ravel(), starts), shape=(len(places), basis.count**2)
    )
