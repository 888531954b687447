"""The side surface as a spline, fitted to every felt taxel at once.

The squared distance q from the axis is a tensor product of a spline along the height and a
periodic one around: squared, because q of an ellipsoid is a parabola with finite slope at the
poles, where the distance itself rises with an infinite one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import kron

from palpate.core.arrays import Floats
from palpate.core.rebuild.felt.along import SPANS, along_basis, bending_root, even_spans
from palpate.core.rebuild.felt.felt_points import FeltPoints
from palpate.core.rebuild.felt.side_rows import SideRows, side_rows, tensor_rows
from palpate.core.rebuild.felt.side_system import SideSystem, side_system
from palpate.core.rebuild.felt.spine import Spine
from palpate.core.splines.basis import PeriodicBasis

AROUND = 96
"""Coefficients around."""
FELT, UNFELT = 1e-3, 1e-2
"""Strength of bending along, where the side was felt all around and where it was not: there so
strong that what lies farther off bridges the gap, not the last points before it alone."""
BESIDE = 2
"""Spans between knots on either side of one that was not felt for which the same holds."""
SECTORS, HOLES = 24, 0.1
"""Parts of a turn, and the share of them that may be without a point in a span that was felt."""
BENDING_AROUND = 1e-2
"""Strength of bending around."""
LEAST = 1e-6
"""Smallest squared distance ever given, over that of the median."""
STIFFER, MOST_STIFFER = 10.0, 5
"""Steps by which the bending is made to cost more where there is noise, and how many at most."""
UNBENT = 6
"""Coefficients' combinations that do not bend."""
PROBES = 2
"""Random signs by which the freedom is estimated."""
LEAST_SPARE = 0.05
"""Least share of the points' freedom that is taken as left."""
MEDIAN = 0.6745
"""Median size of an error of deviation 1."""


@dataclass(frozen=True, slots=True, eq=False)
class FeltSkin:
    """A fitted side surface."""

    spine: Spine
    """Axis from which distances are taken."""
    low: float
    """Height at which the spline begins, m."""
    high: float
    """Height at which it ends, m."""
    coefficients: Floats
    """(along, around), m^2."""
    middle: float
    """Median distance of the points from the axis, m."""
    rows: SideRows
    """What it was fitted to."""
    system: SideSystem
    """The system it solves."""
    stiffness: float
    """Times the strengths of bending."""

    def squared(self, heights: Floats, turns: Floats) -> Floats:
        """Squared distance from the axis on a grid, (heights, turns), m^2."""
        along = along_basis().matrix(self._local(heights))
        around = PeriodicBasis(AROUND).matrix(turns)
        squared = (around @ (along @ self.coefficients).T).T
        return np.asarray(np.maximum(squared, LEAST * self.middle**2))

    def rings(self, heights: Floats, turns: Floats) -> Floats:
        """Places on a grid, (heights, turns, 2), m."""
        angle = 2.0 * np.pi * turns
        rim = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        radius = np.sqrt(self.squared(heights, turns))
        return np.asarray(self.spine.at(heights)[:, None] + radius[..., None] * rim)

    def misfits(self) -> Floats:
        """Distances (n,) of the points along their normals, m."""
        return np.asarray(self.rows.target - self.rows.matrix @ self.coefficients.ravel())

    @property
    def freedom(self) -> float:
        """Degrees of freedom spent, estimated with random signs (Hutchinson, 1989)."""
        rng = np.random.default_rng(0)
        signs = rng.choice([-1.0, 1.0], (PROBES, len(self.rows.target)))
        seen = [self.rows.matrix.T @ sign for sign in signs]
        return float(np.mean([one @ self.system.solve(one) for one in seen]))

    @property
    def sigma(self) -> float:
        """Standard deviation of a point, from the median misfit and the freedom spent, m."""
        spare = max(1.0 - self.freedom / len(self.rows.target), LEAST_SPARE)
        return float(np.median(np.abs(self.misfits()))) / MEDIAN / float(np.sqrt(spare))

    @property
    def score(self) -> float:
        """Restricted likelihood of the stiffness, but for what it has in common with others.

        Twice its negative logarithm (Wahba, *A comparison of GCV and GML*, 1985).
        """
        rows, flat = self.rows, self.coefficients.ravel()
        square = rows.target @ self.misfits()
        count, size = len(rows.target) - UNBENT, len(flat) - UNBENT
        bends = size * np.log(self.stiffness)
        return float(count * np.log(square) + self.system.log_determinant - bends)

    def deviation(self, heights: Floats, turns: Floats) -> Floats:
        """Standard deviation of the surface across its rings on a grid, (heights, turns), m.

        The posterior of the penalised fit (Wahba, *Bayesian confidence intervals*, 1983):
        noise and what the penalty lets move, not features narrower than the knots.
        """
        along = along_basis().matrix(self._local(heights))
        rows = kron(along, PeriodicBasis(AROUND).matrix(turns)).toarray()
        spread = self.system.spread(rows).reshape(len(heights), len(turns))
        square = np.mean(self.misfits() ** 2) / max(
            1.0 - self.freedom / len(self.rows.target), LEAST_SPARE
        )
        # What one standard deviation more of the squared distance adds: spread over twice the
        # distance, but finite where the surface runs through the axis.
        squared = self.squared(heights, turns)
        more = np.sqrt(square) * spread
        return np.asarray(more / (np.sqrt(squared + more) + np.sqrt(squared)))

    def _local(self, heights: Floats) -> Floats:
        local: Floats = np.clip((heights - self.low) / (self.high - self.low), 0.0, 1.0)
        return local


