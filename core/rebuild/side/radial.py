"""The side surface as a radial spline, fitted to every touched taxel.

The squared distance q from the axis is a tensor product of a spline along the height and a periodic
one around: squared, because q of an ellipsoid is a parabola with finite slope at the poles, where
the distance itself rises with an infinite one. Along the height spans are even and halved towards
both ends, where q too may rise with an infinite slope.

A pose that is believed a tenth of a millimetre off moves a whole patch. Neighbouring patches
overlap, so that the surface and one small shift of each touch can be found in one system: least
squares with a block of correlated errors for each touch. How large shifts are believed to be is
told by themselves, and how surely by what the surface leaves of the taxels: without noise, or where
the surface does not follow edges, the one falls and the other rises until no shift is left.
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
from palpate.core.steps import Steps, no_steps

# Of the touches' pose error: what it leaves at least where the side turns level, and in ends.
POSE_LEFT = 0.4
FEWEST_TAXELS = 12  # Taxels of a touch: of fewer in half of them, they tell no shifts and no gaps
SECTORS = 24  # Parts of a turn, each of which is looked at by itself
AROUND, FEW_AROUND = 96, 48  # Coefficients around, and of a side that has no need of them
# Where all coefficients would leave less than this share of what few of them miss, a side has them
# all, and a draft: more of them follow noise. A draft may miss a share of the height anyhow.
LESS, FAR_LESS, DRAFT_MISSES = 0.85, 0.6, 5e-5
# Strength of bending along, where the side was touched all around and where it was not: there so
# strong that what lies farther off bridges the gap, not the last points before it alone.
TOUCHED, UNTOUCHED = 1e-3, 1e-2
BESIDE = 2  # Spans on either side of one that was not touched for which the same holds
# Of gaps, in pitches of the taxels: how near to one a place was touched, and the radius of a circle
# without one from which on it is a gap; and the share of a ring that must be touched for it.
NEAR, WIDE, MOSTLY = 1.0, 3.5, 0.8
TENSION = 0.03  # Strength with which gaps are bridged
HOLES = 0.1  # Share of them that may be without a point in a span that was touched
BENDING_AROUND = 1e-2  # Strength of bending around
LEAST = 1e-6  # Smallest squared distance ever given, over that of the median
UNBENT = 6  # Coefficients' combinations that do not bend
PROBES = 2  # Random signs by which the freedom is estimated
LEAST_SPARE = 0.05  # Least share of the points' freedom that is taken as left
SPANS = 45  # Even spans
HALVED = 4  # Times that the first and the last of them are halved
# Power of a span's width by which its bending counts: a root that begins there bends each half of a
# span more than the whole, and is not flattened.
WIDTHS = 3
# Of the shifts of touches.
SWEEPS = 3  # Fits, each about the points as the shifts before have moved them
# How many taxels weigh as much as the belief that a touch is not shifted: at first, and as many
# times their squared misfit over that of the poses. By their own noise alone each would count by
# itself; but what a smooth surface leaves, neighbours share.
STRICTNESS, TOGETHER = 0.1, 8.0
# Of the height: less noise, or smaller shifts, are not looked into; nothing is smoothed for them.
WORTHWHILE = 6e-5
FEWEST_TOUCHES = 8  # Fewer tell no shifts
ITERATIONS, ENOUGH = 35, 1e-3  # Of the conjugate gradients, and the residual at which they end
STIFFER, MOST_STIFFER = 10.0, 5  # Steps of stiffness where there is noise, and their number
MOST_WHOLE = 400  # Touches whose drift is told in all directions; of more, along their normals


@dataclass(frozen=True, slots=True, eq=False)
class Drift:
    """What the shifts of touches, known against each other alone, leave in a spline."""

    sigma: float  # Deviation of a point that counts as one beside the shifts, m
    along: Floats  # Half the system, from the shifts (shifts, coefficients)
    factor: Floats  # Cholesky factor of the shifts' own system (shifts, shifts), lower

    def variance(self, half: Floats) -> Floats:
        """Of the places whose half of the system is given, (n, coefficients): (n,)."""
        seen = scipy.linalg.solve_triangular(
            self.factor, self.along @ half.T, lower=True, check_finite=False
        )
        return np.asarray(self.sigma**2 * np.square(seen).sum(axis=0))


@dataclass(frozen=True, eq=False)
class RadialSpline:
    """A fitted side surface."""

    axis_curve: AxisCurve  # Axis from which distances are taken
    low: float  # Height at which the spline begins, m
    high: float  # Height at which it ends, m
    coefficients: Floats  # (along, around), m^2
    middle: float  # Median distance of the points from the axis, m
    rows: SideEquations  # What it was fitted to
    system: SideSystem  # The system it solves
    stiffness: float  # Times the strengths of bending
    tension: scipy.sparse.csr_array | None = None  # Root of what bridges gaps, if there are any
    drift: Drift | None = None  # What shifts of the touches leave in it, if they were estimated

    @property
    def around(self) -> int:
        """Coefficients around."""
        return int(self.coefficients.shape[1])

    def squared(self, heights: Floats, turns: Floats) -> Floats:
        """Squared distance from the axis on a grid, (heights, turns), m^2."""
        along = along_basis().matrix(self._local(heights))
        around = PeriodicBasis(self.around).matrix(turns)
        squared = (around @ (along @ self.coefficients).T).T
        return np.asarray(np.maximum(squared, LEAST * self.middle**2))

    def rings(self, heights: Floats, turns: Floats) -> Floats:
        """Places on a grid, (heights, turns, 2), m."""
        angle = 2.0 * np.pi * turns
        rim = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        radius = np.sqrt(self.squared(heights, turns))
        return np.asarray(self.axis_curve.at(heights)[:, None] + radius[..., None] * rim)

    @cached_property
    def misfits(self) -> Floats:
        """Distances (n,) of the points along their normals, m."""
        return np.asarray(self.rows.target - self.rows.matrix @ self.coefficients.ravel())

    @cached_property
    def gaps(self) -> Gaps | None:
        """Where none of the points lies, though points lie around; None if there is no such."""
        return _gaps(self)

    @cached_property
    def freedom(self) -> float:
        """Degrees of freedom spent, estimated with random signs (Hutchinson, 1989)."""
        signs = np.random.default_rng(0).choice([-1.0, 1.0], (PROBES, len(self.rows.target)))
        seen = self.rows.matrix.T @ signs.T
        return float(np.einsum("nk,nk->", seen, self.system.solve(seen)) / PROBES)

    @property
    def sigma(self) -> float:
        """Standard deviation of a point, from the median misfit and the freedom spent, m."""
        return probable_error_sigma(self.misfits) / float(np.sqrt(self._spare))

    @property
    def score(self) -> float:
        """Twice the negative log likelihood (Wahba, *A comparison of GCV and GML*, 1985)."""
        rows, flat = self.rows, self.coefficients.ravel()
        square = rows.target @ self.misfits
        count, size = len(rows.target) - UNBENT, len(flat) - UNBENT
        bends = size * np.log(self.stiffness)
        determinant = float(2.0 * np.log(self.system.factor[0]).sum())  # its logarithm
        return float(count * np.log(square) + determinant - bends)

    def deviation(self, heights: Floats, turns: Floats) -> Floats:
        """Standard deviation of the surface across its rings on a grid, (heights, turns), m.

        The posterior of the penalised fit (Wahba, *Bayesian confidence intervals*, 1983): noise,
        what the penalty lets move and the drift of shifts, not features narrower than the knots.
        """
        along = along_basis().matrix(self._local(heights))
        rows = scipy.sparse.kron(along, PeriodicBasis(self.around).matrix(turns)).toarray()
        half = self.system.half(rows)
        variance = self.square * np.einsum("nk,nk->n", half, half)
        if self.drift is not None:
            variance += self.drift.variance(half)
        # What one standard deviation more of the squared distance adds: spread over twice the
        # distance, but finite where the surface runs through the axis.
        squared = self.squared(heights, turns)
        more = np.sqrt(variance).reshape(squared.shape)
        return np.asarray(more / (np.sqrt(squared + more) + np.sqrt(squared)))

    def refitted(self, contacts: ContactPoints, stiffness: float = 1.0) -> RadialSpline:
        """To other contact points, over the same heights and gaps."""
        where = self.axis_curve, self.low, self.high
        return fit_radial_spline(contacts, *where, stiffness, self.tension, self.around)

    def stiffer(self, times: float) -> RadialSpline:
        """To the same contact points, so many times stiffer."""
        system, found = _solved(self.rows, self.around, times * self.stiffness, self.tension)
        return RadialSpline(
            *(self.axis_curve, self.low, self.high, found, self.middle, self.rows, system),
            *(times * self.stiffness, self.tension),
        )

    @property
    def square(self) -> float:
        """Mean squared misfit of a point, with the freedom spent counted out, m^2."""
        return float(np.mean(self.misfits**2)) / self._spare

    @property
    def _spare(self) -> float:
        return max(1.0 - self.freedom / len(self.rows.target), LEAST_SPARE)

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
) -> RadialSpline:
    """Fit the side surface between two heights, m, to contact points with normals.

    Those outside the heights, or on level faces, are left out. `stiffness` is how much more bending
    costs than it does without noise; `tension` see `bridged`; `around` are the coefficients around,
    96 if left out. Raises ValueError if no point is left.
    """
    basis = PeriodicBasis(around or AROUND)
    rows = side_equations(contacts, axis_curve, low, high, along_basis(), basis)
    system, found = _solved(rows, basis.count, stiffness, tension)
    return RadialSpline(axis_curve, low, high, found, rows.middle, rows, system, stiffness, tension)


def fit_side_spline(
    contacts: ContactPoints, axis_curve: AxisCurve, low: float, high: float, draft: bool = False
) -> RadialSpline:
    """The same with half as many coefficients around, where these do about as well."""
    few = fit_radial_spline(contacts, axis_curve, low, high, around=FEW_AROUND)
    missed = float(np.sqrt(np.mean(few.misfits**2)))
    if draft and missed <= DRAFT_MISSES * (high - low):
        return few
    whole = fit_radial_spline(contacts, axis_curve, low, high)
    left = float(np.sqrt(np.mean(whole.misfits**2)))
    return whole if left < (FAR_LESS if draft else LESS) * missed else few


def _solved(
    rows: SideEquations, around: int, stiffness: float, tension: scipy.sparse.csr_array | None
) -> tuple[SideSystem, Floats]:
    """The system of the equations, and its coefficients (along, around)."""
    # Stronger bending along in spans where nothing was touched, and beside them.
    span = np.minimum((rows.places[:, 0] * SPANS).astype(int), SPANS - 1)
    sector = (np.mod(rows.places[:, 1], 1.0) * SECTORS).astype(int) % SECTORS
    touched = np.zeros((SPANS, SECTORS), np.bool_)
    touched[span, sector] = True
    untouched = np.mean(~touched, axis=1) > HOLES
    near = np.convolve(untouched, np.ones(2 * BESIDE + 1), mode="same") > 0.5
    strengths = np.where(near, UNTOUCHED, TOUCHED)[even_spans()]
    bending = stiffness * strengths, bending_root()
    system = side_system(rows.normal, around, bending, stiffness * BENDING_AROUND, tension)
    return system, system.solve(rows.matrix.T @ rows.target).reshape(-1, around)


def bridged(contacts: ContactPoints, spline: RadialSpline) -> RadialSpline:
    """The spline, drawn over gaps as a skin is: from all their borders, not on from any slope.

    What the touches beside a gap slope to would else be carried on, to the axis and beyond.
    """
    heights = spline.low + (spline.high - spline.low) * along_basis().greville()
    gaps = gap_widths(spline, heights, PeriodicBasis(spline.around).greville()) > 0.0
    if not gaps.any():
        return spline
    numbers = np.arange(gaps.size).reshape(gaps.shape)
    beside = numbers, np.roll(numbers, -1, axis=1)
    above = numbers[:-1], numbers[1:]
    pairs = np.concatenate([np.stack(each, axis=-1).reshape(-1, 2) for each in (beside, above)])
    pairs = pairs[gaps.ravel()[pairs].any(axis=1)]
    values = np.broadcast_to(np.sqrt(TENSION) * np.array([-1.0, 1.0]), pairs.shape)
    pointers = np.arange(0, pairs.size + 1, 2)
    tension = scipy.sparse.csr_array(
        (values.ravel(), pairs.ravel(), pointers), shape=(len(pairs), gaps.size)
    )
    return replace(spline, tension=tension).refitted(contacts, spline.stiffness)


def gap_widths(spline: RadialSpline, heights: Floats, turns: Floats) -> Floats:
    """How wide gaps are at places on a grid: twice the way to a taxel, (heights, turns), m.

    What hides there may be as deep as it is wide. A gap is a circle without a taxel, wide enough,
    about a place in a ring of which most was touched: between rings curves tell. 0 beside gaps.
    """
    nowhere = np.zeros((len(heights), len(turns)))
    gaps = spline.gaps
    if gaps is None:
        return nowhere
    pairs = np.repeat(heights, len(turns)), np.tile(turns, len(heights))
    places = _on_rings(gaps.heights, gaps.widths, *pairs)
    inside = (scipy.spatial.distance.cdist(places, gaps.centres) < gaps.radii).any(axis=1)
    widths = 2.0 * np.asarray(gaps.taxels.query(places)[0])
    return np.where(inside, widths, 0.0).reshape(nowhere.shape)


@dataclass(frozen=True, slots=True, eq=False)
class Gaps:
    """Circles without a taxel, on rings as wide as a spline's are on average: these may plunge."""

    heights: Floats  # Of the rings, rising, (r,), m
    widths: Floats  # Radii of the rings, (r,), m
    taxels: scipy.spatial.cKDTree  # Where taxels lie on them
    centres: Floats  # Of the circles, (k, 3), m
    radii: Floats  # Of the circles, (k,), m


