"""Sections of a control lattice: of the undeformed prism, and the control points of each layer.

The prism's section is the superellipse that the side's sections resemble. At each turn it has the
azimuth of the side's mean section at that turn, so that the deformation is small. The lattice has
the side's knots along the axis; knots are inserted for the height alone, which is no spline in that
parameter. The rim does not determine a whole section: the rest follows from the bending energy of
the map, which is 0 for a layer that is moved, turned, stretched or sheared. Where the inside would
fold, rings between the middle and the rim are drawn towards scaled copies of the rim.
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

Complexes = NDArray[np.complex128]
# What determines the inside of a section: bending alone; rings on which lobes fade with the square
# of the distance from the middle; or cones, on which they fade linearly, which fold no star.
SectionFill = Literal["bending", "rings", "cones"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerSettings:
    """How closely layers of control points follow a side along its axis."""

    height_tolerance: float = 1e-6  # fraction of the height between the ends
    max_layers: int = 400
    point_width: float = 1e-12  # fraction of the width: a narrower layer is a point
    n_heights: int = 4  # places between knots at which the height is compared
    samples_per_layer: int = 3  # places to which a given number of layers is fitted


@dataclass(frozen=True, slots=True, kw_only=True)
class SectionSettings:
    """Which superellipse the prism has as its section, and how its azimuth follows the turn.

    Exponents range from round to sharp: beyond 1 the rim's curvature has no bound on the axes, and
    a square on its corner is a turned square; sharper corners lie between two places of the rim.
    """

    exponents: tuple[float, ...] = (1.0, 0.8, 0.6, 0.45, 0.33, 0.25, 0.2)  # that are tried
    n_directions: int = 12  # of the axes within a quarter turn, besides the ellipse's own
    max_misfit_ratio: float = 0.8  # over the misfit of the ellipse, for another section to be used
    min_harmonic_ratio: float = 1e-6  # backward over forward harmonic; a circle has less
    n_lead: int = 64  # coefficients of the lead of the azimuth over the turn
    min_azimuth_speed: float = 0.25  # fraction of its mean; above 0 it never runs backwards
    min_aspect: float = 1e-3  # of a section; a flatter one is widened


@dataclass(frozen=True, slots=True, kw_only=True)
class FillWeights:
    """Weights of what determines the inside of a section, over the mean weight of its rim."""

    bending: float  # bending energy: weaker, it hardly improves the misfit and folds far more
    rings: float = 0.0  # rings between the middle and the rim
    power: float = 0.0  # of the distance from the middle, with which lobes of the rings fade


@dataclass(frozen=True, slots=True, kw_only=True)
class SystemSettings:
    """Terms of the system for the control points of a section."""

    bending: FillWeights = FillWeights(bending=1e-3)
    rings: FillWeights = FillWeights(bending=1e-5, rings=2e-2, power=2.0)
    cones: FillWeights = FillWeights(bending=1e-4, rings=2e-2, power=1.0)
    ring_radii: tuple[float, ...] = (0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.88)  # fraction of the rim's
    # Of second differences of the control points, over the bending energy: for control points that
    # lie outside both the rim and the section.
    second_difference_weight: float = 1e-3
    displacement_weight: float = 1e-13  # over the mean weight of the rim: bounds the condition
    n_radii: int = 7  # places across, at least, of the integral of the bending energy
    n_angles: int = 48  # places around, at least, of that integral
    angles_per_point: int = 5  # places around of that integral for each control point across


class Layers(NamedTuple):
    """Layers of a side, from its lowest to its highest."""

    basis: Basis  # along the axis, from 0 to 1; cubic
    curves: Floats  # coefficients of each layer's closed spline in the plane, (l, k, 2) [m]
    heights: Floats  # coefficients of the height, (l,) [m]
    pinned: tuple[bool, bool]  # whether the first and the last layer are points


def layers_of(patch: SidePatch, count: int | None, settings: LayerSettings) -> Layers:
    """As many layers as a side has, and more for the height, or `count`: ValueError if below 4."""
    if count is not None and count <= CUBIC:
        raise ValueError(f"layers must be at least {CUBIC + 1}, got {count}")
    basis = _height_basis(patch, settings) if count is None else clamped_basis(count)
    places = basis.greville()
    if count is not None:
        places = np.linspace(0.0, 1.0, settings.samples_per_layer * max(count, patch.along.count))
    turns = np.arange(patch.around) / patch.around
    grid = patch.on_grid(places, turns)
    size = float(np.ptp(grid[..., :2], axis=(0, 1)).max())
    widths = [float(np.ptp(grid[end, :, :2], axis=0).max()) for end in (0, -1)]
    point = settings.point_width * size
    pinned = widths[0] <= point, widths[1] <= point
    circle = PeriodicBasis(patch.around).matrix(turns).toarray()
    around = np.linalg.solve(circle, grid[..., :2]).reshape(len(places), -1)
    values, matrix = np.column_stack([around, grid[:, 0, 2]]), basis.matrix(places).toarray()
    if count is None:
        coefficients = np.linalg.solve(matrix, values)
    else:  # both ends are kept
        rest = values - matrix[:, [0, -1]] @ values[[0, -1]]
        inner = np.linalg.lstsq(matrix[:, 1:-1], rest, rcond=None)[0]
        coefficients = np.concatenate([values[:1], inner, values[-1:]])
    curves = coefficients[:, :-1].reshape(basis.count, -1, 2)
    return Layers(basis, curves, coefficients[:, -1], pinned)


def _height_basis(patch: SidePatch, settings: LayerSettings) -> Basis:
    """The patch's basis with knots inserted until the height is within its tolerance."""
    basis = patch.along
    low, high = _height(patch, np.array([0.0, 1.0]))
    while basis.count < settings.max_layers:
        sites = basis.greville()
        heights = np.linalg.solve(basis.matrix(sites).toarray(), _height(patch, sites))
        breaks = np.unique(basis.knots)
        shares = (np.arange(settings.n_heights) + 0.5) / settings.n_heights
        places = breaks[:-1, None] + np.diff(breaks)[:, None] * shares
        off = basis.matrix(places.ravel()) @ heights - _height(patch, places.ravel())
        most = settings.height_tolerance * (high - low)
        wrong = np.abs(off).reshape(places.shape).max(axis=1) > most
        if not wrong.any():
            break
        middles = 0.5 * (breaks[:-1] + breaks[1:])[wrong]
        basis = Basis(np.sort(np.concatenate([basis.knots, middles])), CUBIC)
    return basis


