"""Which of the stored objects a description belongs to, with its probability, or none of them.

Each object is a normal distribution of features: the mean is that of its copies, the covariance the
scatter of the copies plus the uncertainty of the measured surface. The probabilities follow from
Bayes' rule with equal priors. A description that is farther from the most likely object than 99 of
100 copies belongs to none of them. This is a chi-square test, whose scale and degrees of freedom
are fitted to the distances of held-out copies, since features are not quite normal. `NONE` has the
likelihood of an object at the limit of this test.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, not_negative
from palpate.core.recognition.description import FEATURES
from palpate.core.recognition.scatter import DEFAULT_SCATTER, Scatter

NONE = "none of them"


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchingSettings:
    """How the distributions of features are estimated, and when an object is none of them."""

    # [m] of a surface whose uncertainty is not known; no surface is taken for more certain.
    uncertainty: float = 1e-4
    learned_noise: float = DEFAULT_SCATTER.noise  # [m] of the copies
    false_rejection: float = 0.01  # probability that a stored object is taken for none of them
    n_folds: int = 4  # in which copies are held out; as many copies are needed
    min_relative_deviation: float = 0.3  # fraction of a feature's median over all objects
    correlation_shrinkage: float = 0.1  # fraction by which correlations are reduced
    # Least standard deviation of a feature, by its kind.
    min_deviations: Mapping[str, float] = field(
        default_factory=lambda: {
            "log volume": 0.003,
            "log area": 0.003,
            "log length": 0.002,
            "share": 0.003,
            "angle": 0.02,
            "count": 0.2,
        }
    )


DEFAULT_MATCHING = MatchingSettings()


class ObjectModels(NamedTuple):
    """Distributions of the stored objects' features."""

    names: tuple[str, ...]
    means: Floats  # (n, k)
    deviations: Floats  # standard deviations over copies, (n, k)
    correlation: Floats  # of the features within objects, (k, k)
    slopes: Floats  # derivatives of the features by an offset of the surface, (n, k) [1/m]
    scale: float  # of a squared distance, in units of chi-square
    freedom: float  # degrees of freedom of that chi-square


def object_models(
    scatters: Mapping[str, Scatter], settings: MatchingSettings = DEFAULT_MATCHING
) -> ObjectModels:
    """Distributions of features from the copies of each object, by its name.

    Raises ValueError if there is no object, or one has fewer than 4 copies.
    """
    n_folds = settings.n_folds
    if not scatters or min(len(scatter.vectors) for scatter in scatters.values()) < n_folds:
        raise ValueError(f"there must be an object, and {n_folds} copies of each")
    vectors = [scatter.vectors for scatter in scatters.values()]
    squares = np.concatenate([_held_out(vectors, fold, settings) for fold in range(n_folds)])
    scale, freedom = _fitted_chi_square(squares, settings.false_rejection)
    slopes = np.array([scatter.slopes for scatter in scatters.values()])
    means, deviations, correlation = _distribution(vectors, settings)
    return ObjectModels(tuple(scatters), means, deviations, correlation, slopes, scale, freedom)


def _fitted_chi_square(squares: Floats, level: float) -> tuple[float, float]:
    """Scale and degrees of freedom of a chi-square with the median of squares and their quantile.

    `level`: probability beyond that quantile. Mean and variance are not used: about one copy in a
    hundred has an entirely different description.
    """
    from scipy.optimize import brentq
    from scipy.special import chdtri

    median, tail = np.quantile(squares, [0.5, 1.0 - level]).tolist()

    def steeper(freedom: float) -> float:
        return float(chdtri(freedom, level) / chdtri(freedom, 0.5) - tail / median)

    low, high = 0.5, 200.0
    if steeper(low) <= 0.0 or steeper(high) >= 0.0:
        freedom = low if steeper(low) <= 0.0 else high
    else:
        freedom = float(brentq(steeper, low, high))
    return float(tail / chdtri(freedom, level)), freedom


def _held_out(vectors: list[Floats], fold: int, settings: MatchingSettings) -> Floats:
    """Squared distances of the copies in a fold from the distribution of all others."""
    copies = slice(fold, None, settings.n_folds)
    means, deviations, correlation = _distribution(
        [np.delete(features, copies, axis=0) for features in vectors], settings
    )
    parts = zip(vectors, means, deviations, strict=True)
    stacked = np.concatenate([(own[copies] - mean) / deviation for own, mean, deviation in parts])
    return np.asarray(np.einsum("nk,kn->n", stacked, np.linalg.solve(correlation, stacked.T)))


