"""Knot vectors: what they must be, and the usual ones.

A basis of `count` functions of degree p has ``count + p + 1`` knots; it is whole on its domain,
from the knot p to the knot `count`.
"""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats, finite_array

CUBIC = 3


def check_knots(knots: Floats, degree: int) -> Floats:
    """A knot vector on which a basis of a degree can stand, as a read-only copy.

    Raises
    ------
    ValueError
        If the degree is below 1, a knot is not finite, there are fewer than ``2 degree + 2``,
        they fall anywhere, one of them occurs more than ``degree + 1`` times, or the domain is
        empty.
    """
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


def clamped_knots(count: int, degree: int = CUBIC) -> Floats:
    """Uniform clamped knots on [0, 1]: Fung, 1999, (2.21), over its last knot.

    With one more coefficient than the degree they are those of the Bernstein basis.

    Raises
    ------
    ValueError
        If there are not more coefficients than the degree.
    """
    _check_count(count, degree)
    inner = np.linspace(0.0, 1.0, count - degree + 1)
    return np.concatenate([np.zeros(degree), inner, np.ones(degree)])


def uniform_knots(count: int, degree: int = CUBIC) -> Floats:
    """Uniform knots that run on beyond both ends of the domain [0, 1].

    Raises
    ------
    ValueError
        If there are not more coefficients than the degree.
    """
    _check_count(count, degree)
    return np.arange(-degree, count + 1) / (count - degree)


def periodic_knots(count: int, degree: int = CUBIC) -> Floats:
    """Uniform knots of a closed curve of `count` control points, one turn being 1.

    The first `degree` control points come again at the end: ``count + 2 degree + 1`` knots.

    Raises
    ------
    ValueError
        If there are not more coefficients than the degree.
    """
    _check_count(count, degree)
    return np.arange(-degree, count + degree + 1) / count


def averaged_knots(sites: Floats, degree: int = CUBIC) -> Floats:
    """Clamped knots with which values at the sites can be interpolated.

    Parameters
    ----------
    sites : (n,) array
        Parameters of the values, increasing.

    Raises
    ------
    ValueError
        If the degree is below 1, there are not more sites than it, or they do not increase.

    Notes
    -----
    Each inner knot is the average of `degree` sites: Fung, 1999, (4.19), where the sum must
    begin with its first site. As printed the knots fall, and sorted they make the system
    singular.
    """
    sites = finite_array("sites", sites, (None,))
    _check_degree(degree)
    if len(sites) <= degree:
        raise ValueError(f"sites must be more than the degree {degree}, got {len(sites)}")
    if not (np.diff(sites) > 0.0).all():
        raise ValueError("sites must increase")
    inner = _averages(sites[1:-1], degree) if len(sites) > degree + 1 else np.zeros(0)
    return np.concatenate([np.full(degree + 1, sites[0]), inner, np.full(degree + 1, sites[-1])])


def greville(knots: Floats, degree: int) -> Floats:
    """Greville abscissae (count,): the averages of `degree` knots.

    Coefficients equal to them reproduce the identity.

    Raises
    ------
    ValueError
        If the knots cannot be those of a basis of the degree.
    """
    return _averages(check_knots(knots, degree)[1:-1], degree)


def _check_degree(degree: int) -> None:
    if degree < 1:
        raise ValueError(f"degree must be at least 1, got {degree}")


def _check_count(count: int, degree: int) -> None:
    _check_degree(degree)
    if count <= degree:
        raise ValueError(f"count must be larger than the degree {degree}, got {count}")


def _averages(values: Floats, width: int) -> Floats:
    """Averages of so many neighbours each."""
    averages: Floats = np.lib.stride_tricks.sliding_window_view(values, width).mean(axis=1)
    return averages