def _height(patch: SidePatch, shares: Floats) -> Floats:
    return np.asarray(patch.on_grid(shares, np.zeros(1))[:, 0, 2])


class SectionSystem(NamedTuple):
    """The system for a section's control points, for any curves of its rim."""

    section: Section  # of the undeformed prism
    basis: Basis  # across it, each way
    rim: Floats  # places of the rim in the box, (k, 2)
    at_rim: scipy.sparse.csr_array  # basis functions at the rim, (k, side^2)
    form: Floats  # their quadratic form, over its mean diagonal
    bending: Floats  # quadratic form of the bending energy, over its mean diagonal
    settings: SystemSettings


def section_system(
    section: Section, turns: Floats, side: int, settings: SystemSettings
) -> SectionSystem:
    """Prepare a section for rims at even turns (k,), with `side` control points each way."""
    basis = clamped_basis(side)
    rim = section.rim(turns)
    at_rim = section_matrix(basis, rim)
    form = (at_rim.T @ at_rim).toarray() / _mean(at_rim)
    bending = _bending(section, basis, settings)
    bending = bending + settings.second_difference_weight * _differences(side)
    return SectionSystem(section, basis, rim, at_rim, form, bending, settings)


def _bending(section: Section, basis: Basis, settings: SystemSettings) -> Floats:
    """Quadratic form of the bending energy over the section, over its mean diagonal."""
    side = basis.count
    n_angles = max(settings.n_angles, settings.angles_per_point * side)
    places, weights = section.inside(max(settings.n_radii, side), n_angles)
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
    """Quadratic form of second differences, the mixed ones twice, over its mean diagonal."""
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
    """Control points (side, side, l, 2) [m] for rims (l, k, 2) [m], and the condition number."""
    section, side, settings = system.section, system.basis.count, system.settings
    weights: FillWeights = getattr(settings, fill)
    form = system.form + weights.bending * system.bending
    form = form + settings.displacement_weight * np.eye(side**2)
    box = (2.0 * system.rim - 1.0) @ section.axes
    moves = curves - section.middle - box  # displacements from the undeformed lattice
    right = system.at_rim.T @ _layers_last(moves) / _mean(system.at_rim)
    if weights.rings:
        radii = settings.ring_radii
        inner = [section_matrix(system.basis, 0.5 + q * (system.rim - 0.5)) for q in radii]
        rings = scipy.sparse.vstack(inner, "csr")
        share = weights.rings / _mean(rings)
        form = form + share * (rings.T @ rings).toarray()
        # Rings follow the affine part of the rim's displacement; the rest fades to the middle.
        wanted, rows = _layers_last(moves), np.column_stack([box, np.ones(len(box))])
        affine = np.linalg.lstsq(rows, wanted, rcond=None)[0]
        rest = wanted - rows @ affine
        drawn = [q * (box @ affine[:2]) + affine[2] + q**weights.power * rest for q in radii]
        right = right + share * (rings.T @ np.concatenate(drawn))
    factor, _ = scipy.linalg.lapack.dpotrf(form, lower=1)
    moved = scipy.linalg.cho_solve((factor, True), right)
    share = float(scipy.linalg.lapack.dpocon(factor, np.abs(form).sum(axis=0).max(), uplo="L")[0])
    level = 2.0 * system.basis.greville() - 1.0
    undeformed = np.stack(np.meshgrid(level, level, indexing="ij"), axis=-1) @ section.axes
    control = moved.reshape(side, side, len(curves), 2) + undeformed[:, :, None]
    return control + section.middle, 1.0 / max(share, np.finfo(float).eps)


