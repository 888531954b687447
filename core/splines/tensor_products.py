"""Tensor products of splines along any number of axes: evaluated, interpolated, refined by knots.

Places that lie anywhere take the few control points that reach them; places on a grid are
evaluated one axis at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.splines.bases import Basis, clip_to_domain

Orders = tuple[int, ...]  # Order of the derivative along each axis
BLOCK = 1 << 18  # Numbers gathered at a time: about what a core keeps at hand


def evaluate_scattered(
    bases: Sequence[Basis], control: Floats, at: Floats, orders: Sequence[Orders]
) -> Floats:
    """Derivatives of a tensor product at scattered places.

    `bases`: one for each axis. `control` (count_1, ..., count_d, c): coefficients. `at` (m, d):
    parameters. `orders`: which derivatives; all zeros for the value. Returns (len(orders). Raises
    ValueError if shapes do not fit, a coefficient or parameter is not finite, a parameter lies
    outside the domain by more than rounding, or an order is negative.
    """
    at = finite_array("at", at, (None, len(bases)))
    control = _checked(bases, control, orders)
    result = np.empty((len(orders), len(at), control.shape[-1]))
    reach = int(np.prod([basis.degree + 1 for basis in bases])) * control.shape[-1]
    step = max(BLOCK // reach, 1)
    for start in range(0, len(at), step):
        part = slice(start, start + step)
        result[:, part] = _evaluate_block(bases, control, at[part], orders)
    return result


def _evaluate_block(
    bases: Sequence[Basis], control: Floats, at: Floats, orders: Sequence[Orders]
) -> Floats:
    numbers = np.zeros((len(at), 1), np.int64)
    weights = []
    for axis, basis in enumerate(bases):
        local = basis.nonzero(at[:, axis], max((order[axis] for order in orders), default=0))
        columns = local.columns()
        numbers = (numbers[:, :, None] * basis.count + columns[:, None, :]).reshape(len(at), -1)
        weights.append(np.ascontiguousarray(local.values.transpose(1, 0, 2)))
    near = control.reshape(-1, control.shape[-1]).take(numbers, axis=0)
    result = np.empty((len(orders), len(at), control.shape[-1]))
    _contract(weights, near, list(enumerate(orders)), result)
    return result


def _contract(
    weights: list[Floats], near: Floats, orders: list[tuple[int, Orders]], result: Floats
) -> None:
    """Sum over the first axis once for each order along it, then over the others."""
    wanted = sorted({order[0] for _, order in orders})
    rows = weights[0][:, wanted]
    sums = rows @ near.reshape(len(near), rows.shape[2], -1)
    for place, first in enumerate(wanted):
        rest = [(number, order[1:]) for number, order in orders if order[0] == first]
        if len(weights) > 1:
            _contract(weights[1:], sums[:, place], rest, result)
        else:
            for number, _ in rest:
                result[number] = sums[:, place]


def evaluate_grid(
    bases: Sequence[Basis], control: Floats, axes: Sequence[Floats], orders: Orders | None = None
) -> Floats:
    """A tensor product, or a derivative of it, on a grid.

    `bases`: one for each axis. `control` (count_1, ..., count_d, c): coefficients. `axes`:
    parameters along each axis. `orders`: order of the derivative along each axis; the value if left
    out. Returns (len(axes[0]). Raises ValueError if shapes do not fit, a coefficient or parameter
    is not finite, a parameter lies outside the domain by more than rounding, or an order is
    negative.
    """
    orders = (0,) * len(bases) if orders is None else orders
    values = _checked(bases, control, [orders])
    if len(axes) != len(bases):
        raise ValueError(f"axes must be {len(bases)}, one for each basis, got {len(axes)}")
    for basis, x, order in zip(bases, axes, orders, strict=True):
        rows = basis.matrix(x, order) @ values.reshape(basis.count, -1)
        # The axis that is done goes to the end; after the last one the components are first.
        values = rows.reshape(len(x), *values.shape[1:])
        values = np.moveaxis(values, 0, -1)
    return np.ascontiguousarray(np.moveaxis(values, 0, -1))


def _checked(bases: Sequence[Basis], control: Floats, orders: Sequence[Orders]) -> Floats:
    counts = tuple(basis.count for basis in bases)
    for order in orders:
        if len(order) != len(bases) or min(order) < 0:
            raise ValueError(f"orders must be 0 or more for each of {len(bases)} axes, got {order}")
    return finite_array("control", control, (*counts, None))


class Interpolant(NamedTuple):
    """A spline that takes given values."""

    control: Floats  # Coefficients (count_1, ..., count_d, c), in the unit of the values
    condition: float  # Condition number of the whole system: the product of those along the axes


def interpolate_grid(
    bases: Sequence[Basis], sites: Sequence[Floats], values: Floats
) -> Interpolant:
    """The spline that takes given values on a grid.

    `bases`: one for each axis. `sites`: parameters along each axis, as many as its basis has
    functions. `values` (n_1, ..., n_d, c): values on the grid of sites. Raises ValueError if there
    are not sites for each basis, if the values do not fit them or are not finite, or if the sites
    of an axis determine no spline.
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
    """Whether exactly one spline takes given values at given sites.

    `basis`: basis. `sites` (n,): parameters in its domain. Raises ValueError if a site lies outside
    the domain, or is not finite.

    Schoenberg and Whitney, 1953: there are as many sites as functions, they increase, and each
    lies where its function does not vanish.
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
    coefficients as the basis has functions, or one is not finite.

    Boehm, *Inserting new knots into B-spline curves*, 1980: each new coefficient is a mean of
    two old ones.
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
        start, end = (
            knots[np.minimum(i, len(knots) - 1)],
            knots[np.minimum(i + degree, len(knots) - 1)],
        )
        with np.errstate(divide="ignore", invalid="ignore"):  # those are not taken
            share = (knot - start) / (end - start)
        share = np.where(i + degree < place, 1.0, np.where(i >= place, 0.0, share))
        share = share.reshape(-1, *(1,) * (control.ndim - 1))
        last = len(control) - 1
        control = (
            share * control[np.minimum(i, last)] + (1.0 - share) * control[np.maximum(i - 1, 0)]
        )
    return basis, np.moveaxis(control, 0, axis)