def _on_rings(rings: Floats, radii: Floats, heights: Floats, turns: Floats) -> Floats:
    """Places (n, 3) on rings of some radii, m, at heights, m, and turns (n,)."""
    radius, angle = np.interp(heights, rings, radii), 2.0 * np.pi * turns
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), heights])


def _gaps(spline: RadialSpline) -> Gaps | None:
    """The gaps between the taxels of a spline; None if there are none, or too few taxels."""
    rows = spline.rows
    if np.median(np.bincount(rows.touch)) < FEWEST_TAXELS:
        return None
    rings = np.linspace(spline.low, spline.high, 2 * SPANS)
    around = np.arange(spline.around) / spline.around
    middles = np.sqrt(np.median(spline.squared(rings, around), axis=1))
    taxels = _on_rings(rings, middles, rows.heights, rows.places[:, 1])
    pitch, tree = (
        taxel_pitch(ContactPoints(taxels, None, rows.touch)),
        scipy.spatial.cKDTree(taxels),
    )
    turns = np.tile(around, len(rings))
    centres = _on_rings(rings, middles, np.repeat(rings, len(around)), turns)
    radii = np.asarray(tree.query(centres)[0])
    touched = np.mean(radii.reshape(len(rings), -1) < NEAR * pitch, axis=1) > MOSTLY
    wide = (radii > WIDE * pitch) & np.repeat(touched, len(around))
    return Gaps(rings, middles, tree, centres[wide], radii[wide]) if wide.any() else None