def fit_skin(
    felt: FeltPoints, spine: Spine, low: float, high: float, stiffness: float = 1.0
) -> FeltSkin:
    """Fit the side surface between two heights to felt points.

    Parameters
    ----------
    felt : FeltPoints
        With normals; those outside the heights, or on level faces, are left out.
    spine : Spine
        The axis.
    low, high : float
        Heights, m.
    stiffness : float
        How much more bending costs than it does without noise.

    Raises
    ------
    ValueError
        If no point is left.
    """
    along, around = along_basis(), PeriodicBasis(AROUND)
    rows = side_rows(felt, spine, low, high, along, around)
    bending = stiffness * _strengths(rows.places), bending_root()
    system = side_system(rows.matrix, AROUND, bending, stiffness * BENDING_AROUND)
    found = system.solve(rows.matrix.T @ rows.target).reshape(along.count, AROUND)
    return FeltSkin(spine, low, high, found, rows.middle, rows, system, stiffness)


def calmed(felt: FeltPoints, skin: FeltSkin) -> FeltSkin:
    """The skin as stiff as its points ask for: at least as stiff as it is."""
    for _ in range(MOST_STIFFER):
        stiffer = fit_skin(felt, skin.spine, skin.low, skin.high, STIFFER * skin.stiffness)
        if not stiffer.score < skin.score:
            break
        skin = stiffer
    return skin


def _strengths(places: Floats) -> Floats:
    """Strength of bending along in each span, from the points' places (n, 2) along and around."""
    span = np.minimum((places[:, 0] * SPANS).astype(int), SPANS - 1)
    sector = (np.mod(places[:, 1], 1.0) * SECTORS).astype(int) % SECTORS
    felt = np.zeros((SPANS, SECTORS), np.bool_)
    felt[span, sector] = True
    unfelt = np.mean(~felt, axis=1) > HOLES
    near = np.convolve(unfelt, np.ones(2 * BESIDE + 1), mode="same") > 0.5
    return np.where(near, UNFELT, FELT)[even_spans()]


def with_normals(felt: FeltPoints, spine: Spine, low: float, high: float) -> FeltPoints:
    """Felt points with normals: where nobody measured them, those of a fit to the points.

    That fit takes them to be radial. Parameters and errors as of `fit_skin`.
    """
    if felt.normals is not None:
        return felt
    away = felt.points[:, :2] - spine.at(felt.points[:, 2])
    length = np.maximum(np.linalg.norm(away, axis=1, keepdims=True), np.finfo(float).tiny)
    level = np.concatenate([away / length, np.zeros((len(away), 1))], axis=1)
    first = fit_skin(felt._replace(normals=level), spine, low, high)
    return felt._replace(normals=_gradient_normals(first, felt.points))


def _gradient_normals(skin: FeltSkin, points: Floats) -> Floats:
    """Outward unit normals (n, 3) of a skin at points next to it."""
    away = points[:, :2] - skin.spine.at(points[:, 2])
    turns = np.arctan2(away[:, 1], away[:, 0]) / (2.0 * np.pi)
    local = skin._local(points[:, 2])
    flat = skin.coefficients.ravel()
    along, around = along_basis(), PeriodicBasis(AROUND)
    extent = skin.high - skin.low
    by_height = tensor_rows(along.matrix(local, 1), around.matrix(turns)) @ flat / extent
    by_turn = tensor_rows(along.matrix(local), around.matrix(turns, 1)) @ flat / (2.0 * np.pi)
    distance = np.maximum(np.linalg.norm(away, axis=1), np.finfo(float).tiny)[:, None]
    out = away / distance
    beside = np.stack([-out[:, 1], out[:, 0]], axis=-1)
    level = 2.0 * distance * out - by_turn[:, None] / distance * beside
    leaning = np.einsum("ni,ni->n", away, skin.spine.slope(points[:, 2]))
    gradient = np.column_stack([level, -2.0 * leaning - by_height])
    normals: Floats = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
    return normals
