"""Which of the stored objects a description is of, with its probability, or none of them.

Each object is a normal distribution of features: their mean over copies of it, and as covariance
the scatter of the copies plus what the measured surface itself is uncertain by. The probability of
each follows from Bayes' rule, all being as likely before. A description that is farther from the
most likely object than all but one in a hundred copies would be, is of none of them: a test of
chi-square, its scale and degrees of freedom matched to distances of copies that were held out,
since features are not quite normal. `NONE` counts as an object just as far as this lets pass.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, not_negative
from palpate.core.recognition.description import FEATURES
from palpate.core.recognition.scatter import LEARNED_NOISE, Scatter

NONE = "none of them"
LEVEL = 0.01  # Probability that a stored object is taken for none of them
# Uncertainty of a surface of which nothing is known, m: a tenth of a millimetre is soon lost.
UNCERTAINTY = 1e-4
LEAST_COPIES = 4
FOLDS = 4  # In which copies are held out, to see how far they lie from the others
# Deviations that each feature has at least, by its kind.
LEAST_DEVIATIONS = {
    "log volume": 0.003, "log area": 0.003, "log length": 0.002,
    "share": 0.003, "angle": 0.02, "count": 0.2,
}  # fmt: skip


class ObjectModels(NamedTuple):
    """How the stored objects' features are distributed."""

    names: tuple[str, ...]
    means: Floats  # (n, k)
    deviations: Floats  # Standard deviations over copies, (n, k)
    correlation: Floats  # Of the features within objects, (k, k)
    slopes: Floats  # Changes of the features by how far a surface stands off, (n, k), 1/m
    scale: float  # Of a squared distance, in units of chi-square
    freedom: float  # Degrees of freedom of that


def object_models(scatters: Mapping[str, Scatter]) -> ObjectModels:
    """Distributions of features from the copies of each object, by its name.

    Raises ValueError if there is no object, or one has fewer than 4 copies.
    """
    if not scatters or min(len(one.vectors) for one in scatters.values()) < LEAST_COPIES:
        raise ValueError(f"there must be an object, and {LEAST_COPIES} copies of each")
    vectors = [one.vectors for one in scatters.values()]
    squares = np.concatenate([_held_out(vectors, fold) for fold in range(FOLDS)])
    scale, freedom = _matched(squares)
    slopes = np.array([one.slopes for one in scatters.values()])
    means, deviations, correlation = _distribution(vectors)
    return ObjectModels(tuple(scatters), means, deviations, correlation, slopes, scale, freedom)


def _matched(squares: Floats) -> tuple[float, float]:
    """Scale and degrees of freedom of a chi-square of the median and tail that squares have.

    Not of their mean and variance: one copy in some hundred is described altogether otherwise.
    """
    from scipy.optimize import brentq
    from scipy.special import chdtri

    middle, tail = np.quantile(squares, [0.5, 1.0 - LEVEL]).tolist()

    def steeper(freedom: float) -> float:
        return float(chdtri(freedom, LEVEL) / chdtri(freedom, 0.5) - tail / middle)

    low, high = 0.5, 200.0
    if steeper(low) <= 0.0 or steeper(high) >= 0.0:
        freedom = low if steeper(low) <= 0.0 else high
    else:
        freedom = float(brentq(steeper, low, high))
    return float(tail / chdtri(freedom, LEVEL)), freedom


def _held_out(vectors: list[Floats], fold: int) -> Floats:
    """Squared distances of every fourth copy from what the other copies tell."""
    kept = [np.delete(one, np.s_[fold::FOLDS], axis=0) for one in vectors]
    means, deviations, correlation = _distribution(kept)
    parts = zip(vectors, means, deviations, strict=True)
    stacked = np.concatenate([(one[fold::FOLDS] - mean) / off for one, mean, off in parts])
    return np.asarray(np.einsum("nk,kn->n", stacked, np.linalg.solve(correlation, stacked.T)))