@lru_cache(maxsize=1)
def even_spans() -> Ints:
    """The even span (spans,) of which each span is a part."""
    breaks = np.unique(along_basis().knots)
    middles = 0.5 * (breaks[1:] + breaks[:-1])
    return np.asarray((middles * SPANS).astype(np.int32))


@lru_cache(maxsize=1)
def bending_root() -> Floats:
    """Root (r, count) of the bending along: that of `bending_along`, the widths counted out."""
    basis = along_basis()
    widths = np.diff(np.unique(basis.knots))
    root = bending_along(basis)
    weights = (widths * SPANS) ** (0.5 * WIDTHS)
    weighted: Floats = np.repeat(weights, len(root) // len(weights))[:, None] * root
    weighted.setflags(write=False)
    return weighted


def with_normals(
    contacts: ContactPoints, axis_curve: AxisCurve, low: float, high: float
) -> ContactPoints:
    """Contact points with normals: unless measured, those of a fit that takes them to be radial."""
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
    """The basis over 0 to 1."""
    even = np.linspace(0.0, 1.0, SPANS + 1)
    nearer = even[1] * 0.5 ** np.arange(HALVED, 0, -1)
    breaks = np.concatenate([even[:1], nearer, even[1:-1], 1.0 - nearer[::-1], even[-1:]])
    return Basis(np.concatenate([np.zeros(CUBIC), breaks, np.ones(CUBIC)]), CUBIC)


def fit_shifted_spline(
    contacts: ContactPoints, plain: RadialSpline, step: Steps = no_steps
) -> tuple[RadialSpline, float | None]:
    """The plain spline's contacts fitted again with a shift of each touch.

    And the poses' standard deviation along the normals, from the median shift, m; None without.
    """
    used = np.unique(plain.rows.touch, return_counts=True)[1]
    least = WORTHWHILE * (plain.high - plain.low)
    if not plain.sigma > least:
        return plain, None
    few = len(used) < FEWEST_TOUCHES or np.median(used) < FEWEST_TAXELS
    shifts = np.zeros((int(contacts.touch.max()) + 1, 3))
    spline, moved, strictness, pose = plain, contacts, STRICTNESS, 0.0
    for _ in range(0 if few else SWEEPS):
        shifts += _more_shifts(spline, shifts, strictness)
        moved = contacts._replace(points=contacts.points - shifts[contacts.touch])
        spline = plain.refitted(moved)
        by_row = shifts[spline.rows.touch]
        pose = probable_error_sigma(np.einsum("ni,ni->n", spline.rows.normals, by_row))
        if not pose > least:
            break
        strictness = TOGETHER * spline.square / pose**2
    with step("cross-validation"):
        if not pose > least:
            return stiffened(plain), None
        spline = stiffened(spline)
    return replace(spline, drift=_drift(spline, len(shifts), strictness, pose)), pose


def stiffened(spline: RadialSpline) -> RadialSpline:
    """The spline as stiff as its points ask for: at least as stiff as it is."""
    for _ in range(MOST_STIFFER):
        stiffer = spline.stiffer(STIFFER)
        if not stiffer.score < spline.score:
            break
        spline = stiffer
    return spline


def _more_shifts(spline: RadialSpline, believed: Floats, strictness: float) -> Floats:
    """Shifts (k, 3) on top of those believed, whose points have been moved back by them."""
    rows, count = spline.rows, len(believed)
    blocks = _blocks(spline, np.broadcast_to(np.eye(3), (count, 3, 3)))
    own = np.zeros((count, 3, 3))  # Each touch's block of the system
    np.add.at(own, rows.touch, rows.normals[:, :, None] * rows.normals[:, None, :])
    own += strictness * np.eye(3)
    inverse = np.linalg.inv(own)
    # What a shift does to the surface's equations, summed over its taxels once.
    told = scipy.sparse.csr_array(blocks.T @ rows.matrix)
    told_by = scipy.sparse.csr_array(told.T)

    def system(shifts: Floats) -> Floats:
        smooth = told @ spline.system.solve(told_by @ shifts.ravel())
        return np.asarray(np.einsum("kij,kj->ki", own, shifts) - smooth.reshape(-1, 3))

    right = (blocks.T @ spline.misfits).reshape(-1, 3) - strictness * believed
    found = np.zeros_like(right)
    rest = right
    ahead = direction = np.einsum("kij,kj->ki", inverse, rest)
    size = start = float(np.vdot(rest, ahead))
    for _ in range(ITERATIONS):
        if not size > ENOUGH**2 * start:
            break
        image = system(direction)
        step = size / float(np.vdot(direction, image))
        found, rest = found + step * direction, rest - step * image
        ahead = np.einsum("kij,kj->ki", inverse, rest)
        size, before = float(np.vdot(rest, ahead)), size
        direction = ahead + size / before * direction
    return found


def _blocks(spline: RadialSpline, directions: Floats) -> scipy.sparse.csr_array:
    """From shifts (k d,) along directions (k, d, 3) of the touches to distances along normals."""
    rows, (count, each) = spline.rows, directions.shape[:2]
    along = np.einsum("ndi,ni->nd", directions[rows.touch], rows.normals)
    columns = (each * rows.touch[:, None] + np.arange(each)).ravel()
    pointers = each * np.arange(len(rows.touch) + 1)
    return scipy.sparse.csr_array(
        (along.ravel(), columns, pointers), shape=(len(along), each * count)
    )


def _drift(spline: RadialSpline, count: int, strictness: float, pose: float) -> Drift:
    """Of the shifts of so many touches, of a deviation in m, by the Schur complement."""
    rows = spline.rows
    directions = np.broadcast_to(np.eye(3), (count, 3, 3))
    if count > MOST_WHOLE:
        means = np.zeros((count, 3))
        np.add.at(means, rows.touch, rows.normals)
        length = np.linalg.norm(means, axis=1, keepdims=True)
        directions = (means / np.maximum(length, np.finfo(float).tiny))[:, None]
    blocks = _blocks(spline, directions)
    along = spline.system.half((blocks.T @ rows.matrix).toarray())
    own = (blocks.T @ blocks).toarray() + strictness * np.eye(blocks.shape[1])
    factor = scipy.linalg.cholesky(own - along @ along.T, lower=True, check_finite=False)
    return Drift(float(np.sqrt(strictness)) * pose, along, np.asarray(factor))
