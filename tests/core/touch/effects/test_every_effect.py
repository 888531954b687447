"""What holds for all effects alike."""

import ast
import math
import re
from dataclasses import fields, is_dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.core.plugins import ranges_of
from palpate.core.touch import effects
from palpate.core.touch.effects.catalogue import EFFECT_NAMES, MODULES, effect_type, rank
from palpate.core.touch.pipeline import Phase, assemble

FOLDER = Path(effects.__file__ or "").parent
# Each number of each effect.
NUMBERS = [
    (name, field, allowed)
    for name in EFFECT_NAMES
    for field, allowed in ranges_of(effect_type(name)).items()
]
# Hits, a miss, and a press to the bottom.
OUTCOMES: list[dict[str, float]] = [{}, {"reach": 1e-3}, {"depth": 2.9e-3}, {"depth": 0.4e-3}]
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


def series(make_touch):
    """Four touches, one after the other."""
    starts = [make_touch(number, **given) for number, given in enumerate(OUTCOMES)]
    for number, touch in enumerate(starts):
        touch.previous, touch.begun = 10.0 * number, 10.0 * number + 0.5
    return starts


def test_every_effect_of_the_package_is_in_the_catalogue_and_the_other_way_round():
    files = {path.stem: path for path in FOLDER.glob("*.py")}
    assert files.keys() - {"__init__", "catalogue"} == set(MODULES.values())
    classes = {
        (module, node.name)
        for module in set(MODULES.values())
        for node in ast.parse(files[module].read_text()).body
        if isinstance(node, ast.ClassDef)
    }
    kinds = [effect_type(name) for name in EFFECT_NAMES]
    assert classes == {(one.__module__.rpartition(".")[2], one.__name__) for one in kinds}


def test_the_catalogue_is_in_order_of_phase():
    phases = [effect_type(name).phase for name in EFFECT_NAMES]
    assert phases == sorted(phases)
    assert set(phases) == set(Phase)
    assert [rank(name) for name in EFFECT_NAMES] == list(range(len(EFFECT_NAMES)))


@pytest.mark.parametrize("name", EFFECT_NAMES)
def test_an_effect_is_a_frozen_value_with_defaults(name):
    kind = effect_type(name)
    assert is_dataclass(kind())
    effect = kind()
    assert effect == kind()
    assert all(field.kw_only for field in fields(kind))
    with pytest.raises(AttributeError):
        setattr(effect, fields(kind)[0].name, 0.0)
    with pytest.raises((AttributeError, TypeError)):
        effect.unknown = 0.0


@pytest.mark.parametrize("name", EFFECT_NAMES)
def test_an_effect_and_each_of_its_parameters_are_described(name):
    source = (FOLDER / f"{MODULES[name]}.py").read_text()
    (described,) = [
        node
        for node in ast.parse(source).body
        if isinstance(node, ast.ClassDef) and node.name == effect_type(name).__name__
    ]
    assert ast.get_docstring(described)
    lines = source.splitlines()
    for node in described.body:
        if isinstance(node, ast.AnnAssign) and ast.unparse(node.annotation) != "ClassVar":
            above, last = lines[node.lineno - 2], lines[(node.end_lineno or 0) - 1]
            assert above.lstrip().startswith("#") or "  # " in last, node.target


@pytest.mark.parametrize(("name", "field", "allowed"), NUMBERS)
def test_a_parameter_outside_its_range_is_refused_with_range_and_unit(name, field, allowed):
    margin = max(1.0, abs(allowed.high))
    for value in (allowed.low - margin, allowed.high + margin, math.nan, math.inf):
        with pytest.raises(ValueError, match=re.escape(f"; expected {allowed}")) as caught:
            effect_type(name)(**{field: value})
        assert str(caught.value).startswith(f"{field} is ")


@pytest.mark.parametrize(("name", "field", "allowed"), NUMBERS)
def test_the_ends_of_a_range_can_be_had(name, field, allowed, make_finger, make_touch):
    for value in (allowed.low, allowed.high):
        given = {field: int(value) if allowed.unit == "1" and value > 1 else value}
        if field == "stuck":
            given["rate"] = 0.0  # the two are shares of the same taxels
        pipeline = assemble(make_finger(), [effect_type(name)(**given)])
        states = pipeline.begin()
        for touch in series(make_touch):
            states = pipeline.simulate(touch, states)
            assert np.isfinite(touch.reading).all()
            assert np.isfinite(touch.pressure).all() and (touch.pressure >= 0.0).all()
            assert np.isfinite(touch.believed).all() and np.isfinite(touch.actual).all()