def _distribution(vectors: list[Floats]) -> tuple[Floats, Floats, Floats]:
    """Means and deviations (n, k), and correlation (k, k), of objects' copies, each (c, k)."""
    means = np.array([one.mean(axis=0) for one in vectors])
    spread = np.array([one.std(axis=0, ddof=1) for one in vectors])
    least = np.array([LEAST_DEVIATIONS[one.kind] for one in FEATURES])
    least = np.maximum(least, 0.3 * np.median(spread, axis=0))  # A share of what all have
    deviations = np.sqrt(spread**2 + least**2)
    parts = zip(vectors, means, deviations, strict=True)
    away = np.concatenate([(one - mean) / deviation for one, mean, deviation in parts])
    # Shrunk by a tenth towards none
    correlation = (1.0 - 0.1) * away.T @ away / (len(away) - len(vectors))
    correlation[np.diag_indices(len(FEATURES))] = 1.0
    return means, deviations, correlation


class Recognition(NamedTuple):
    """Which object a description is of."""

    name: str  # The most likely of the objects, or `NONE`
    probabilities: dict[str, float]  # Of each object and of `NONE`, the largest first; in sum 1
    nearest: str  # The most likely of the objects, whatever the test says
    distance: float  # Square of the distance from it, in units of chi-square
    limit: float  # The largest that the test lets pass
    runner_up: str | None  # The next likely of the objects; None if there is just one


def recognise(
    features: Floats, models: ObjectModels, uncertainty: float = UNCERTAINTY
) -> Recognition:
    """The stored object that features (k,) are of, or none of them.

    `uncertainty`: standard deviation of the surface along its normals, m: it widens the scatter as
    noise would, and lets the whole surface stand off by as much. Raises ValueError if it is
    negative or infinite.
    """
    from scipy.special import chdtri

    not_negative("uncertainty", uncertainty, "m")
    each = range(len(models.names))
    squares, logs = np.array([_distance(features, models, i, uncertainty) for i in each]).T
    weights = -0.5 * (squares + logs)
    order = np.argsort(-weights, kind="stable")
    best = int(order[0])
    limit = float(chdtri(models.freedom, LEVEL))
    weights = np.append(weights, -0.5 * (limit + logs[best]))
    likely = np.exp(weights - weights.max())
    likely /= likely.sum()
    names = (*models.names, NONE)
    found = sorted(zip(names, likely.tolist(), strict=True), key=lambda one: -one[1])
    return Recognition(
        name=models.names[best] if squares[best] <= limit else NONE,
        probabilities=dict(found),
        nearest=models.names[best],
        distance=float(squares[best]),
        limit=limit,
        runner_up=models.names[order[1]] if len(order) > 1 else None,
    )


def _distance(
    features: Floats, models: ObjectModels, which: int, uncertainty: float
) -> tuple[float, float]:
    """Squared distance from an object in units of chi-square, and log determinant."""
    deviation = _deviation(models, which, uncertainty)
    away = (features - models.means[which]) / deviation
    off = uncertainty * models.slopes[which] / deviation
    covariance = models.correlation + np.outer(off, off)
    square = float(away @ np.linalg.solve(covariance, away)) / models.scale
    log = float(np.linalg.slogdet(covariance)[1]) + 2.0 * float(np.log(deviation).sum())
    return square, log


def _deviation(models: ObjectModels, which: int, uncertainty: float) -> Floats:
    """Standard deviations (k,) of an object's features in a surface that is uncertain."""
    widened = np.sqrt(1.0 + (uncertainty / LEARNED_NOISE) ** 2)
    return np.asarray(models.deviations[which] * widened)


class Difference(NamedTuple):
    """One feature, here and in an object."""

    name: str
    kind: str  # See `ShapeFeature`
    measured: float
    stored: float
    deviations: float  # By how many standard deviations they differ


def differences(
    features: Floats, models: ObjectModels, name: str, uncertainty: float = UNCERTAINTY
) -> list[Difference]:
    """How features (k,) differ from those of an object, the largest difference first."""
    which = models.names.index(name)
    off = uncertainty * models.slopes[which]
    total = np.hypot(_deviation(models, which, uncertainty), off)
    away = (features - models.means[which]) / total
    rows = zip(
        FEATURES, features.tolist(), models.means[which].tolist(), away.tolist(), strict=True
    )
    found = [Difference(one.name, one.kind, *numbers) for one, *numbers in rows]
    return [found[i] for i in np.argsort(-np.abs(away), kind="stable")]
