"""Laws of the recognition of stored objects by their features."""

import numpy as np
import pytest

from palpate.core import recognition
from palpate.core.recognition import FEATURES, NONE, Scatter, object_models, recognise

COUNT = len(FEATURES)
DEVIATIONS = np.where([one.kind == "count" for one in FEATURES], 0.3, 0.02)
OBJECTS = ("cup", "mug", "jug")


def scatters(names=OBJECTS, copies: int = 120, apart: float = 6.0) -> dict[str, Scatter]:
    """Normal features; the means of the first three differ by `apart` deviations."""
    rng = np.random.default_rng(0)
    mixed = np.eye(COUNT) + 0.05 * rng.normal(size=(COUNT, COUNT))
    samples = {}
    for number, name in enumerate(names):
        middle = np.where(np.arange(COUNT) < 3, apart * number * DEVIATIONS, 0.0)
        vectors = middle + rng.normal(size=(copies, COUNT)) @ mixed * DEVIATIONS
        samples[name] = Scatter(vectors, np.full(COUNT, 1.0))
    return samples


MODELS = object_models(scatters())


def test_object_is_recognised_by_its_mean():
    for name, mean in zip(MODELS.names, MODELS.means, strict=True):
        assert np.allclose(mean, scatters()[name].vectors.mean(axis=0), rtol=0, atol=1e-14)
        result = recognise(mean, MODELS)
        assert (result.name, result.nearest) == (name, name)
        assert result.distance == pytest.approx(0.0, abs=1e-9)
        assert next(iter(result.probabilities)) == name and result.probabilities[name] > 0.99
    alone: recognition.ObjectModels = object_models(scatters(names=("cup",)))
    assert recognise(alone.means[0], alone).runner_up is None
    assert recognise(MODELS.means[0] + 0.1 * DEVIATIONS, MODELS).runner_up == "mug"
    # Nearly equal copies have minimal deviations.
    rough = 1e-9 * np.random.default_rng(0).normal(size=(6, COUNT))
    models = object_models({"cup": Scatter(rough, np.zeros(COUNT))})
    assert (models.deviations >= 0.002).all()
    assert np.isfinite(recognise(rough[0] + 1e-3, models).distance)


@pytest.mark.parametrize("far", [0.0, 0.5, 2.0, 50.0])
def test_probabilities_follow_bayes_rule(far):
    uncertainty = 3e-4
    features = MODELS.means[0] + far * DEVIATIONS
    result = recognise(features, MODELS, uncertainty)
    likely = [*result.probabilities.values()]
    assert sum(likely) == pytest.approx(1.0, abs=1e-12) and likely == sorted(likely, reverse=True)
    assert set(result.probabilities) == {*OBJECTS, NONE}
    # Odds are ratios of normal densities, with squared distances divided by the scale.
    exponents = {}
    for i, name in enumerate(OBJECTS):
        deviation = MODELS.deviations[i] * np.sqrt(1.0 + (uncertainty / 1.5e-4) ** 2)
        shift = uncertainty * MODELS.slopes[i]
        covariance = MODELS.correlation * np.outer(deviation, deviation) + np.outer(shift, shift)
        offset = features - MODELS.means[i]
        square = offset @ np.linalg.solve(covariance, offset) / MODELS.scale
        exponents[name] = -0.5 * (square + np.linalg.slogdet(covariance)[1])
        if name == result.nearest:
            assert result.distance == pytest.approx(square)
    best = max(exponents, key=exponents.__getitem__)
    assert result.nearest == best and (result.name == NONE) == (result.distance > result.limit)
    for name in OBJECTS:
        wanted = result.probabilities[best] * np.exp(exponents[name] - exponents[best])
        assert result.probabilities[name] == pytest.approx(wanted, rel=1e-6, abs=1e-300)


def test_unknown_object_is_rejected():
    features = MODELS.means[1] + np.where(np.abs(np.arange(COUNT) - 14.5) < 5, 15 * DEVIATIONS, 0)
    result = recognise(features, MODELS)
    assert result.name == NONE and result.nearest in OBJECTS
    assert result.distance > result.limit and result.probabilities[NONE] > 0.99


def test_object_and_none_are_equally_likely_at_limit():
    step = DEVIATIONS * (np.arange(COUNT) == 12)

    def at(far: float) -> recognition.Recognition:
        return recognise(MODELS.means[0] + far * step, MODELS)

    low, high = 0.0, 100.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if at(middle).name != NONE else (low, middle)
    edge = at(low)
    assert edge.distance == pytest.approx(edge.limit, rel=1e-9)
    assert edge.probabilities[NONE] == pytest.approx(edge.probabilities["cup"], rel=1e-6)


def test_about_one_in_hundred_copies_is_rejected():
    fresh = [one.vectors[120:] for one in scatters(copies=700).values()]  # other copies
    rejected = [recognise(one, MODELS, 0.0).name == NONE for one in np.concatenate(fresh)[::2]]
    assert len(rejected) == 870 and 0.0005 <= np.mean(rejected) <= 0.03


def test_differences_come_largest_first():
    pairs = recognition.differences(MODELS.means[0], MODELS, "jug")
    assert len(pairs) == COUNT
    assert {one.name for one in pairs[:3]} == {one.name for one in FEATURES[:3]}
    sizes = [abs(one.deviations) for one in pairs]
    assert sizes == sorted(sizes, reverse=True)
    i = [one.name for one in FEATURES].index(pairs[0].name)
    assert (pairs[0].measured, pairs[0].stored) == (MODELS.means[0, i], MODELS.means[2, i])
    deviation = np.hypot(MODELS.deviations[2, i] * np.sqrt(1 + (2 / 3) ** 2), 1e-4)
    assert pairs[0].deviations == pytest.approx(
        (MODELS.means[0, i] - MODELS.means[2, i]) / deviation
    )


@pytest.mark.parametrize(("call", "words"), [
    (lambda: object_models({}), "there must be an object, and 4 copies of each"),
    (lambda: object_models(scatters(copies=3)), "4 copies of each"),
    (lambda: recognise(MODELS.means[0], MODELS, -1.0), "uncertainty must be 0 or more"),
    (lambda: recognise(MODELS.means[0], MODELS, np.inf), "uncertainty must be 0 or more"),
    (lambda: recognition.differences(MODELS.means[0], MODELS, "pot"), "tuple"),
])  # fmt: skip
def test_invalid_input_raises(call, words):
    with pytest.raises(ValueError, match=words):
        call()
