from __future__ import annotations

import numpy as np
import pytest

from palpate.core.recognition import (
    FEATURES,
    NONE,
    Scatter,
    differences,
    object_models,
    recognise,
)

COUNT = len(FEATURES)
KINDS = np.array([one.kind for one in FEATURES])
DEVIATIONS = np.where(KINDS == "count", 0.3, 0.02)


def scatters(names=("cup", "mug", "jug"), copies=120, apart=6.0, seed=0):
    """Objects whose features are normal, `apart` of their deviations from each other in three."""
    rng = np.random.default_rng(seed)
    mixed = np.eye(COUNT) + 0.05 * rng.normal(size=(COUNT, COUNT))
    found = {}
    for number, name in enumerate(names):
        middle = np.zeros(COUNT)
        middle[:3] = apart * number * DEVIATIONS[:3]
        vectors = middle + rng.normal(size=(copies, COUNT)) @ mixed * DEVIATIONS
        found[name] = Scatter(vectors, np.full(COUNT, 1.0))
    return found


MODELS = object_models(scatters())


def test_each_object_is_recognised_by_its_own_mean():
    for name, mean in zip(MODELS.names, MODELS.means, strict=True):
        found = recognise(mean, MODELS)
        assert (found.name, found.nearest) == (name, name)
        assert found.distance == pytest.approx(0.0, abs=1e-9)
        assert next(iter(found.probabilities)) == name
        assert found.probabilities[name] > 0.99


@pytest.mark.parametrize("far", [0.0, 0.5, 2.0, 50.0])
def test_probabilities_sum_to_one_with_none_of_them_among_them(far):
    features = MODELS.means[0] + far * DEVIATIONS
    found = recognise(features, MODELS)
    assert sum(found.probabilities.values()) == pytest.approx(1.0, abs=1e-12)
    assert set(found.probabilities) == {*MODELS.names, NONE}
    likely = [*found.probabilities.values()]
    assert likely == sorted(likely, reverse=True)


def test_an_unknown_object_is_none_of_them_and_never_the_nearest():
    features = MODELS.means[1].copy()
    features[10:20] += 15.0 * DEVIATIONS[10:20]
    found = recognise(features, MODELS)
    assert found.name == NONE
    assert found.nearest in MODELS.names
    assert found.distance > found.limit
    assert found.probabilities[NONE] > 0.99


def test_where_the_test_just_passes_the_odds_are_even():
    way = np.zeros(COUNT)
    way[12] = DEVIATIONS[12]

    def at(far):
        return recognise(MODELS.means[0] + far * way, MODELS)

    low, high = 0.0, 100.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if at(middle).name != NONE else (low, middle)
    inside = at(low)
    assert inside.distance == pytest.approx(inside.limit, rel=1e-9)
    assert inside.probabilities[NONE] == pytest.approx(inside.probabilities["cup"], rel=1e-6)


def test_one_in_a_hundred_copies_is_falsely_rejected():
    fresh = scatters(copies=700, seed=0)  # the same distributions, other copies
    rejected = [
        recognise(vector, MODELS, 0.0).name == NONE
        for one in fresh.values()
        for vector in one.vectors[120:]
    ]
    assert len(rejected) == 1740
    assert 0.0005 <= np.mean(rejected) <= 0.03


def test_uncertainty_lets_pass_what_is_certain_to_be_another():
    features = MODELS.means[2] + 3.0 * DEVIATIONS
    distances = [recognise(features, MODELS, one).distance for one in (0.0, 1e-4, 3e-4, 1e-3)]
    assert (np.diff(distances) < 0.0).all()
    assert recognise(features, MODELS, 0.0).name == NONE
    assert recognise(features, MODELS, 1e-3).name == "jug"


def test_the_features_that_differ_most_are_told_first():
    found = differences(MODELS.means[0], MODELS, "jug")
    assert {one.name for one in found[:3]} == {one.name for one in FEATURES[:3]}
    sizes = [abs(one.deviations) for one in found]
    assert sizes == sorted(sizes, reverse=True)
    assert len(found) == COUNT
    first = found[0]
    i = [one.name for one in FEATURES].index(first.name)
    assert (first.measured, first.stored) == (MODELS.means[0, i], MODELS.means[2, i])


def test_a_single_object_has_no_runner_up():
    models = object_models(scatters(names=("cup",)))
    assert recognise(models.means[0], models).runner_up is None


def test_copies_that_are_all_the_same_still_leave_room():
    vectors = np.tile(np.linspace(0.0, 1.0, COUNT), (6, 1))
    noisy = vectors + 1e-9 * np.random.default_rng(0).normal(size=vectors.shape)
    models = object_models({"cup": Scatter(noisy, np.zeros(COUNT))})
    assert (models.deviations >= 0.002).all()
    assert np.isfinite(recognise(vectors[0], models).distance)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: object_models({}), "there must be an object, and 4 copies of each"),
        (lambda: object_models(scatters(copies=3)), "4 copies of each"),
        (lambda: recognise(MODELS.means[0], MODELS, -1.0), "uncertainty must be 0 or more"),
        (lambda: recognise(MODELS.means[0], MODELS, np.inf), "uncertainty must be 0 or more"),
        (lambda: differences(MODELS.means[0], MODELS, "pot"), "tuple"),
    ],
)
def test_bad_arguments_are_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()
