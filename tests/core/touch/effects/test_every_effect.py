"""What holds for all effects alike, and how they are found by name."""

import math
import re
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from palpate.core.plugins import ranges_of
from palpate.core.touch import Phase, Pipeline, SimulatedTouch, assemble
from palpate.core.touch.effects import EFFECT_NAMES, effect_type, rank
from tests.core.touch.touches import above, finger, touch, values

EACH = pytest.mark.parametrize("name", EFFECT_NAMES)
NUMBERS = [
    (name, field, allowed)
    for name in EFFECT_NAMES
    for field, allowed in ranges_of(effect_type(name)).items()
]
# Parameters with which an effect has none.
NOTHING: dict[str, dict[str, Any]] = {
    "pose_error": {"sigma": 0.0, "rotation": 0.0},
    "arm_backlash": {"width": 0.0},
    "hardening": {"strength": 0.0},
    "saturation": {"share": 0.95},
    "creep": {"share": 0.0},
    "temperature": {"rise": 0.0},
    "echo_loss": {"threshold": 0.0},
    "crosstalk": {"share": 0.0},
    "gain_offset": {"sigma_gain": 0.0, "sigma_offset": 0.0},
    "drift": {"rate": 0.0},
    "gaussian_noise": {"sigma": 0.0},
    "salt_and_pepper": {"rate": 0.0},
    "dead_taxels": {"rate": 0.0},
    "transport": {"latency": 0.0, "drop": 0.0, "duplicate": 0.0},
}


def series(pipeline: Pipeline) -> list[SimulatedTouch]:
    """Two hits, a miss, a press to the bottom and a start inside, simulated in turn."""
    outcomes: list[dict[str, Any]] = [{}, {"reach": 1e-3}, {"depth": 2.9e-3}, {"depth": 0.4e-3}]
    outcomes.append({"actual": above(0.0), "believed": above(0.0)})
    touches, states = [], pipeline.begin()
    for number, options in enumerate(outcomes):
        times = {"previous": 10.0 * number, "begun": 10.0 * number + 0.5}
        touches.append(touch(number, **times, **options))
        states = pipeline.simulate(touches[-1], states)
    return touches


def test_catalogue_is_in_order_of_phase():
    phases = [effect_type(name).phase for name in EFFECT_NAMES]
    assert phases == sorted(phases) and set(phases) == set(Phase)
    assert [rank(name) for name in EFFECT_NAMES] == list(range(len(EFFECT_NAMES)))
    assert rank("module:Class") == len(EFFECT_NAMES)  # a user's own comes last


@pytest.mark.parametrize(("name", "field", "allowed"), NUMBERS)
def test_ends_of_a_range_give_finite_touches_and_what_is_outside_is_refused(name, field, allowed):
    margin = max(1.0, abs(allowed.high))
    for value in (allowed.low - margin, allowed.high + margin, math.nan, math.inf):
        words = f"^{field} is .*; expected {re.escape(str(allowed))}"
        with pytest.raises(ValueError, match=words):
            effect_type(name)(**{field: value})
    for value in (allowed.low, allowed.high):
        options = {field: int(value) if allowed.unit == "1" and value > 1 else value}
        if field == "stuck":
            options["rate"] = 0.0  # the two are shares of the same taxels
        for contact in series(assemble(finger(), [effect_type(name)(**options)])):
            assert (contact.pressure >= 0.0).all()
            for array in (contact.reading, contact.pressure, contact.believed, contact.actual):
                assert np.isfinite(getattr(array, "array", array)).all()


@EACH
def test_stages_do_not_modify_input_arrays(name):
    pipeline = assemble(finger(), [effect_type(name)()])
    states = pipeline.begin()
    for number, depth in enumerate((1e-3, 2.9e-3, 0.4e-3)):
        contact, kept = touch(number, depth=depth), []
        for stage, state in zip(pipeline.stages, states, strict=True):
            held = [getattr(contact, field.name) for field in fields(contact)]
            for value in (*held, *(state if isinstance(state, tuple) else (state,))):
                if isinstance(value, np.ndarray):
                    value.setflags(write=False)  # a write would raise
            kept.append(stage.apply(contact, state))
        states = tuple(kept)


@EACH
def test_equal_touches_are_equal_and_without_contact_only_noise_is_read(name):
    pipeline = assemble(finger(), [effect_type(name)()])
    first, again = series(pipeline), series(pipeline)
    assert [values(one) for one in first] == [values(one) for one in again]
    for contact in first:
        if contact.outcome in ("miss", "inside"):
            assert (contact.compression == 0.0).all() and (contact.pressure == 0.0).all()
            assert np.median(np.abs(contact.reading)) < 50e-6


@pytest.mark.parametrize("name", NOTHING)
def test_effect_without_strength_changes_nothing(name):
    tip = finger(dome=1 / 0.015)
    pipeline = assemble(tip, [effect_type(name)(**NOTHING[name])])
    ideal = series(assemble(tip, []))
    assert pipeline.noise == 0.0
    assert [values(one) for one in series(pipeline)] == [values(one) for one in ideal]
    assert {contact.outcome for contact in ideal} >= {"miss", "inside", "hit"}


@pytest.mark.parametrize("rows_cols", [(8, 20), (20, 8), (13, 13)])
@EACH
def test_arrays_need_not_be_square_or_even(name, rows_cols):
    tip = finger(rows=rows_cols[0], cols=rows_cols[1], pitch=0.8e-3)
    contact = series(assemble(tip, [effect_type(name)()]))[0]
    assert contact.outcome == "hit" and contact.reading.shape == contact.pressure.shape == rows_cols


@pytest.mark.parametrize(
    ("name", "parameters", "signal", "words"),
    [
        ("aperture", {"reading": "median"}, "time", "reading is 'median'; expected mean or max"),
        ("dead_taxels", {"rate": 0.6, "stuck": 0.5}, "time", r"are 1\.1 together; expected 0 to 1"),
        ("quantisation", {"clock": 2e7, "bits": 8}, "time", r"clock is 2e\+07 Hz and bits is 8"),
        ("quantisation", {}, "force", "signal is force; expected bits"),
        ("quantisation", {"clock": 20e6}, "force", "signal is force; expected bits"),
        ("temperature", {}, "force", "signal is force; expected time"),
        ("echo_loss", {}, "force", "signal is force; expected time"),
        ("temperature", {"rise": 60.0, "coefficient": -10.0}, "time", "is -600 m/s; expected more"),
        ("temperature", {"rise": 50.0, "coefficient": -10.0}, "time", "is -500 m/s; expected more"),
    ],
)
def test_invalid_parameter_combinations_are_refused(name, parameters, signal, words):
    with pytest.raises(ValueError, match=words):
        effect_type(name)(**parameters).prepare(finger(signal))


@pytest.mark.parametrize(
    ("name", "error", "words"),
    [
        ("noise", LookupError, "there is no effect 'noise'"),
        ("no.such:Effect", ValueError, r"'no\.such:Effect' cannot be imported"),
        ("math:pi", ValueError, "'math:pi' is no effect: 'pi' must be a dataclass with prepare"),
        ("fractions:Fraction", ValueError, "must be a dataclass"),
    ],
)
def test_invalid_effect_classes_are_refused(name, error, words):
    with pytest.raises(error, match=words):
        effect_type(name)
