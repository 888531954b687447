"""The section of an undeformed prism: the superellipse that a loft's sections resemble.

Which place of the section becomes which place of the loft is free. The nearer both run around in
step, the less is left to deform: so the section is walked by the azimuths that the loft's own
mean section has at the same turns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from palpate.core.arrays import Floats
from palpate.core.rebuild.recovery import Recovery
from palpate.core.splines import Basis, Parallelepiped, PeriodicBasis

# Exponents: beyond 1 the rim bends without bound where it crosses the axes, and a square on its
# corner is a turned one; a sharper one would turn its corners between two places.
ROUNDEST, SHARPEST = 1.0, 0.2
EXPONENTS = np.array([1.0, 0.8, 0.6, 0.45, 0.33, 0.25, SHARPEST])
# Directions of the axes that are tried within a quarter turn, besides those of the ellipse.
ANGLES = 12
CLEARLY = 0.8  # Of the misfit of an ellipse along its own axes: another section must leave less
# Of a curve's first harmonic: less of the backward one is none, and no direction the longer.
EVEN = 1e-6
LEADS = 64  # Coefficients of the azimuths' lead
SLOWEST = 0.25  # Of the mean: least speed of the azimuth, so that no place is taken twice
THIN = 1e-3  # Least aspect of a section: a line cannot be a box
Complexes = NDArray[np.complex128]
RADIAL, ANGULAR = 7, 48  # Places of integrals over the section, at least


def fit_section(curves: Floats, grasp: Recovery | None = None) -> Section:
    """Section of a prism for layers of closed curves.

    Parameters
    ----------
    curves : (l, k, 2) array
        The layers at even turns, counter-clockwise, m; some may be points.
    grasp : Recovery, optional
        Superquadric that is known already: its second exponent, semi-axes and turn about the
        vertical are taken, and its place.

    Notes
    -----
    Layers are laid upon each other by their first harmonics, which hold the place, the size and
    the turn of a closed curve, before they are averaged.
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
    even = abs(backwards) <= EVEN * abs(forwards)
    own = 0.0 if even else 0.5 * float(np.angle(forwards * backwards))
    angles = np.concatenate([[own], 0.5 * np.pi * np.arange(ANGLES) / ANGLES])
    tried = [_boxed(mean, float(angle)) for angle in angles]
    misfits = np.array([_misfits(places, half) for places, half, _ in tried])
    worst = float(misfits[0, 0])
    row, column = np.unravel_index(misfits.argmin(), misfits.shape)
    if misfits[row, column] > CLEARLY * worst:
        row, column = np.intp(0), np.intp(0)
    places, half, centre = tried[int(row)]
    return _section(middle + centre, half, float(angles[row]), float(EXPONENTS[column]), places)


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


def _misfits(places: Complexes, half: Floats) -> Floats:
    """How far a curve is from the superellipse of each exponent, as a length."""
    azimuth, radius = np.angle(places), np.abs(places)
    off = [radius - np.abs(rim_of(float(e), azimuth)[0]) for e in EXPONENTS]
    misfits: Floats = np.sqrt(half[0] * half[1] * np.square(off).mean(axis=1))
    return misfits


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
    axes = half[:, None] * np.array(
        [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    )
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
    # Rows are the semi-axes, (2, 2), m; the second lies counter-clockwise of the first.
    axes: Floats
    exponent: float  # 1 is an ellipse, towards 0 it becomes a rectangle
    # By how much the azimuth runs ahead of the turn, in turns: coefficients of a closed spline,
    # (k,).
    lead: Floats

    @property
    def half_extent(self) -> Floats:
        """Semi-axes (2,), m."""
        lengths: Floats = np.linalg.norm(self.axes, axis=1)
        return lengths

    def frame(self, low: float, high: float) -> Parallelepiped:
        """The box around the prism that stands on it, from one height to another, m."""
        edges = np.zeros((3, 3))
        edges[:2, :2], edges[2, 2] = 2.0 * self.axes, high - low
        return Parallelepiped(np.array([*(self.middle - self.axes.sum(axis=0)), low]), edges)

    def rim(self, turns: Floats, derivative: int = 0) -> Floats:
        """Places (n, 2) of the rim in the box, from 0 to 1, or a derivative by the turn, to 2."""
        basis = PeriodicBasis(len(self.lead))
        lead = [basis.matrix(turns, order) @ self.lead for order in range(derivative + 1)]
        azimuth = 2.0 * np.pi * (turns + lead[0])
        around = rim_of(self.exponent, azimuth, derivative)
        found = around[derivative]
        if derivative:
            speed = 2.0 * np.pi * (1.0 + lead[1])
            found = found * speed**derivative
        if derivative == 2:
            found = found + around[1] * 2.0 * np.pi * lead[2]
        return np.column_stack([found.real, found.imag]) * 0.5 + (0.5 if derivative == 0 else 0.0)

    def inside(self, radial: int = RADIAL, angular: int = ANGULAR) -> tuple[Floats, Floats]:
        """Places (n, 2) in the box with weights (n,) of an integral over the section.

        The weights sum to the section's share of the box.
        """
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


def section_matrix(basis: Basis, places: Floats, orders: tuple[int, int] = (0, 0)) -> csr_array:
    """Functions of a section at places (n, 2), or a derivative of them: sparse (n, side^2)."""
    width = basis.degree + 1
    one, other = (basis.nonzero(places[:, axis], orders[axis]) for axis in (0, 1))
    columns = one.columns()[:, :, None] * basis.count + other.columns()[:, None, :]
    values = one.values[orders[0]][:, :, None] * other.values[orders[1]][:, None, :]
    starts = np.arange(0, columns.size + 1, width**2)
    shape = (len(places), basis.count**2)
    return csr_array((values.ravel(), columns.ravel(), starts), shape=shape)
