"""Factorised monomials over the touched taxels: all of a jet's fit that no height enters.

The monomials are ordered by degree, so that one factorisation holds those of all lower degrees
as its leading blocks. It depends on which taxels are touched and on nothing else: a full pad is
factorised once.
"""

from __future__ import annotations

import math
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.touch.jet import COUNTS, derivative_rows, monomials

LEAST_TAXELS = 8
"""Below this there is no telling a slope from a corner."""
DEGREES = ((45, 4), (30, 3), (12, 2), (LEAST_TAXELS, 1))
"""Least number of taxels for each degree: about three for each coefficient."""
DEPENDENT = 1e-9
"""A monomial of which the lower ones leave less than this root mean square, over the touched
taxels, is not seen: rounding leaves 1e-16, the smallest contact that is fitted 1e-3."""
KEPT_DESIGNS = 32
"""Factorisations that are remembered, 70 kB each."""


class Design(NamedTuple):
    """Factorised monomials over the touched taxels."""

    places: Ints
    """Indices of the touched taxels in the flattened array, (n,)."""
    middle: tuple[float, float]
    """Their mean place, m."""
    scale: float
    """Half the width of the pad, m."""
    monomials: Floats
    """(n, m)."""
    basis: Floats
    """Orthonormal columns Q of the factorisation Q R, (n, m)."""
    rows: Floats
    """What gives height and derivatives at the middle from the coefficients, (6, m)."""
    outer: Floats
    """What gives coefficients, height and derivatives from those over Q, (m + 6, m)."""


@lru_cache(maxsize=KEPT_DESIGNS)
def design_of(rows: int, cols: int, pitch: float, touched: bytes) -> Design | None:
    """The design of the touched taxels of an array, given as the bytes of their mask.

    None if they are fewer than 8, or lie on a line.
    """
    places = np.flatnonzero(np.frombuffer(touched, np.bool_)).astype(np.int32)
    degree = largest_degree(len(places))
    if degree == 0:
        return None
    x, y, all_over = _whole_pad(rows, cols)
    there = all_over[places, : COUNTS[degree]]
    basis, triangle = factorised(there)
    degree = seen_degree(triangle, degree, len(places))
    if degree == 0:
        return None
    m, scale = COUNTS[degree], 0.5 * pitch * cols
    if m < len(triangle):
        there, basis = there[:, :m].copy(), basis[:, :m].copy()
    at_x, at_y = float(x[places].mean()), float(y[places].mean())
    derive = derivative_rows(at_x, at_y, degree) * _units(scale)
    inverse = np.linalg.inv(triangle[:m, :m])
    outer = np.concatenate([inverse, derive @ inverse])
    return Design(places, (at_x * scale, at_y * scale), scale, there, basis, derive, outer)


def largest_degree(count: float) -> int:
    """The degree that so many taxels can bear; 0 if not even a plane."""
    return next((degree for least, degree in DEGREES if count >= least), 0)


@cache
def _whole_pad(rows: int, cols: int) -> tuple[Floats, Floats, Floats]:
    """Places (n,) of all taxels, in halves of the pad's width, and their monomials."""
    row, col = np.divmod(np.arange(rows * cols), cols)
    x, y = (2.0 * col - (cols - 1)) / cols, (2.0 * row - (rows - 1)) / cols
    return x, y, monomials(x, y, len(COUNTS) - 1)


@cache
def _units(scale: float) -> Floats:
    """Units of the height and the five derivatives, (6, 1)."""
    return np.array([[scale**-power] for power in (0, 1, 1, 2, 2, 2)])


def factorised(matrix: Floats) -> tuple[Floats, Floats]:
    """Q and R; LAPACK is twice as fast on columns that lie together."""
    basis, triangle = np.linalg.qr(np.asfortranarray(matrix))
    return basis, triangle


def seen_degree(triangle: Floats, degree: int, count: float) -> int:
    """The highest degree all of whose monomials the taxels tell apart; 0 if not even a plane."""
    seen = np.abs(triangle.diagonal()) > DEPENDENT * math.sqrt(count)
    while degree and not seen[: COUNTS[degree]].all():
        degree -= 1
    return degree
