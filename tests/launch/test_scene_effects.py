from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from palpate.launch.located import InputError
from palpate.launch.scene import load_scene

Write = Callable[[str, str], Path]

BALL = "object:\n  superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}\n"


def test_a_list_becomes_parameters_by_name(write: Write) -> None:
    text = BALL + "effects:\n  - gaussian_noise: {sigma: 2e-5}\n  - drift\n  - creep:\n"
    effects = load_scene(write("s.yaml", text)).spec.effects

    assert effects == {"gaussian_noise": {"sigma": 2e-5}, "drift": {}, "creep": {}}


@pytest.mark.parametrize("text", ["", "effects:\n", "effects: []\n"])
def test_a_scene_without_effects_has_none(write: Write, text: str) -> None:
    assert load_scene(write("s.yaml", BALL + text)).spec.effects == {}


@pytest.mark.parametrize(
    ("effects", "words"),
    [
        ("[noise]", "bad.yaml:3: there is no effect 'noise'"),
        ("[drfit]", "there is no effect 'drfit'; did you mean 'drift'?"),
        ("[3]", "bad.yaml:3: effects[0] must be one effect and its parameters"),
        ("[{drift: {}, creep: {}}]", "effects[0] must be one effect"),
        ("[{drift: 3}]", "effects[0] must be one effect"),
        ("drift", "bad.yaml:3: effects must be a list"),
        ("{drift: {}}", "bad.yaml:3: effects must be a list"),
        ("[drift, drift]", "bad.yaml:3: effects lists 'drift' twice"),
        ("['.x:Y']", "must name its module in full"),
        ("[drift, 'palpate.core.touch.effects.drift:EFFECT']", "are the same effect"),
        ("[no.such:Module]", "bad.yaml:3: the effect 'no.such:Module' cannot be imported"),
        ("['os.path:join']", "'os.path:join' is no effect: 'join' must be a dataclass"),
    ],
)
def test_a_bad_list_is_refused_in_one_sentence(write: Write, effects: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        load_scene(write("bad.yaml", BALL + f"effects: {effects}\n"))

    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        (
            "sigma: -1",
            "bad.yaml:5: effects.gaussian_noise: sigma is -1 m; expected 0 to 0.001 m",
        ),
        ("sigmo: 1", "unknown key 'sigmo' in effects.gaussian_noise; did you mean 'sigma'?"),
        ("sigma: much", "bad.yaml:5: effects.gaussian_noise.sigma is 'much'; expected number"),
        ("sigma: .nan", "bad.yaml:5: effects.gaussian_noise.sigma is nan; a number must be finite"),
    ],
)
def test_a_bad_parameter_is_refused_with_line_range_and_unit(
    write: Write, parameters: str, words: str
) -> None:
    text = BALL + f"effects:\n  - gaussian_noise:\n      {parameters}\n"
    with pytest.raises(InputError) as caught:
        load_scene(write("bad.yaml", text))

    assert words in str(caught.value)


def test_what_a_sensor_cannot_have_is_refused(write: Write) -> None:
    text = BALL + "sensor: {signal: force}\neffects:\n  - temperature\n"
    with pytest.raises(InputError, match=r"bad\.yaml:5: .*temperature"):
        load_scene(write("bad.yaml", text))


def test_a_module_of_the_users_is_an_effect(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "lab_effects").mkdir()
    write("lab_effects/__init__.py", "")
    write("lab_effects/ringing.py", OWN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    text = BALL + "effects:\n  - lab_effects.ringing:Ringing: {size: 2e-6}\n"

    assert load_scene(write("s.yaml", text)).spec.effects == {
        "lab_effects.ringing:Ringing": {"size": 2e-6}
    }
    with pytest.raises(InputError, match="size is 9 m; expected 0 to 1 m"):
        load_scene(write("bad.yaml", text.replace("2e-6", "9")))


OWN = """
from dataclasses import dataclass
from typing import Annotated, ClassVar
from palpate.core.ranges import Range, check_ranges
from palpate.core.touch.effect import Place, Stage

@dataclass(frozen=True, kw_only=True)
class Ringing:
    place: ClassVar = Place.SIGNAL
    size: Annotated[float, Range(0.0, 1.0, "m")] = 1e-6

    def __post_init__(self):
        check_ranges(self)

    def prepare(self, finger):
        def act(touch, state):
            touch.reading = touch.reading + self.size
        return Stage(act)
"""


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("def (", "cannot be imported: SyntaxError"),
        ("1 / 0", "cannot be imported: ZeroDivisionError"),
        ("import sys; sys.exit(0)", "cannot be imported: SystemExit"),
        (OWN.replace("place: ClassVar = Place.SIGNAL", "pass"), "its place must be one of Place"),
        (OWN.replace("Place.SIGNAL", "6"), "its place must be one of Place"),
        (OWN.replace("Annotated[float", "Annotated[flaot"), "cannot be imported: NameError"),
        (OWN.replace("return Stage(act)", "return None"), "prepares a NoneType, not a Stage"),
    ],
)
def test_a_module_that_is_no_effect_is_refused_in_one_sentence(
    source: str, words: str, write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    name = f"odd_{abs(hash((source, words)))}"
    write(f"{name}.py", source)
    text = BALL + f"effects:\n  - {name}:Ringing\n"
    with pytest.raises(InputError) as caught:
        load_scene(write("s.yaml", text))
    assert words in str(caught.value)
    assert re.search(r"s\.yaml:[34]: ", str(caught.value))
    assert "\n" not in str(caught.value)
