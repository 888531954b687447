"""The side surface as a radial spline, fitted to every touched taxel.

The squared distance q from the axis is a tensor product of a spline along the height and a periodic
one around: squared, because q of an ellipsoid is a parabola with finite slope at the poles, where
the distance itself has an infinite one. Along the height spans are even, and halved towards both
ends, where the slope of q may be infinite as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import scipy

from palpate.core.arrays import Floats, Ints, probable_error_sigma
from palpate.core.rebuild.contours import ContactPoints, taxel_pitch
from palpate.core.rebuild.side.equations import (
    AxisCurve,
    SideEquations,
    SideSystem,
    side_equations,
    side_system,
    tensor_rows,
)
from palpate.core.splines import CUBIC, Basis, PeriodicBasis, bending_along

# Knots along the height, which archived sides have: even spans, and how often the first and the
# last of them are halved.
N_SPANS = 45
N_HALVINGS = 4
N_UNPENALISED = 6  # coefficients that do not bend: 2 along, 3 around


@dataclass(frozen=True, slots=True, kw_only=True)
class GapSettings:
    """What counts as a gap between the taxels of a side, and how it is bridged."""

    touched_distance: float = 1.0  # [taxel pitches] from a taxel, up to which a place is touched
    min_touched: float = 0.8  # fraction of a ring that must be touched for gaps on it to count
    min_radius: float = 3.5  # [taxel pitches] least radius of a gap, a circle without a taxel
    tension: float = 0.03  # strength of the penalty on slopes in gaps; larger, a flatter bridge


@dataclass(frozen=True, slots=True, kw_only=True)
class RadialSettings:
    """How the radial spline is fitted; tuned together on the shipped scenes.

    Strengths of bending are over the mean diagonal of the normal equations.
    """

    n_around: int = 96  # coefficients around; more follow finer features
    n_sectors: int = 24  # parts of a turn, in each of which a span is touched or not
    max_untouched: float = 0.1  # fraction of the sectors without a point in a touched span
    touched_bending: float = 1e-3  # strength of the penalty on bending along; larger is smoother
    # The same in untouched spans and beside them: so strong that a gap is bridged from points
    # farther off, not extrapolated from the last points before it.
    untouched_bending: float = 1e-2
    n_beside: int = 2  # spans on either side of an untouched one
    bending_around: float = 1e-2  # strength of the penalty on bending around
    # Power of a span's width by which its bending counts: a root that begins at an end bends each
    # half of a span more than the whole, and is not flattened.
    width_power: int = 3
    min_square: float = 1e-6  # least squared distance from the axis, over the squared median
    min_spare: float = 0.05  # least degrees of freedom that are left, over the number of points
    n_probes: int = 2  # random sign vectors by which degrees of freedom are estimated
    min_taxels: int = 12  # median of the touches' taxels, for gaps and shifts to be determined
    gaps: GapSettings = GapSettings()


DEFAULT_RADIAL = RadialSettings()


@dataclass(frozen=True, slots=True, kw_only=True)
class DetailSettings:
    """When a side has fewer coefficients around, which follow less noise."""

    n_few: int = 48  # coefficients around
    max_ratio: float = 0.85  # residual of `n_around` over that of few; above it, few suffice
    max_draft_ratio: float = 0.6  # the same of a draft
    max_draft_residual: float = 5e-5  # residual over the height, up to which a draft has few


@dataclass(frozen=True, slots=True, eq=False)
class Drift:
    """Error of a spline by common shifts of touches: only relative shifts are determined."""

    sigma: float  # standard deviation of a point of weight 1 beside the shifts [m]
    along: Floats  # half the system, from the shifts, (shifts, coefficients)
    factor: Floats  # lower Cholesky factor of the shifts' own system, (shifts, shifts)

    def variance(self, half: Floats) -> Floats:
        """Variance (n,) at places by their half of the system, (n, coefficients)."""
        seen = scipy.linalg.solve_triangular(
            self.factor, self.along @ half.T, lower=True, check_finite=False
        )
        return np.asarray(self.sigma**2 * np.square(seen).sum(axis=0))


@dataclass(frozen=True, eq=False)
class RadialSpline:
    """A fitted side surface."""

    axis_curve: AxisCurve  # axis from which distances are measured
    low: float  # height at which the spline begins [m]
    high: float  # height at which it ends [m]
    coefficients: Floats  # (along, around) [m^2]
    rows: SideEquations  # what it was fitted to
    system: SideSystem  # the system it solves
    stiffness: float  # factor of the strengths of bending
    tension: scipy.sparse.csr_array | None  # root of the penalty that bridges gaps
    settings: RadialSettings
    drift: Drift | None = None  # error by shifts of the touches, if they were estimated

    @property
    def around(self) -> int:
        """Number of coefficients around."""
        return int(self.coefficients.shape[1])

    def squared(self, heights: Floats, turns: Floats) -> Floats:
        """Squared distance from the axis on a grid, (heights, turns) [m^2]."""
        along = along_basis().matrix(self._local(heights))
        around = PeriodicBasis(self.around).matrix(turns)
        squared = (around @ (along @ self.coefficients).T).T
        return np.asarray(np.maximum(squared, self.min_square))

    @property
    def min_square(self) -> float:
        """Least squared distance from the axis [m^2]."""
        return self.settings.min_square * self.rows.middle**2

    def rings(self, heights: Floats, turns: Floats) -> Floats:
        """Places on a grid, (heights, turns, 2) [m]."""
        angle = 2.0 * np.pi * turns
        rim = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        radius = np.sqrt(self.squared(heights, turns))
        return np.asarray(self.axis_curve.at(heights)[:, None] + radius[..., None] * rim)

    @cached_property
    def misfits(self) -> Floats:
        """Distances (n,) of the points along their normals [m]."""
        return np.asarray(self.rows.target - self.rows.matrix @ self.coefficients.ravel())

    @cached_property
    def gaps(self) -> Gaps | None:
        """Circles without a point among points; None if there are none."""
        return _gaps(self)

    @cached_property
    def freedom(self) -> float:
        """Degrees of freedom spent, estimated with random signs (Hutchinson, 1989)."""
        probes = self.settings.n_probes
        signs = np.random.default_rng(0).choice([-1.0, 1.0], (probes, len(self.rows.target)))
        seen = self.rows.matrix.T @ signs.T
        return float(np.einsum("nk,nk->", seen, self.system.solve(seen)) / probes)

    @property
    def sigma(self) -> float:
        """Standard deviation of a point, from the median misfit and the freedom spent [m]."""
        return probable_error_sigma(self.misfits) / float(np.sqrt(self._spare))

    @property
    def score(self) -> float:
        """Twice the negative log likelihood (Wahba, *A comparison of GCV and GML*, 1985)."""
        rows, flat = self.rows, self.coefficients.ravel()
        square = rows.target @ self.misfits
        count, size = len(rows.target) - N_UNPENALISED, len(flat) - N_UNPENALISED
        bends = size * np.log(self.stiffness)
        determinant = float(2.0 * np.log(self.system.factor[0]).sum())  # its logarithm
        return float(count * np.log(square) + determinant - bends)

    def deviation(self, heights: Floats, turns: Floats) -> Floats:
        """Standard deviation of the surface across its rings on a grid, (heights, turns) [m].

        The posterior of the penalised fit (Wahba, *Bayesian confidence intervals*, 1983): of noise,
        penalty and drift of the shifts, not of features narrower than the knots.
        """
        along = along_basis().matrix(self._local(heights))
        rows = scipy.sparse.kron(along, PeriodicBasis(self.around).matrix(turns)).toarray()
        half = self.system.half(rows)
        variance = self.mean_square * np.einsum("nk,nk->n", half, half)
        if self.drift is not None:
            variance += self.drift.variance(half)
        # The distance grows by this with the squared distance's standard deviation; to first order
        # that is a division by twice the distance, which has no limit at the axis.
        squared = self.squared(heights, turns)
        more = np.sqrt(variance).reshape(squared.shape)
        return np.asarray(more / (np.sqrt(squared + more) + np.sqrt(squared)))

    def refitted(self, contacts: ContactPoints, stiffness: float = 1.0) -> RadialSpline:
        """A fit to other contact points, over the same heights and gaps."""
        where = self.axis_curve, self.low, self.high
        how = stiffness, self.tension, self.around
        return fit_radial_spline(contacts, *where, *how, self.settings)

    def stiffer(self, factor: float) -> RadialSpline:
        """A fit to the same contact points, stiffer by a factor."""
        stiffness, settings = factor * self.stiffness, self.settings
        system, coefficients = _solved(self.rows, self.around, stiffness, self.tension, settings)
        where = self.axis_curve, self.low, self.high
        how = stiffness, self.tension, settings
        return RadialSpline(*where, coefficients, self.rows, system, *how)

    @property
    def mean_square(self) -> float:
        """Mean squared misfit of a point over its share of the freedom left [m^2]."""
        return float(np.mean(self.misfits**2)) / self._spare

    @property
    def _spare(self) -> float:
        return max(1.0 - self.freedom / len(self.rows.target), self.settings.min_spare)

    def _local(self, heights: Floats) -> Floats:
        return np.clip((heights - self.low) / (self.high - self.low), 0.0, 1.0)


def fit_radial_spline(
    contacts: ContactPoints,
    axis_curve: AxisCurve,
    low: float,
    high: float,
    stiffness: float = 1.0,
    tension: scipy.sparse.csr_array | None = None,
    around: int | None = None,
    settings: RadialSettings = DEFAULT_RADIAL,
) -> RadialSpline:
    """Fit the side surface between two heights [m] to contact points with normals.

    Points beyond the heights, or on level faces, are left out. `stiffness` is a factor of the
    bending, 1 without noise; for `tension` see `with_gaps_bridged`; `around` is the number of
    coefficients around, that of the settings if left out. Raises ValueError if no point is left.
    """
    basis = PeriodicBasis(around or settings.n_around)
    rows = side_equations(contacts, axis_curve, low, high, along_basis(), basis)
    system, coefficients = _solved(rows, basis.count, stiffness, tension, settings)
    how = stiffness, tension, settings
    return RadialSpline(axis_curve, low, high, coefficients, rows, system, *how)


def fit_side_spline(
    contacts: ContactPoints,
    axis_curve: AxisCurve,
    low: float,
    high: float,
    draft: bool = False,
    settings: DetailSettings = DetailSettings(),
) -> RadialSpline:
    """As `fit_radial_spline`, with few coefficients around where they fit about as well."""
    few = fit_radial_spline(contacts, axis_curve, low, high, around=settings.n_few)
    residual = float(np.sqrt(np.mean(few.misfits**2)))
    if draft and residual <= settings.max_draft_residual * (high - low):
        return few
    whole = fit_radial_spline(contacts, axis_curve, low, high)
    ratio = settings.max_draft_ratio if draft else settings.max_ratio
    return whole if float(np.sqrt(np.mean(whole.misfits**2))) < ratio * residual else few


def _solved(
    rows: SideEquations,
    around: int,
    stiffness: float,
    tension: scipy.sparse.csr_array | None,
    settings: RadialSettings,
) -> tuple[SideSystem, Floats]:
    """The penalised system of the equations, and its coefficients (along, around)."""
    sectors = settings.n_sectors
    span = np.minimum((rows.places[:, 0] * N_SPANS).astype(int), N_SPANS - 1)
    sector = (np.mod(rows.places[:, 1], 1.0) * sectors).astype(int) % sectors
    touched = np.zeros((N_SPANS, sectors), np.bool_)
    touched[span, sector] = True
    untouched = np.mean(~touched, axis=1) > settings.max_untouched
    near = np.convolve(untouched, np.ones(2 * settings.n_beside + 1), mode="same") > 0.5
    strengths = np.where(near, settings.untouched_bending, settings.touched_bending)[even_spans()]
    bending = stiffness * strengths, bending_root(settings.width_power)
    system = side_system(rows.normal, around, bending, stiffness * settings.bending_around, tension)
    return system, system.solve(rows.matrix.T @ rows.target).reshape(-1, around)


def with_gaps_bridged(contacts: ContactPoints, spline: RadialSpline) -> RadialSpline:
    """The spline, stretched over gaps like a skin: by tension from all their borders.

    Bending alone extrapolates the slopes of the touches beside a gap, to the axis and beyond.
    """
    heights = spline.low + (spline.high - spline.low) * along_basis().greville()
    gaps = gap_widths(spline, heights, PeriodicBasis(spline.around).greville()) > 0.0
    if not gaps.any():
        return spline
    numbers = np.arange(gaps.size).reshape(gaps.shape)
    beside = np.stack([numbers, np.roll(numbers, -1, axis=1)], axis=-1)
    above = np.stack([numbers[:-1], numbers[1:]], axis=-1)
    pairs = np.concatenate([beside.reshape(-1, 2), above.reshape(-1, 2)])
    pairs = pairs[gaps.ravel()[pairs].any(axis=1)]
    root = np.sqrt(spline.settings.gaps.tension)
    values = np.broadcast_to(root * np.array([-1.0, 1.0]), pairs.shape)
    pointers = np.arange(0, pairs.size + 1, 2)
    tension = scipy.sparse.csr_array(
        (values.ravel(), pairs.ravel(), pointers), shape=(len(pairs), gaps.size)
    )
    return replace(spline, tension=tension).refitted(contacts, spline.stiffness)


def gap_widths(spline: RadialSpline, heights: Floats, turns: Floats) -> Floats:
    """Widths of gaps on a grid (heights, turns), twice the distance to a taxel [m]; 0 beside gaps.

    A feature that hides there may be as deep as it is wide. A gap is a wide circle without a taxel
    about a place on a ring that was mostly touched: between rings the spline is interpolated.
    """
    gaps = spline.gaps
    if gaps is None:
        return np.zeros((len(heights), len(turns)))
    pairs = np.repeat(heights, len(turns)), np.tile(turns, len(heights))
    places = _on_rings(gaps.heights, gaps.widths, *pairs)
    inside = (scipy.spatial.distance.cdist(places, gaps.centres) < gaps.radii).any(axis=1)
    widths = 2.0 * np.asarray(gaps.taxels.query(places)[0])
    return np.where(inside, widths, 0.0).reshape(len(heights), len(turns))


@dataclass(frozen=True, slots=True, eq=False)
class Gaps:
    """Circles without a taxel, on rings of a spline's median radii: the spline may plunge there."""

    heights: Floats  # of the rings, rising, (r,) [m]
    widths: Floats  # radii of the rings, (r,) [m]
    taxels: scipy.spatial.cKDTree  # their places on the rings
    centres: Floats  # of the circles, (k, 3) [m]
    radii: Floats  # of the circles, (k,) [m]


