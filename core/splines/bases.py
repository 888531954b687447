"""B-spline bases on an interval or around a circle, and their tensor products.

A basis of `count` functions of degree p has ``count + p + 1`` knots; its functions sum to 1 on the
domain, from knot p to knot `count`. Values come from the triangular scheme of Cox and de Boor,
which divides only by distances of knots on either side of the place, so that repeated knots never
give 0/0. Not scipy's: it gives no derivatives in matrix form. Tensor products are evaluated by
scipy's NdBSpline at scattered places, and axis by axis on grids.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.reprs import readable

if TYPE_CHECKING:
    from scipy.sparse import csr_array

ROUNDING = 64 * float(np.finfo(float).eps)  # relative; places outside by less are clipped
CUBIC = 3
MAX_CACHED_PLACES = 256  # evaluations at more places are not cached
Orders = tuple[int, ...]  # order of the derivative along each axis


@readable
@dataclass(frozen=True, slots=True, eq=False)
class Basis:
    """The B-splines of a knot vector.

    `knots` (count + degree + 1,): not falling; a knot may occur up to ``degree + 1`` times.
    `degree`: at least 1. Raises ValueError if the knots are otherwise, or leave no domain.
    """

    knots: Floats
    degree: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "knots", check_knots(self.knots, self.degree))

    @property
    def count(self) -> int:
        """Number of functions and of coefficients."""
        return len(self.knots) - self.degree - 1

    @property
    def domain(self) -> tuple[float, float]:
        """Interval on which the functions sum to 1."""
        return float(self.knots[self.degree]), float(self.knots[self.count])

    def greville(self) -> Floats:
        """Greville abscissae (count,): coefficients that reproduce the identity."""
        return _averages(self.knots[1:-1], self.degree)

    def breaks(self) -> Floats:
        """Distinct knots of the domain: between two of them functions are polynomials."""
        return np.unique(np.clip(self.knots, *self.domain))

    def nonzero(self, x: Floats, derivatives: int = 0) -> LocalBasis:
        """The ``degree + 1`` functions that do not vanish at places (m,), with derivatives.

        Raises ValueError if a place is not finite, or outside the domain by more than rounding.
        """
        if derivatives < 0:
            raise ValueError(f"derivatives must be 0 or more, got {derivatives}")
        places = finite_array("x", x, (None,))
        if len(places) <= MAX_CACHED_PLACES:
            return _cached_basis(self.knots.tobytes(), self.degree, places.tobytes(), derivatives)
        inside = clip_to_domain(places, self.domain)
        return local_basis(self.knots, self.degree, inside, derivatives)

    def matrix(self, x: Floats, derivative: int = 0) -> csr_array:
        """Functions, or a derivative of them, at places (m,): sparse (m, count).

        Raises ValueError as `nonzero` does.
        """
        local = self.nonzero(x, derivative)
        return _rows(local, derivative, local.columns(), self.count)


@lru_cache(maxsize=256)
def _cached_basis(knots: bytes, degree: int, x: bytes, derivatives: int) -> LocalBasis:
    """Read-only result of `local_basis` at few places: grids repeat the same ones."""
    values = np.frombuffer(knots)
    domain = float(values[degree]), float(values[len(values) - degree - 1])
    inside = clip_to_domain(np.frombuffer(x), domain)
    result = local_basis(values, degree, inside, derivatives)
    for array in result:
        array.setflags(write=False)
    return result


def check_knots(knots: Floats, degree: int) -> Floats:
    """Read-only copy of a knot vector; ValueError if it is none of a basis."""
    _check_degree(degree)
    checked = finite_array("knots", knots, (None,)).copy()
    if len(checked) < 2 * degree + 2:
        raise ValueError(
            f"knots must be at least {2 * degree + 2} for degree {degree}, got {len(checked)}"
        )
    falls = np.flatnonzero(np.diff(checked) < 0.0)
    if len(falls):
        first, second = checked[falls[0]], checked[falls[0] + 1]
        raise ValueError(f"knots must not fall, got {second:g} after {first:g}")
    values, times = np.unique(checked, return_counts=True)
    if times.max() > degree + 1:
        raise ValueError(
            f"knots may repeat {degree + 1} times at degree {degree}, "
            f"got {values[times.argmax()]:g} {times.max()} times"
        )
    if not checked[degree] < checked[-degree - 1]:
        raise ValueError(f"knots leave no domain: it begins and ends at {checked[degree]:g}")
    checked.setflags(write=False)
    return checked


def local_basis(knots: Floats, degree: int, x: Floats, derivatives: int) -> LocalBasis:
    """Values and derivatives at places (m,) in the domain; at a knot, the limit from the right.

    De Boor, *A practical guide to splines*, 1978, chapter X. The derivative of order d raises
    functions of ``degree - d`` by differences, one degree at a time: Fung, 1999, (3.25) with
    corrected indices; (3.27) divides by zero at the highest order.
    """
    count = len(knots) - degree - 1
    last = int(np.searchsorted(knots, knots[count], side="left")) - 1
    span = np.minimum(np.searchsorted(knots, x, side="right") - 1, last)
    values = np.zeros((derivatives + 1, degree + 1, len(x)))
    # Knots around each place: row r is the knot number span + 1 - degree + r.
    near = knots[span + np.arange(1 - degree, degree + 1)[:, None]]
    lower = np.ones((1, len(x)))
    for raised in range(degree + 1):
        if raised:
            lower = _raise_value(lower, near, degree, x)
        order = degree - raised
        if order <= derivatives:
            values[order] = _differentiate(lower, near, degree)
    return LocalBasis((span - degree).astype(np.int32), values.transpose(0, 2, 1))


def _raise_value(lower: Floats, near: Floats, degree: int, x: Floats) -> Floats:
    """Values (q + 1, m) of degree q from those (q, m) of one degree less."""
    q = len(lower)
    left, right = near[degree - q : degree], near[degree : degree + q]
    share = lower / (right - left)
    return _summed_parts(share * (right - x), share * (x - left))


def _differentiate(lower: Floats, near: Floats, degree: int) -> Floats:
    """Derivatives (degree + 1, m) from values of a lower degree: one order for each degree."""
    for q in range(len(lower), degree + 1):
        share = q * lower / (near[degree : degree + q] - near[degree - q : degree])
        lower = _summed_parts(-share, share)
    return lower


def _summed_parts(falling: Floats, rising: Floats) -> Floats:
    """Parts (q, m) of neighbouring functions, summed: (q + 1, m)."""
    raised = np.zeros((len(falling) + 1, falling.shape[1]))
    raised[:-1] = falling
    raised[1:] += rising
    return raised


@readable
@dataclass(frozen=True, slots=True, eq=False)
class PeriodicBasis:
    """The B-splines of uniform knots around a circle, whose turn is 1.

    `count`: functions. Raises ValueError unless it is larger than the `degree`, at least 1.
    """

    count: int
    degree: int = CUBIC
    _wound: Basis = field(init=False, repr=False)  # one turn, and its first functions repeated

    def __post_init__(self) -> None:
        object.__setattr__(self, "_wound", wound_basis(self.count, self.degree))

    def greville(self) -> Floats:
        """Greville abscissae (count,) in turns; the first may be below 0."""
        return self._wound.greville()[: self.count]

    def nonzero(self, x: Floats, derivatives: int = 0) -> LocalBasis:
        """The functions that do not vanish at places (m,), in turns: any number of them.

        Function ``count + i`` stands for function i: take `LocalBasis.columns` modulo `count`.
        Raises ValueError if a place is not finite, or `derivatives` is negative.
        """
        return self._wound.nonzero(np.mod(finite_array("x", x, (None,)), 1.0), derivatives)

    def matrix(self, x: Floats, derivative: int = 0) -> csr_array:
        """Functions, or a derivative of them, at places (m,), in turns: sparse (m, count).

        Raises ValueError as `nonzero` does.
        """
        local = self.nonzero(x, derivative)
        # Columns beyond the seam are those at the beginning.
        return _rows(local, derivative, local.columns() % self.count, self.count)


@lru_cache(maxsize=64)
def wound_basis(count: int, degree: int = CUBIC) -> Basis:
    """Uniform closed functions as a `Basis`: one turn, then its first functions again."""
    return Basis(periodic_knots(count, degree), degree)


def _rows(local: LocalBasis, derivative: int, columns: Ints, count: int) -> csr_array:
    return sparse_rows(local.values[derivative], columns, count)


def sparse_rows(values: Floats, columns: NDArray[np.integer], count: int) -> csr_array:
    """Sparse matrix (m, count) with values (m, k) at columns (m, k) of each row."""
    from scipy.sparse import csr_array  # slow to import, and not needed for evaluation

    starts = np.arange(0, columns.size + 1, columns.shape[1])
    return csr_array((values.ravel(), columns.ravel(), starts), shape=(len(columns), count))


def clamped_basis(count: int, degree: int = CUBIC) -> Basis:
    """Basis on uniform clamped knots over [0, 1]; errors as of `clamped_knots`."""
    return Basis(clamped_knots(count, degree), degree)


def clamped_knots(count: int, degree: int = CUBIC) -> Floats:
    """Uniform clamped knots on [0, 1]: Fung, 1999, (2.21), over its last knot.

    With one more coefficient than the degree they are those of the Bernstein basis. Raises
    ValueError if there are not more coefficients than the degree.
    """
    _check_count(count, degree)
    inner = np.linspace(0.0, 1.0, count - degree + 1)
    return np.concatenate([np.zeros(degree), inner, np.ones(degree)])


class LocalBasis(NamedTuple):
    """Functions that do not vanish at some places."""

    first: Ints  # index of the first of them, (m,)
    values: Floats  # (derivatives + 1, m, degree + 1): values, first derivatives and so on

    def columns(self) -> Ints:
        """Indices of all of them, (m, degree + 1)."""
        steps = np.arange(self.values.shape[2], dtype=np.int32)
        return self.first[:, None] + steps


def periodic_knots(count: int, degree: int = CUBIC) -> Floats:
    """Uniform knots of a closed curve of `count` control points, one turn being 1.

    The first `degree` control points are repeated at the end: ``count + 2 degree + 1`` knots.
    Raises ValueError if there are not more coefficients than the degree.
    """
    _check_count(count, degree)
    return np.arange(-degree, count + degree + 1) / count


def _check_count(count: int, degree: int) -> None:
    _check_degree(degree)
    if count <= degree:
        raise ValueError(f"count must be larger than the degree {degree}, got {count}")


def averaged_knots(sites: Floats, degree: int = CUBIC) -> Floats:
    """Clamped knots with which values at the sites can be interpolated.

    `sites` (n,): parameters of the values, increasing. Raises ValueError if the degree is below 1,
    there are not more sites than it, or they do not increase. Each inner knot is the average of
    `degree` sites: Fung, 1999, (4.19), where the sum must begin with its first site. As printed the
    knots fall, and sorted they make the system singular.
    """
    sites = finite_array("sites", sites, (None,))
    _check_degree(degree)
    if len(sites) <= degree:
        raise ValueError(f"sites must be more than the degree {degree}, got {len(sites)}")
    if not (np.diff(sites) > 0.0).all():
        raise ValueError("sites must increase")
    inner = _averages(sites[1:-1], degree) if len(sites) > degree + 1 else np.zeros(0)
    return np.concatenate([np.full(degree + 1, sites[0]), inner, np.full(degree + 1, sites[-1])])


def _check_degree(degree: int) -> None:
    if degree < 1:
        raise ValueError(f"degree must be at least 1, got {degree}")


def _averages(values: Floats, width: int) -> Floats:
    return np.asarray(np.lib.stride_tricks.sliding_window_view(values, width).mean(axis=1))


def evaluate_scattered(
    bases: Sequence[Basis], control: Floats, at: Floats, orders: Sequence[Orders]
) -> Floats:
    """Derivatives of a tensor product at scattered places.

    `control` (count_1, ..., count_d, c); `at` (m, d); `orders`: all zeros for the value. Returns
    (len(orders), m, c). Raises ValueError if shapes do not fit, a number is not finite, a parameter
    lies outside the domain by more than rounding, or an order is negative.
    """
    from scipy.interpolate import NdBSpline  # slow to import, and not needed on a grid

    places = finite_array("at", at, (None, len(bases)))
    control = _checked(bases, control, orders)
    columns = zip(bases, places.T, strict=True)
    inside = np.column_stack([clip_to_domain(x, basis.domain) for basis, x in columns])
    spline = NdBSpline(
        tuple(basis.knots for basis in bases), control, tuple(basis.degree for basis in bases)
    )
    result = np.empty((len(orders), len(inside), control.shape[-1]))
    for values, order in zip(result, orders, strict=True):
        values[:] = spline(inside, nu=order) if len(inside) else 0.0
    return result


def evaluate_grid(
    bases: Sequence[Basis], control: Floats, axes: Sequence[Floats], orders: Orders | None = None
) -> Floats:
    """A tensor product, or a derivative of it, on a grid.

    Along each axis by its basis, parameters and order, 0 if left out. Returns (len(axes[0]), ...,
    c) from `control` (count_1, ..., count_d, c). Raises ValueError as `evaluate_scattered`.
    """
    orders = (0,) * len(bases) if orders is None else orders
    values = _checked(bases, control, [orders])
    if len(axes) != len(bases):
        raise ValueError(f"axes must be {len(bases)}, one for each basis, got {len(axes)}")
    for basis, x, order in zip(bases, axes, orders, strict=True):
        local, flat = basis.nonzero(x, order), values.reshape(basis.count, -1)
        reaching = zip(local.values[order].T, local.columns().T, strict=True)
        rows = sum(weights[:, None] * flat[columns] for weights, columns in reaching)
        # The evaluated axis goes to the end; after the last one the components are first.
        values = np.reshape(rows, (len(x), *values.shape[1:]))
        values = np.moveaxis(values, 0, -1)
    return np.ascontiguousarray(np.moveaxis(values, 0, -1))


def _checked(bases: Sequence[Basis], control: Floats, orders: Sequence[Orders]) -> Floats:
    counts = tuple(basis.count for basis in bases)
    for order in orders:
        if len(order) != len(bases) or min(order) < 0:
            raise ValueError(f"orders must be 0 or more for each of {len(bases)} axes, got {order}")
    return finite_array("control", control, (*counts, None))


class Interpolant(NamedTuple):
    """A spline that interpolates values."""

    control: Floats  # coefficients (count_1, ..., count_d, c), in the unit of the values
    condition: float  # condition number of the system: the product of those along the axes


def interpolate_grid(
    bases: Sequence[Basis], sites: Sequence[Floats], values: Floats
) -> Interpolant:
    """The spline that interpolates values on a grid.

    Raises ValueError if there are not sites for each basis, as many as it has functions, the values
    (n_1, ..., n_d, c) have another shape or are not finite, or the sites determine no spline.
    """
    if len(sites) != len(bases):
        raise ValueError(f"sites must be given for {len(bases)} axes, got {len(sites)}")
    counts = tuple(len(places) for places in sites)
    control = finite_array("values", values, (*counts, None))
    condition = 1.0
    for axis, (basis, places) in enumerate(zip(bases, sites, strict=True)):
        if not is_interpolable(basis, places):
            raise ValueError(
                f"sites of axis {axis} must be {basis.count}, increase, and lie one by one where "
                f"the {basis.count} functions do not vanish, got {np.asarray(places).tolist()}"
            )
        matrix = basis.matrix(places).toarray()
        condition *= float(np.linalg.cond(matrix))
        along = np.moveaxis(control, axis, 0)
        solved = np.linalg.solve(matrix, along.reshape(len(places), -1)).reshape(along.shape)
        control = np.moveaxis(solved, 0, axis)
    return Interpolant(np.ascontiguousarray(control), condition)


def is_interpolable(basis: Basis, sites: Floats) -> bool:
    """Whether values at sites (n,) determine exactly one spline.

    Schoenberg and Whitney, 1953: as many as functions, rising, each where its own does not vanish.
    """
    sites = finite_array("sites", sites, (None,))
    if len(sites) != basis.count or not (np.diff(sites) > 0.0).all():
        return False
    return bool((basis.matrix(sites).diagonal() > 0.0).all())


def insert_knots(basis: Basis, control: Floats, new: Floats, axis: int = 0) -> tuple[Basis, Floats]:
    """The basis with further knots, and the coefficients that give the same spline on it.

    `basis`: along the axis. `control`: coefficients. `new` (k,): knots within the domain. `axis`:
    which axis of the coefficients the basis belongs to. Raises ValueError if a new knot lies
    outside the domain, or would occur more often than the degree allows; if there are not as many
    coefficients as the basis has functions, or one is not finite. Boehm, *Inserting new knots into
    B-spline curves*, 1980: each new coefficient is a mean of two old ones.
    """
    degree = basis.degree
    control = np.moveaxis(finite_array("control", control, (None,) * np.ndim(control)), axis, 0)
    if len(control) != basis.count:
        raise ValueError(f"control must have {basis.count} coefficients, got {len(control)}")
    for knot in clip_to_domain(finite_array("new", new, (None,)), basis.domain):
        knots = basis.knots
        place = int(np.searchsorted(knots, knot, side="right"))
        basis = Basis(np.insert(knots, place, knot), degree)
        i = np.arange(basis.count)
        start, end = (knots[np.minimum(i + step, len(knots) - 1)] for step in (0, degree))
        with np.errstate(divide="ignore", invalid="ignore"):  # these are not used
            share = (knot - start) / (end - start)
        share = np.where(i + degree < place, 1.0, np.where(i >= place, 0.0, share))
        share = share.reshape(-1, *(1,) * (control.ndim - 1))
        here, before = control[np.minimum(i, len(control) - 1)], control[np.maximum(i - 1, 0)]
        control = share * here + (1.0 - share) * before
    return basis, np.moveaxis(control, 0, axis)


def clip_to_domain(x: Floats, domain: tuple[float, float]) -> Floats:
    """Places (m,) clipped to a domain, if they are outside by no more than rounding.

    Raises ValueError if one lies farther outside, with their number and the worst of them.
    """
    low, high = domain
    rounding = ROUNDING * max(abs(low), abs(high))
    outside = (x < low - rounding) | (x > high + rounding)
    if outside.any():
        worst = x[np.argmax(np.maximum(low - x, x - high))]
        raise ValueError(
            f"x must lie in the domain from {low:g} to {high:g}, "
            f"got {np.count_nonzero(outside)} outside, the worst {worst:g}"
        )
    return np.clip(x, low, high)


def bending_along(basis: Basis, order: int = 2) -> Floats:
    """Root (r, count) of the integral of a spline's squared derivative of an order, 1 or 2."""
    nodes, weights = np.polynomial.legendre.leggauss(2)  # exact for squared second derivatives
    breaks = np.unique(basis.knots)
    half = 0.5 * np.diff(breaks)
    places = ((breaks[:-1] + half)[:, None] + half[:, None] * nodes).ravel()
    roots = np.sqrt((half[:, None] * weights).ravel())
    return np.asarray(roots[:, None] * basis.matrix(places, order).toarray())


def bending_around(count: int) -> Floats:
    """Root (count, count) of the bending of a closed curve, beyond that of an ellipse.

    Constants and the first harmonic have no bending: a smoothed circle keeps its size.
    """
    unit = np.eye(count)
    before, after = np.roll(unit, 1, axis=1), np.roll(unit, -1, axis=1)
    beyond = before - 2.0 * np.cos(2.0 * np.pi / count) * unit + after
    return np.asarray((before - 2.0 * unit + after) @ beyond)
