"""Tensor products of splines along any number of axes: curves, surfaces, solids.

Places that lie anywhere take the few control points that reach them; places on a grid are
evaluated one axis at a time.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.splines.basis import Basis

Orders = tuple[int, ...]
"""Order of the derivative along each axis."""

BLOCK = 1 << 18
"""Numbers gathered at a time: about what a core keeps at hand."""


def evaluate(
    bases: Sequence[Basis], control: Floats, at: Floats, orders: Sequence[Orders]
) -> Floats:
    """Derivatives of a tensor product at scattered places.

    Parameters
    ----------
    bases : sequence of d bases
        One for each axis.
    control : (count_1, ..., count_d, c) array
        Coefficients.
    at : (m, d) array
        Parameters.
    orders : sequence of tuples of d integers
        Which derivatives; all zeros for the value.

    Returns
    -------
    (len(orders), m, c) array

    Raises
    ------
    ValueError
        If shapes do not fit, a coefficient or parameter is not finite, a parameter lies outside
        the domain by more than rounding, or an order is negative.
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


def evaluate_grid(
    bases: Sequence[Basis], control: Floats, axes: Sequence[Floats], orders: Orders | None = None
) -> Floats:
    """A tensor product, or a derivative of it, on a grid.

    Parameters
    ----------
    bases : sequence of d bases
        One for each axis.
    control : (count_1, ..., count_d, c) array
        Coefficients.
    axes : sequence of d arrays
        Parameters along each axis.
    orders : tuple of d integers, optional
        Order of the derivative along each axis; the value if left out.

    Returns
    -------
    (len(axes[0]), ..., len(axes[-1]), c) array

    Raises
    ------
    ValueError
        If shapes do not fit, a coefficient or parameter is not finite, a parameter lies outside
        the domain by more than rounding, or an order is negative.
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
    result: Floats = np.ascontiguousarray(np.moveaxis(values, 0, -1))
    return result


def _checked(bases: Sequence[Basis], control: Floats, orders: Sequence[Orders]) -> Floats:
    counts = tuple(basis.count for basis in bases)
    for order in orders:
        if len(order) != len(bases) or min(order) < 0:
            raise ValueError(f"orders must be 0 or more for each of {len(bases)} axes, got {order}")
    return finite_array("control", control, (*counts, None))


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