@pytest.mark.parametrize("name", EFFECT_NAMES)
def test_same_touches_and_states_give_same_again(name, make_finger, make_touch, values_of):
    pipeline = assemble(make_finger(), [effect_type(name)()])
    found = []
    for _ in range(2):
        touches, states = series(make_touch), pipeline.begin()
        for touch in touches:
            states = pipeline.simulate(touch, states)
        found.append([values_of(touch) for touch in touches])
    assert found[0] == found[1]


@pytest.mark.parametrize("name", EFFECT_NAMES)
def test_a_stage_writes_into_no_array_that_it_was_given(name, make_finger, make_touch):
    effect = effect_type(name)()
    pipeline = assemble(make_finger(), [effect])
    states = pipeline.begin()
    for touch in series(make_touch):
        kept = []
        for stage, state in zip(pipeline.stages, states, strict=True):
            for value in (*vars_of(touch), *arrays_in(state)):
                value.setflags(write=False)  # a write would raise
            kept.append(stage.apply(touch, state))
        states = tuple(kept)


def vars_of(touch):
    held = (getattr(touch, field.name) for field in fields(touch))
    return [value for value in held if isinstance(value, np.ndarray)]


def arrays_in(state):
    parts = state if isinstance(state, tuple) else (state,)
    return [part for part in parts if isinstance(part, np.ndarray)]


@pytest.mark.parametrize("name", EFFECT_NAMES)
def test_a_miss_and_a_start_in_object_feel_nothing_but_noise(name, make_finger, make_touch):
    inside = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    pipeline = assemble(make_finger(), [effect_type(name)()])
    states = pipeline.begin()
    for touch in (make_touch(0, reach=1e-3), make_touch(1, actual=inside, believed=inside)):
        states = pipeline.simulate(touch, states)
        assert touch.outcome == ("inside", "miss")[touch.number == 0]
        assert (touch.compression == 0.0).all()
        assert (touch.pressure == 0.0).all()
        assert np.isfinite(touch.reading).all()
        assert np.median(np.abs(touch.reading)) < 50e-6


@pytest.mark.parametrize("name", NOTHING)
def test_effect_without_strength_changes_nothing(name, make_finger, make_touch, values_of):
    finger = make_finger(dome=1 / 0.015)
    ideal = assemble(finger, [])
    pipeline = assemble(finger, [effect_type(name)(**NOTHING[name])])
    assert pipeline.noise == 0.0
    states, clean = pipeline.begin(), ideal.begin()
    for touch, expected in zip(series(make_touch), series(make_touch), strict=True):
        states = pipeline.simulate(touch, states)
        clean = ideal.simulate(expected, clean)
        assert values_of(touch) == values_of(expected)


@pytest.mark.parametrize("name", sorted(set(MODULES.values())))
def test_no_file_of_effects_imports_another_or_more_than_numpy(name):
    source = ast.parse((FOLDER / f"{name}.py").read_text())
    for node in ast.walk(source):
        if isinstance(node, ast.ImportFrom):
            assert not (node.module or "").startswith("palpate.core.touch.effects")
            assert not (node.module or "").startswith("scipy")
        elif isinstance(node, ast.Import):
            assert {alias.name for alias in node.names} <= {"math", "numpy"}


@pytest.mark.parametrize("rows_cols", [(8, 20), (20, 8), (13, 13)])
@pytest.mark.parametrize("name", EFFECT_NAMES)
def test_arrays_need_not_be_square_or_even(name, rows_cols, make_finger, make_touch):
    finger = make_finger(rows=rows_cols[0], cols=rows_cols[1], pitch=0.8e-3)
    pipeline = assemble(finger, [effect_type(name)()])
    touch = make_touch()
    pipeline.simulate(touch, pipeline.begin())
    assert touch.outcome == "hit"
    assert touch.reading.shape == touch.pressure.shape == rows_cols


def test_unknown_effects_are_refused():
    with pytest.raises(LookupError, match="there is no effect 'noise'"):
        effect_type("noise")


def test_a_module_that_cannot_be_imported_or_holds_no_effect_is_refused():
    with pytest.raises(ValueError, match=r"'no\.such:Effect' cannot be imported"):
        effect_type("no.such:Effect")
    with pytest.raises(ValueError, match="'math:pi' is no effect"):
        effect_type("math:pi")


def test_a_users_own_effect_is_found_and_comes_last():
    name = "palpate.core.touch.effects.electronics:Drift"
    assert effect_type(name) is import_module("palpate.core.touch.effects.electronics").Drift
    assert rank(name) == len(EFFECT_NAMES)