def _on_rings(rings: Floats, radii: Floats, heights: Floats, turns: Floats) -> Floats:
    """Places (n, 3) on rings of some radii [m], at heights [m] and turns (n,)."""
    radius, angle = np.interp(heights, rings, radii), 2.0 * np.pi * turns
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), heights])


def _gaps(spline: RadialSpline) -> Gaps | None:
    """Gaps between the taxels of a spline; None if there are none, or too few taxels."""
    rows, settings = spline.rows, spline.settings.gaps
    if np.median(np.bincount(rows.touch)) < spline.settings.min_taxels:
        return None
    rings = np.linspace(spline.low, spline.high, 2 * N_SPANS)
    around = np.arange(spline.around) / spline.around
    medians = np.sqrt(np.median(spline.squared(rings, around), axis=1))
    taxels = _on_rings(rings, medians, rows.heights, rows.places[:, 1])
    pitch = taxel_pitch(ContactPoints(taxels, None, rows.touch))
    tree = scipy.spatial.cKDTree(taxels)
    turns = np.tile(around, len(rings))
    centres = _on_rings(rings, medians, np.repeat(rings, len(around)), turns)
    radii = np.asarray(tree.query(centres)[0])
    is_touched = radii.reshape(len(rings), -1) < settings.touched_distance * pitch
    mostly = np.mean(is_touched, axis=1) > settings.min_touched
    wide = (radii > settings.min_radius * pitch) & np.repeat(mostly, len(around))
    return Gaps(rings, medians, tree, centres[wide], radii[wide]) if wide.any() else None