def _layers_last(values: Floats) -> Floats:
    """Values (l, k, 2) as rows (k, 2 l)."""
    return values.transpose(1, 0, 2).reshape(values.shape[1], -1)


def _mean(rows: scipy.sparse.csr_array) -> float:
    """Mean diagonal of the quadratic form of rows (k, n)."""
    return float(np.square(rows.data).sum() / rows.shape[1])


def fit_section(curves: Floats, grasp: Recovery | None, settings: SectionSettings) -> Section:
    """Section of a prism for layers of closed curves (l, k, 2) [m], of which some may be points.

    Curves are counter-clockwise, at even turns. A superquadric, the `grasp`, gives its second
    exponent, semi-axes, turn about the vertical and place. Layers are aligned by their first
    harmonics, which hold the place, size and turn of a closed curve, and averaged.
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
        return _resembling(mean * usual * turn, middle, settings)
    return _grasped(mean * usual * turn, grasp, settings)


def _resembling(mean: Complexes, middle: complex, settings: SectionSettings) -> Section:
    """The superellipse nearest to a curve about a place."""
    exponents, n_directions = settings.exponents, settings.n_directions
    circle = np.exp(2j * np.pi * np.arange(len(mean)) / len(mean))
    forwards, backwards = complex((mean / circle).mean()), complex((mean * circle).mean())
    round_ = abs(backwards) <= settings.min_harmonic_ratio * abs(forwards)
    own = 0.0 if round_ else 0.5 * float(np.angle(forwards * backwards))
    angles = np.concatenate([[own], 0.5 * np.pi * np.arange(n_directions) / n_directions])
    boxes = [_boxed(mean, float(angle), settings.min_aspect) for angle in angles]
    misfits = np.empty((len(angles), len(exponents)))  # from the superellipse of each exponent
    for row, (places, half, _) in enumerate(boxes):
        azimuth, radius = np.angle(places), np.abs(places)
        off = [radius - np.abs(rim_of(exponent, azimuth)[0]) for exponent in exponents]
        misfits[row] = np.sqrt(half[0] * half[1] * np.square(off).mean(axis=1))
    of_ellipse = float(misfits[0, 0])
    best, column = map(int, np.unravel_index(misfits.argmin(), misfits.shape))
    if misfits[best, column] > settings.max_misfit_ratio * of_ellipse:
        best, column = 0, 0
    places, half, centre = boxes[best]
    angle, exponent = float(angles[best]), exponents[column]
    return _section(middle + centre, half, angle, exponent, places, settings)


def _boxed(mean: Complexes, angle: float, min_aspect: float) -> tuple[Complexes, Floats, complex]:
    """A curve in its upright box after a turn: places, half extents of the box, and its middle."""
    turned = mean * np.exp(-1j * angle)
    low = np.array([turned.real.min(), turned.imag.min()])
    high = np.array([turned.real.max(), turned.imag.max()])
    half = 0.5 * (high - low)
    half = np.maximum(half, max(min_aspect * float(half.max()), np.finfo(float).tiny))
    centre = 0.5 * complex(*(low + high))
    off = turned - centre
    return off.real / half[0] + 1j * off.imag / half[1], half, centre * np.exp(1j * angle)


def _grasped(mean: Complexes, grasp: Recovery, settings: SectionSettings) -> Section:
    """The section of a superquadric, with the azimuths of a curve about its own middle."""
    x, y, z, w = grasp.pose[3:]
    angle = float(np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z)))
    half = np.maximum(grasp.size[:2], settings.min_aspect * float(grasp.size[:2].max()))
    turned = mean * np.exp(-1j * angle)
    places = turned.real / half[0] + 1j * turned.imag / half[1]
    sharpest, roundest = min(settings.exponents), max(settings.exponents)
    exponent = float(np.clip(grasp.exponents[1], sharpest, roundest))
    middle = complex(grasp.pose[0], grasp.pose[1])
    return _section(middle, half, angle, exponent, places, settings)


def _section(
    middle: complex,
    half: Floats,
    angle: float,
    exponent: float,
    places: Complexes,
    settings: SectionSettings,
) -> Section:
    """The section, whose azimuths follow those of places (k,) at even turns in its box."""
    cos, sin = np.cos(angle), np.sin(angle)
    axes = half[:, None] * np.array([[cos, sin], [-sin, cos]])
    turns = np.arange(len(places)) / len(places)
    steps = np.angle(np.roll(places, -1) / np.where(places == 0.0, 1.0, places))
    azimuth = float(np.angle(places[0])) + np.concatenate([[0.0], np.cumsum(steps[:-1])])
    ahead = azimuth / (2.0 * np.pi) - turns
    if round(float(steps.sum()) / (2.0 * np.pi)) != 1:  # it does not run once around
        ahead = np.full(len(places), float(np.angle(places.mean() or 1.0)) / (2.0 * np.pi))
    basis = PeriodicBasis(min(settings.n_lead, max(len(places) // 2, 4)))
    lead = np.linalg.lstsq(basis.matrix(turns).toarray(), ahead, rcond=None)[0]
    fine = np.arange(4 * settings.n_lead) / (4 * settings.n_lead)
    slope = float((basis.matrix(fine, 1) @ lead).min())
    max_fall = 1.0 - settings.min_azimuth_speed
    if slope < -max_fall:
        lead = lead.mean() + max_fall / -slope * (lead - lead.mean())
    return Section(np.array([middle.real, middle.imag]), axes, exponent, lead)


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """A superellipse in the plane."""

    middle: Floats  # (2,) [m]
    axes: Floats  # rows are the semi-axes, (2, 2) [m]; the second counter-clockwise of the first
    exponent: float  # 1 is an ellipse, towards 0 it becomes a rectangle
    lead: Floats  # of the azimuth over the turn [turns]: coefficients of a closed spline, (k,)

    @property
    def half_extent(self) -> Floats:
        """Lengths of the semi-axes, (2,) [m]."""
        return np.asarray(np.linalg.norm(self.axes, axis=1))

    def frame(self, low: float, high: float) -> Parallelepiped:
        """The box around the prism over the section, from one height [m] to another."""
        edges = np.zeros((3, 3))
        edges[:2, :2], edges[2, 2] = 2.0 * self.axes, high - low
        return Parallelepiped(np.array([*(self.middle - self.axes.sum(axis=0)), low]), edges)

    def rim(self, turns: Floats, derivative: int = 0) -> Floats:
        """Places (n, 2) of the rim in the box, from 0 to 1, or a derivative by turn, up to 2."""
        basis = PeriodicBasis(len(self.lead))
        lead = [basis.matrix(turns, order) @ self.lead for order in range(derivative + 1)]
        around = rim_of(self.exponent, 2.0 * np.pi * (turns + lead[0]), derivative)
        places = around[derivative]
        if derivative:
            speed = 2.0 * np.pi * (1.0 + lead[1])
            places = places * speed**derivative
        if derivative == 2:
            places = places + around[1] * 2.0 * np.pi * lead[2]
        halves = np.column_stack([places.real, places.imag]) * 0.5
        return halves + (0.5 if derivative == 0 else 0.0)

    def inside(self, n_radii: int = 7, n_angles: int = 48) -> tuple[Floats, Floats]:
        """Places (n, 2) in the box, and their weights (n,) in an integral over its area."""
        nodes, weights = np.polynomial.legendre.leggauss(n_radii)
        shares = 0.5 * (nodes + 1.0)
        rim = rim_of(self.exponent, 2.0 * np.pi * (np.arange(n_angles) + 0.5) / n_angles)[0]
        places = (shares[:, None] * rim).ravel()
        area = 0.25 * np.pi * (weights * shares)[:, None] * np.square(np.abs(rim)) / n_angles
        return 0.5 + 0.5 * np.column_stack([places.real, places.imag]), area.ravel()


def rim_of(exponent: float, azimuth: Floats, derivatives: int = 0) -> list[Complexes]:
    """Superellipse of semi-axes 1 at azimuths (n,) [rad], as x + iy, with derivatives up to 2."""
    power = 2.0 / exponent
    c, s = np.cos(azimuth), np.sin(azimuth)
    a, b = np.abs(c), np.abs(s)
    gauge = a**power + b**power
    direction = np.exp(1j * azimuth)
    radius = gauge ** (-1.0 / power)
    rim = [radius * direction]
    if derivatives:
        first = power * (b ** (power - 1.0) * np.sign(s) * c - a ** (power - 1.0) * np.sign(c) * s)
        slope = -radius / gauge * first / power
        rim.append((slope + 1j * radius) * direction)
    if derivatives == 2:
        bend = (power - 1.0) * (a ** (power - 2.0) * s**2 + b ** (power - 2.0) * c**2) - gauge
        second = -radius / gauge * (bend - (1.0 / power + 1.0) * first**2 / (gauge * power))
        rim.append((second + 2j * slope - radius) * direction)
    return rim


def section_matrix(
    basis: Basis, places: Floats, orders: tuple[int, int] = (0, 0)
) -> scipy.sparse.csr_array:
    """Basis functions of a section at places (n, 2), or a derivative: sparse (n, side^2)."""
    width = basis.degree + 1
    s, t = (basis.nonzero(places[:, axis], orders[axis]) for axis in (0, 1))
    columns = s.columns()[:, :, None] * basis.count + t.columns()[:, None, :]
    values = s.values[orders[0]][:, :, None] * t.values[orders[1]][:, None, :]
    starts = np.arange(0, columns.size + 1, width**2)
    return scipy.sparse.csr_array(
        (values.ravel(), columns.ravel(), starts), shape=(len(places), basis.count**2)
    )
