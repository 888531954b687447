"""Piecewise linear functions, which the thesis fits to its step sizes (section 3.6).

It writes them as sums of |x - k| over knots k, (3.29), and solves normal equations, (3.33):
collinear where knots come close. Hat functions span the same functions, their coefficients are
the values at the knots, and their condition stays small whatever the knots.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, finite_array

LEAST_GAP = 1e-3
"""Of the even gap: free knots never come nearer."""
MOST_CALLS = 60
"""Of the function that free knots are found with."""
LEAST_CURVE = 1e-12


class Polyline(NamedTuple):
    """A piecewise linear function; beyond its knots it stays at its last values."""

    knots: Floats
    """(n + 1,), increasing."""
    values: Floats
    """(n + 1,)."""

    def at(self, place: float) -> float:
        """Value."""
        return float(np.interp(place, self.knots, self.values))


def hat_matrix(places: Floats, knots: Floats) -> Floats:
    """Values (n, m) of the m hat functions of increasing knots at n places.

    Raises
    ------
    ValueError
        If the knots do not increase.
    """
    knots = finite_array("knots", knots, (None,))
    if len(knots) < 2 or not (np.diff(knots) > 0.0).all():
        raise ValueError(f"knots must be at least 2 and increase, got {knots}")
    columns = [np.interp(places, knots, hat) for hat in np.eye(len(knots))]
    return np.stack(columns, axis=1)


def even_curve_knots(places: Floats, values: Floats, segments: int) -> Floats:
    """Knots between which the root of the second derivative has the same sum: closed form.

    Parameters
    ----------
    places, values : (n,) arrays
        The function, at increasing places.
    segments : int
        Pieces wanted.
    """
    _check(places, values, segments)
    second = np.gradient(np.gradient(values, places), places)
    density = np.sqrt(np.abs(second)) + LEAST_CURVE
    steps = 0.5 * (density[1:] + density[:-1]) * np.diff(places)
    mass = np.concatenate([[0.0], np.cumsum(steps)])
    return np.interp(np.linspace(0.0, mass[-1], segments + 1), mass, places)


def fit_falling(places: Floats, values: Floats, knots: Floats) -> Polyline:
    """The best polyline, in the least squares, that never rises and never is below 0."""
    from scipy.optimize import nnls

    falls = np.triu(np.ones((len(knots), len(knots))))
    steps, _ = nnls(hat_matrix(places, knots) @ falls, values)
    return Polyline(knots, falls @ steps)


def free_knots(places: Floats, values: Floats, segments: int) -> Polyline:
    """The best falling polyline over its knots as well, by variable projection.

    For given knots the values follow by linear least squares; what is searched is the knots
    alone, as shares of the range, so that they stay in order.
    """
    from scipy.optimize import least_squares

    _check(places, values, segments)

    def fitted(logits: Floats) -> Polyline:
        gaps = np.exp(logits - logits.max())
        shares = (1.0 - LEAST_GAP) * gaps / gaps.sum() + LEAST_GAP / segments
        ends = np.concatenate([[0.0], np.cumsum(shares)])
        ends[-1] = 1.0
        return fit_falling(places, values, places[0] + (places[-1] - places[0]) * ends)

    def off(logits: Floats) -> Floats:
        line = fitted(logits)
        return np.asarray(np.interp(places, line.knots, line.values) - values)

    even = np.log(np.diff(even_curve_knots(places, values, segments)))
    return fitted(least_squares(off, even, max_nfev=MOST_CALLS).x)


def polyline_of(function: Callable[[Floats], Floats], most: float, segments: int) -> Polyline:
    """A falling function from 0 to `most` as a polyline, its knots in closed form."""
    places = np.linspace(0.0, most, 40 * segments + 1)
    values = function(places)
    return fit_falling(places, values, even_curve_knots(places, values, segments))


def _check(places: Floats, values: Floats, segments: int) -> None:
    places = finite_array("places", places, (None,))
    finite_array("values", values, (len(places),))
    if len(places) < 3 or not (np.diff(places) > 0.0).all():
        raise ValueError("places must be at least 3 and increase")
    if segments < 1:
        raise ValueError(f"segments must be at least 1, got {segments}")