@lru_cache(maxsize=1)
def even_spans() -> Ints:
    """Number (spans,) of the even span of which each span is a part."""
    breaks = np.unique(along_basis().knots)
    middles = 0.5 * (breaks[1:] + breaks[:-1])
    return np.asarray((middles * N_SPANS).astype(np.int32))


@lru_cache(maxsize=1)
def bending_root(width_power: int) -> Floats:
    """Root (r, count) of the bending along, weighted by a power of the spans' widths."""
    basis = along_basis()
    widths = np.diff(np.unique(basis.knots))
    root = bending_along(basis)
    weights = (widths * N_SPANS) ** (0.5 * width_power)
    weighted: Floats = np.repeat(weights, len(root) // len(weights))[:, None] * root
    weighted.setflags(write=False)
    return weighted


def with_normals(
    contacts: ContactPoints, axis_curve: AxisCurve, low: float, high: float
) -> ContactPoints:
    """Contact points with normals: if not measured, those of a fit with radial normals."""
    if contacts.normals is not None:
        return contacts
    away = contacts.points[:, :2] - axis_curve.at(contacts.points[:, 2])
    length = np.maximum(np.linalg.norm(away, axis=1, keepdims=True), np.finfo(float).tiny)
    level = np.concatenate([away / length, np.zeros((len(away), 1))], axis=1)
    first = fit_radial_spline(contacts._replace(normals=level), axis_curve, low, high)
    return contacts._replace(normals=_gradient_normals(first, contacts.points))


def _gradient_normals(spline: RadialSpline, points: Floats) -> Floats:
    """Outward unit normals (n, 3) of a spline at points next to it."""
    away = points[:, :2] - spline.axis_curve.at(points[:, 2])
    turns = np.arctan2(away[:, 1], away[:, 0]) / (2.0 * np.pi)
    local = spline._local(points[:, 2])
    flat = spline.coefficients.ravel()
    along, around = along_basis(), PeriodicBasis(spline.around)
    extent = spline.high - spline.low
    by_height = tensor_rows(along.matrix(local, 1), around.matrix(turns)) @ flat / extent
    by_turn = tensor_rows(along.matrix(local), around.matrix(turns, 1)) @ flat / (2.0 * np.pi)
    distance = np.maximum(np.linalg.norm(away, axis=1), np.finfo(float).tiny)[:, None]
    out = away / distance
    beside = np.stack([-out[:, 1], out[:, 0]], axis=-1)
    level = 2.0 * distance * out - by_turn[:, None] / distance * beside
    leaning = np.einsum("ni,ni->n", away, spline.axis_curve.at(points[:, 2], 1))
    gradient = np.column_stack([level, -2.0 * leaning - by_height])
    return np.asarray(gradient / np.linalg.norm(gradient, axis=1, keepdims=True))


@lru_cache(maxsize=1)
def along_basis() -> Basis:
    """Splines along the height, from 0 to 1."""
    even = np.linspace(0.0, 1.0, N_SPANS + 1)
    nearer = even[1] * 0.5 ** np.arange(N_HALVINGS, 0, -1)
    breaks = np.concatenate([even[:1], nearer, even[1:-1], 1.0 - nearer[::-1], even[-1:]])
    return Basis(np.concatenate([np.zeros(CUBIC), breaks, np.ones(CUBIC)]), CUBIC)
