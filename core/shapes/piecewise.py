"""Curves through given values, as pieces of straight lines or cubics, with bounds over them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints


class PiecewiseCubic(NamedTuple):
    """A function of one number in pieces a + b u + c u^2 + d u^3, u from the piece's begin."""

    knots: Floats
    """(n + 1,), increasing."""
    coefficients: Floats
    """(4, n)."""

    def piece(self, places: Floats) -> Ints:
        """Piece in which each place lies, or which is nearest to it."""
        found = np.searchsorted(self.knots, places, side="right") - 1
        return np.clip(found, 0, len(self.knots) - 2).astype(np.int32)

    def at(self, places: Floats, piece: Ints) -> tuple[Floats, Floats, Floats]:
        """Value and the first two derivatives of given pieces, carried on beyond their ends."""
        u = places - self.knots[piece]
        a, b, c, d = self.coefficients[:, piece]
        return a + u * (b + u * (c + u * d)), b + u * (2 * c + u * 3 * d), 2 * c + 6 * d * u

    def extremes(self) -> tuple[Floats, Floats]:
        """Places inside the pieces at which the function has an extreme, and its values there."""
        _, b, c, d = self.coefficients
        root = np.sqrt(np.maximum(c * c - 3 * b * d, 0.0))
        turned = -(c + np.copysign(root, c))  # the larger root first, without cancellation
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.stack([turned / (3 * d), b / turned])
        width = np.diff(self.knots)
        piece = np.nonzero((u > 0.0) & (u < width))
        places = self.knots[piece[1]] + u[piece]
        return places, self.at(places, piece[1].astype(np.int32))[0]

    def value_range(self) -> tuple[float, float]:
        """Least and largest value from the first knot to the last."""
        ends = self.at(self.knots, self.piece(self.knots))[0]
        values = np.concatenate([ends, self.extremes()[1]])
        return float(values.min()), float(values.max())


def straight_pieces(knots: Floats, values: Floats) -> PiecewiseCubic:
    """Straight lines through values (n,) at increasing knots (n,)."""
    slopes = np.diff(values) / np.diff(knots)
    none = np.zeros_like(slopes)
    return PiecewiseCubic(knots, np.stack([values[:-1], slopes, none, none]))


def natural_spline(knots: Floats, values: Floats) -> PiecewiseCubic:
    """The cubic spline through values (n,) that does not bend at its ends."""
    width = np.diff(knots)
    matrix = np.eye(len(knots))
    inner = np.arange(1, len(knots) - 1)
    matrix[inner, inner - 1], matrix[inner, inner + 1] = width[:-1], width[1:]
    matrix[inner, inner] = 2 * (width[:-1] + width[1:])
    turn = np.zeros(len(knots))
    turn[1:-1] = 6 * np.diff(np.diff(values) / width)
    return _from_bends(knots, values, np.asarray(np.linalg.solve(matrix, turn), np.float64))


def periodic_spline(knots: Floats, values: Floats) -> PiecewiseCubic:
    """The cubic spline through values (n,) at evenly spaced knots (n + 1,), the last the first."""
    count, width = len(values), float(knots[1] - knots[0])
    matrix = 4 * np.eye(count)
    every = np.arange(count)
    np.add.at(matrix, (every, (every + 1) % count), 1.0)
    np.add.at(matrix, (every, every - 1), 1.0)
    second = np.roll(values, -1) - 2 * values + np.roll(values, 1)
    turn = np.asarray(6 * second / width**2, np.float64)
    bends = np.asarray(np.linalg.solve(matrix, turn), np.float64)
    return _from_bends(
        knots, np.concatenate([values, values[:1]]), np.concatenate([bends, bends[:1]])
    )


def _from_bends(knots: Floats, values: Floats, bends: Floats) -> PiecewiseCubic:
    """Pieces from the values and the second derivatives at the knots."""
    width = np.diff(knots)
    slope = np.diff(values) / width - width * (2 * bends[:-1] + bends[1:]) / 6
    return PiecewiseCubic(
        knots, np.stack([values[:-1], slope, bends[:-1] / 2, np.diff(bends) / (6 * width)])
    )
