"""A parametric solid: points of space as a spline of three parameters.

Polynomial (Bernstein or B-spline) without weights, rational (NURBS) with them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_array

from palpate.core.arrays import Floats, finite_array
from palpate.core.splines.frame import Bases
from palpate.core.splines.tensor import Orders, evaluate, evaluate_grid

VALUE: tuple[Orders, ...] = ((0, 0, 0),)
FIRST: tuple[Orders, ...] = (*VALUE, (1, 0, 0), (0, 1, 0), (0, 0, 1))
SECOND: tuple[Orders, ...] = (
    *FIRST,
    (2, 0, 0),
    (1, 1, 0),
    (1, 0, 1),
    (0, 2, 0),
    (0, 1, 1),
    (0, 0, 2),
)
PAIRS = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
"""Which of the second derivatives belongs to a pair of axes."""


@dataclass(frozen=True, slots=True, eq=False)
class Volume:
    """A spline solid over parameters s, t, u between 0 and 1.

    Parameters
    ----------
    control : (l, m, n, 3) array
        Control points along s, t, u, m.
    bases : three bases
        One for each axis, with as many functions as there are control points, over [0, 1].
    weights : (l, m, n) array, optional
        Positive weights of the control points; without them all are alike.

    Raises
    ------
    ValueError
        If shapes do not fit, something is not finite, or a weight is not positive.

    Notes
    -----
    Fung, 1999, (2.20), (2.22), and with weights (2.24), (2.25).
    """

    control: Floats
    bases: Bases
    weights: Floats | None = None
    spline: Floats = field(init=False, repr=False)
    """What the bases multiply: the control points, or (l, m, n, 4) with weights."""

    def __post_init__(self) -> None:
        if len(self.bases) != 3:
            raise ValueError(f"bases must be three, for s, t and u, got {len(self.bases)}")
        counts = tuple(basis.count for basis in self.bases)
        control = finite_array("control", self.control, (*counts, 3)).copy()
        for name, basis in zip("stu", self.bases, strict=True):
            if basis.domain != (0.0, 1.0):
                raise ValueError(f"basis along {name} must span 0 to 1, got {basis.domain}")
        spline = control
        if self.weights is not None:
            weights = finite_array("weights", self.weights, counts)
            if not (weights > 0.0).all():
                raise ValueError(f"weights must be positive, got {weights.min():g}")
            weights = weights / weights.max()
            spline = np.concatenate([weights[..., None] * control, weights[..., None]], axis=-1)
            weights.setflags(write=False)
            object.__setattr__(self, "weights", weights)
        control.setflags(write=False)
        spline.setflags(write=False)
        object.__setattr__(self, "control", control)
        object.__setattr__(self, "spline", spline)

    def at(self, parameters: Floats) -> Floats:
        """Points (n, 3) at parameters (n, 3), m.

        Raises
        ------
        ValueError
            If parameters are not finite (n, 3), or lie outside 0 to 1 by more than rounding,
            here and below.
        """
        value: Floats = evaluate(self.bases, self.spline, parameters, VALUE)[0]
        return value if self.weights is None else value[:, :3] / value[:, 3:]

    def first(self, parameters: Floats) -> tuple[Floats, Floats]:
        """Points (n, 3), m, and slopes (n, 3, 3): a column for each of s, t, u."""
        value, *slopes = evaluate(self.bases, self.spline, parameters, FIRST)
        slope = np.stack(slopes, axis=-1)
        if self.weights is None:
            return value, slope
        points = value[:, :3] / value[:, 3:]
        return points, _quotient_slope(points, slope, value[:, 3])

    def second(self, parameters: Floats) -> tuple[Floats, Floats, Floats]:
        """Points, slopes, and second derivatives (n, 3, 3, 3): component, axis, axis."""
        found = evaluate(self.bases, self.spline, parameters, SECOND)
        value, slope = found[0], np.stack(list(found[1:4]), axis=-1)
        bend = found[4:][PAIRS].transpose(2, 3, 0, 1)
        if self.weights is None:
            return value, slope, bend
        points, weight = value[:, :3] / value[:, 3:], value[:, 3]
        slopes = _quotient_slope(points, slope, weight)
        mixed = slopes[:, :, :, None] * slope[:, 3:, None, :]
        both = mixed + mixed.transpose(0, 1, 3, 2)
        bend = bend[:, :3] - both - points[:, :, None, None] * bend[:, 3:]
        return points, slopes, bend / weight[:, None, None, None]

    def grid(self, s: Floats, t: Floats, u: Floats) -> Floats:
        """Points (a, b, c, 3) on a grid of parameters (a,), (b,), (c,), m."""
        value = evaluate_grid(self.bases, self.spline, (s, t, u))
        return value if self.weights is None else value[..., :3] / value[..., 3:]

    def shares(self, parameters: Floats) -> csr_array:
        """What share each control point has in the points: sparse (n, l m n), rows sum to 1."""
        parameters = finite_array("parameters", parameters, (None, 3))
        n = len(parameters)
        columns = np.zeros((n, 1), np.int64)
        values = np.ones((n, 1))
        for axis, basis in enumerate(self.bases):
            local = basis.nonzero(parameters[:, axis])
            wide = n, columns.shape[1] * (basis.degree + 1)
            columns = (columns[:, :, None] * basis.count + local.columns()[:, None]).reshape(wide)
            values = (values[:, :, None] * local.values[0][:, None]).reshape(wide)
        if self.weights is not None:
            values = values * self.weights.ravel()[columns]
            values = values / values.sum(axis=1, keepdims=True)
        starts = np.arange(0, columns.size + 1, columns.shape[1])
        shape = (n, self.control[..., 0].size)
        return csr_array((values.ravel(), columns.ravel(), starts), shape=shape)


def _quotient_slope(points: Floats, slope: Floats, weight: Floats) -> Floats:
    """Slopes (n, 3, 3) of points that are a quotient, from those (n, 4, 3) of both its parts."""
    slopes: Floats = (slope[:, :3] - points[:, :, None] * slope[:, 3:]) / weight[:, None, None]
    return slopes
