"""B-spline bases on an interval: a knot vector, a degree, and what follows from them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_array

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.splines.knots import CUBIC, check_knots, clamped_knots, greville, periodic_knots
from palpate.core.splines.local_basis import Local, local_basis

ROUNDING = 64 * float(np.finfo(float).eps)
"""Of the largest parameter: places that lie outside by less are taken to the end."""


@dataclass(frozen=True, slots=True, eq=False)
class Basis:
    """The B-splines of a knot vector.

    Parameters
    ----------
    knots : (count + degree + 1,) array
        Not falling; a knot may occur up to ``degree + 1`` times.
    degree : int
        At least 1.

    Raises
    ------
    ValueError
        If the knots are not like that, or leave no domain.
    """

    knots: Floats
    degree: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "knots", check_knots(self.knots, self.degree))

    @property
    def count(self) -> int:
        """Functions, and thus coefficients."""
        return len(self.knots) - self.degree - 1

    @property
    def domain(self) -> tuple[float, float]:
        """Where the functions sum to 1."""
        return float(self.knots[self.degree]), float(self.knots[self.count])

    def greville(self) -> Floats:
        """Greville abscissae (count,): coefficients that reproduce the identity."""
        return greville(self.knots, self.degree)

    def nonzero(self, x: Floats, derivatives: int = 0) -> Local:
        """The ``degree + 1`` functions that do not vanish at places (m,), with derivatives.

        Raises
        ------
        ValueError
            If a place lies outside the domain by more than rounding, or is not finite; if
            `derivatives` is negative.
        """
        if derivatives < 0:
            raise ValueError(f"derivatives must be 0 or more, got {derivatives}")
        inside = clip_to_domain(finite_array("x", x, (None,)), self.domain)
        return local_basis(self.knots, self.degree, inside, derivatives)

    def matrix(self, x: Floats, derivative: int = 0) -> csr_array:
        """Functions, or a derivative of them, at places (m,): sparse (m, count).

        Raises
        ------
        ValueError
            As `nonzero` does.
        """
        local = self.nonzero(x, derivative)
        return _rows(local, derivative, local.columns(), self.count)


@dataclass(frozen=True, slots=True, eq=False)
class PeriodicBasis:
    """The B-splines of uniform knots around a circle, whose turn is 1.

    Parameters
    ----------
    count : int
        Functions; more than the degree.
    degree : int
        At least 1.

    Raises
    ------
    ValueError
        If there are too few functions.
    """

    count: int
    degree: int = CUBIC
    _wound: Basis = field(init=False, repr=False)
    """One turn of it, with its first functions once more at the end."""

    def __post_init__(self) -> None:
        wound = Basis(periodic_knots(self.count, self.degree), self.degree)
        object.__setattr__(self, "_wound", wound)

    def greville(self) -> Floats:
        """Places (count,) that belong to the coefficients, in turns; the first may be below 0."""
        return self._wound.greville()[: self.count]

    def nonzero(self, x: Floats, derivatives: int = 0) -> Local:
        """The functions that do not vanish at places (m,), in turns: any number of them.

        Function ``count + i`` stands for function i: take `Local.columns` modulo `count`.

        Raises
        ------
        ValueError
            If a place is not finite, or `derivatives` is negative.
        """
        turns = np.mod(finite_array("x", x, (None,)), 1.0)
        return self._wound.nonzero(turns, derivatives)

    def matrix(self, x: Floats, derivative: int = 0) -> csr_array:
        """Functions, or a derivative of them, at places (m,), in turns: sparse (m, count).

        Raises
        ------
        ValueError
            As `nonzero` does.
        """
        local = self.nonzero(x, derivative)
        # The columns that hang over the seam are those at the beginning.
        return _rows(local, derivative, local.columns() % self.count, self.count)


def clamped_basis(count: int, degree: int = CUBIC) -> Basis:
    """Basis on uniform clamped knots over [0, 1].

    Raises
    ------
    ValueError
        If there are not more coefficients than the degree.
    """
    return Basis(clamped_knots(count, degree), degree)


def bernstein_basis(degree: int) -> Basis:
    """Bernstein polynomials on [0, 1]: clamped knots without inner ones.

    Raises
    ------
    ValueError
        If the degree is below 1.
    """
    return clamped_basis(degree + 1, degree)


def clip_to_domain(x: Floats, domain: tuple[float, float]) -> Floats:
    """Places (m,) in a domain; those outside by no more than rounding are taken to its ends.

    Raises
    ------
    ValueError
        If one lies farther outside: how many do, and the worst of them.
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
    clipped: Floats = np.clip(x, low, high)
    return clipped


def _rows(local: Local, derivative: int, columns: Ints, count: int) -> csr_array:
    width = columns.shape[1]
    starts = np.arange(0, columns.size + 1, width)
    shape = (len(columns), count)
    return csr_array((local.values[derivative].ravel(), columns.ravel(), starts), shape=shape)
