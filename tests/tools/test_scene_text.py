import re
from dataclasses import fields
from pathlib import Path

import pytest

from palpate.core.plugins import ranges_of
from palpate.core.touch.effects.catalogue import EFFECT_NAMES, effect_type
from palpate.launch.files import InputError
from palpate.launch.scene import load_scene
from palpate.tools.scene_text import check_scene, effects_text, list_effects, simulation_text

BALL = "object:\n  superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}\n"


def test_a_scene_without_effects_says_so(write):
    published = simulation_text(load_scene(write("s.yaml", BALL)).spec)
    assert published.splitlines()[-1] == "simulated  exact contact, and no effects"
    assert "16 x 16 taxels, pitch 1 mm; pad domed 15 mm, 3 mm thick;\n" in published
    assert "\n           sends times of flight, as its data sheet says\n" in published


def test_effects_are_told_in_the_order_in_which_they_act_with_units(write):
    text = BALL + "effects:\n  - drift\n  - gaussian_noise: {sigma: 2.0e-6}\n  - pose_error\n"
    published = simulation_text(load_scene(write("s.yaml", text)).spec).splitlines()
    names = [line.split()[1] for line in published[3:]]
    assert names == ["pose_error", "drift", "gaussian_noise"]
    assert published[-1].split(maxsplit=2) == ["signal", "gaussian_noise", "sigma 2e-06 m"]


def test_every_effect_can_be_told(write):
    listed = "".join(f"  - {name}\n" for name in reversed(EFFECT_NAMES))
    published = simulation_text(load_scene(write("s.yaml", BALL + "effects:\n" + listed)).spec)
    lines = [line.split() for line in published.splitlines()[3:] if line[2] != " "]
    assert [line[1] for line in lines] == list(EFFECT_NAMES)
    assert all(len(line) <= 80 for line in published.splitlines())


PAGE = (Path(__file__).parents[2] / "docs" / "effects.md").read_text(encoding="utf-8")


def effect_title(name):
    return str(effect_type(name).__doc__).partition("\n")[0]


def row(name):
    [found] = [line for line in PAGE.splitlines() if line.startswith(f"| `{name}` |")]
    return found


def test_the_page_has_the_effects_in_their_order():
    found = re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE)
    assert found == list(EFFECT_NAMES)


@pytest.mark.parametrize("name", EFFECT_NAMES)
def test_the_page_has_each_parameter_with_default_range_and_unit(name):
    kind = effect_type(name)
    text = row(name)
    assert f"| {kind.phase.name.lower()} | {effect_title(name)} |" in text
    for field in fields(kind):
        default = "none" if field.default is None else field.default
        allowed = ranges_of(kind).get(field.name)
        assert f"`{field.name}` {default}" + (f" ({allowed})" if allowed else "") in text


def test_the_list_names_every_effect_and_parameter():
    published = " ".join(effects_text(list_effects()).split())
    for name in EFFECT_NAMES:
        assert f"{name}: {effect_title(name)}" in published
        assert all(f" {field.name} " in published for field in fields(effect_type(name)))


@pytest.mark.parametrize(
    ("radius", "refusal"),
    [
        (0.15, ""),
        (0.3, ""),
        (0.6, "1.2 x 1.2 x 1.2 m, and at most 1 m can be rebuilt"),
        (1.5, r"3 x 3 x 3 m .* touches, \d+ min .* GB; at most"),
    ],
)
def test_what_takes_too_long_is_refused_before_it_begins(tmp_path, radius, refusal):
    scene = tmp_path / "ball.yaml"
    place = f"pose: {{position: [0, 0, {radius}]}}"
    scene.write_text(
        f"object: {{sphere: {{radius: {radius}}}, {place}}}\nexplore: {{tolerance: 1e-3}}\n"
    )
    if not refusal:
        assert check_scene(str(scene)).size[2] == pytest.approx(2.0 * radius, rel=1e-3)
    else:
        with pytest.raises(InputError, match=refusal):
            check_scene(str(scene))