def _distribution(
    vectors: list[Floats], settings: MatchingSettings
) -> tuple[Floats, Floats, Floats]:
    """Means and deviations (n, k), and correlation (k, k), of objects' copies, each (c, k)."""
    means = np.array([features.mean(axis=0) for features in vectors])
    spread = np.array([features.std(axis=0, ddof=1) for features in vectors])
    least = np.array([settings.min_deviations[feature.kind] for feature in FEATURES])
    least = np.maximum(least, settings.min_relative_deviation * np.median(spread, axis=0))
    deviations = np.sqrt(spread**2 + least**2)
    parts = zip(vectors, means, deviations, strict=True)
    scaled = np.concatenate([(own - mean) / deviation for own, mean, deviation in parts])
    kept = 1.0 - settings.correlation_shrinkage
    correlation = kept * scaled.T @ scaled / (len(scaled) - len(vectors))
    correlation[np.diag_indices(len(FEATURES))] = 1.0
    return means, deviations, correlation


class Recognition(NamedTuple):
    """The object to which a description belongs."""

    name: str  # the most likely object, or `NONE`
    probabilities: dict[str, float]  # of each object and of `NONE`, the largest first; in sum 1
    nearest: str  # the most likely object, also if the test rejects it
    distance: float  # squared distance from it, in units of chi-square
    limit: float  # largest squared distance that the test accepts
    runner_up: str | None  # the second most likely object; None if there is just one


def recognise(
    features: Floats,
    models: ObjectModels,
    uncertainty: float = DEFAULT_MATCHING.uncertainty,
    settings: MatchingSettings = DEFAULT_MATCHING,
) -> Recognition:
    """The stored object to which features (k,) belong, or none of them.

    `uncertainty`: standard deviation of the surface along its normals [m]. It widens the scatter,
    as noise does, and allows for an offset of the whole surface. Raises ValueError if it is
    negative or infinite.
    """
    from scipy.special import chdtri

    not_negative("uncertainty", uncertainty, "m")
    numbers = range(len(models.names))
    distances = [_distance(features, models, i, uncertainty, settings) for i in numbers]
    squares, logs = np.array(distances).T
    weights = -0.5 * (squares + logs)
    order = np.argsort(-weights, kind="stable")
    best = int(order[0])
    limit = float(chdtri(models.freedom, settings.false_rejection))
    weights = np.append(weights, -0.5 * (limit + logs[best]))
    likelihoods = np.exp(weights - weights.max())
    likelihoods /= likelihoods.sum()
    pairs = zip((*models.names, NONE), likelihoods.tolist(), strict=True)
    return Recognition(
        name=models.names[best] if squares[best] <= limit else NONE,
        probabilities=dict(sorted(pairs, key=lambda pair: -pair[1])),
        nearest=models.names[best],
        distance=float(squares[best]),
        limit=limit,
        runner_up=models.names[order[1]] if len(order) > 1 else None,
    )


def _distance(
    features: Floats,
    models: ObjectModels,
    number: int,
    uncertainty: float,
    settings: MatchingSettings,
) -> tuple[float, float]:
    """Squared distance from an object in units of chi-square, and log determinant."""
    deviation = _deviation(models, number, uncertainty, settings)
    scaled = (features - models.means[number]) / deviation
    offset = uncertainty * models.slopes[number] / deviation
    covariance = models.correlation + np.outer(offset, offset)
    square = float(scaled @ np.linalg.solve(covariance, scaled)) / models.scale
    log = float(np.linalg.slogdet(covariance)[1]) + 2.0 * float(np.log(deviation).sum())
    return square, log


def _deviation(
    models: ObjectModels, number: int, uncertainty: float, settings: MatchingSettings
) -> Floats:
    """Standard deviations (k,) of an object's features, measured on an uncertain surface."""
    widening = np.sqrt(1.0 + (uncertainty / settings.learned_noise) ** 2)
    return np.asarray(models.deviations[number] * widening)


class Difference(NamedTuple):
    """One feature, measured and in an object."""

    name: str
    kind: str  # see `ShapeFeature`
    measured: float
    stored: float
    deviations: float  # difference in standard deviations


def differences(
    features: Floats,
    models: ObjectModels,
    name: str,
    uncertainty: float = DEFAULT_MATCHING.uncertainty,
    settings: MatchingSettings = DEFAULT_MATCHING,
) -> list[Difference]:
    """Differences of features (k,) from those of an object, the largest first."""
    number = models.names.index(name)
    offset, stored = uncertainty * models.slopes[number], models.means[number]
    total = np.hypot(_deviation(models, number, uncertainty, settings), offset)
    scaled = (features - stored) / total
    values = zip(features.tolist(), stored.tolist(), scaled.tolist(), strict=True)
    pairs = [
        Difference(feature.name, feature.kind, *numbers)
        for feature, numbers in zip(FEATURES, values, strict=True)
    ]
    return [pairs[i] for i in np.argsort(-np.abs(scaled), kind="stable")]
