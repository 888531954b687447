"""Scenes in words, what is too large to explore, and the colours of quantities."""

import re
from dataclasses import fields
from itertools import combinations
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

from palpate.core.plugins import ranges_of
from palpate.core.touch.effects import EFFECT_NAMES, effect_type
from palpate.launch.colours import COLOURS, rgb
from palpate.launch.files.source_map import InputError
from palpate.launch.scene import load_scene
from palpate.tools.scene_text import check_scene, effects_text, list_effects, simulation_text
from palpate.tools.surfaces import hex_colour, scale_top, shades, viridis

BALL = "object:\n  superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}\n"
PAGE = (Path(__file__).parents[2] / "docs" / "effects.md").read_text(encoding="utf-8")


@pytest.fixture
def lines(write):
    """How a scene with these effects is simulated, line by line."""
    return lambda effects: simulation_text(
        load_scene(write("s.yaml", BALL + effects)).spec
    ).splitlines()


def test_scene_text_lists_effects_in_order(lines):
    plain = lines("")
    assert plain[-1] == "simulated  exact contact, and no effects"
    assert "16 x 16 taxels, pitch 1 mm; pad domed 15 mm, 3 mm thick;" in " ".join(plain)
    some_lines = lines("effects:\n  - drift\n  - gaussian_noise: {sigma: 2.0e-6}\n  - pose_error\n")
    assert [line.split()[1] for line in some_lines[3:]] == ["pose_error", "drift", "gaussian_noise"]
    assert some_lines[-1].split(maxsplit=2) == ["signal", "gaussian_noise", "sigma 2e-06 m"]
    all_lines = lines("effects:\n" + "".join(f"  - {name}\n" for name in reversed(EFFECT_NAMES)))
    assert [line.split()[1] for line in all_lines[3:] if line[2] != " "] == [*EFFECT_NAMES]
    assert max(map(len, all_lines)) <= 80


def test_page_and_list_have_every_effect_and_parameter():
    assert re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE) == [*EFFECT_NAMES]
    listed = " ".join(effects_text(list_effects()).split())
    for name in EFFECT_NAMES:
        kind = effect_type(name)
        title = str(kind.__doc__).partition("\n")[0]
        (row,) = (line for line in PAGE.splitlines() if line.startswith(f"| `{name}` |"))
        assert f"| {kind.phase.name.lower()} | {title} |" in row and f"{name}: {title}" in listed
        for field in fields(kind):
            default = "none" if field.default is None else field.default
            allowed = ranges_of(kind).get(field.name)
            assert f"`{field.name}` {default}" + (f" ({allowed})" if allowed else "") in row
            assert f" {field.name} " in listed


@pytest.mark.parametrize(
    ("radius", "refusal"),
    [
        (0.15, ""),
        (0.3, ""),
        (0.6, "1.2 x 1.2 x 1.2 m, and at most 1 m can be rebuilt"),
        (1.5, r"3 x 3 x 3 m .* touches, \d+ min .* GB; at most"),
    ],
)
def test_too_long_explorations_are_refused_before_start(write, radius, refusal):
    place = f"pose: {{position: [0, 0, {radius}]}}"
    text = f"object: {{sphere: {{radius: {radius}}}, {place}}}\nexplore: {{tolerance: 1e-3}}\n"
    scene = str(write("ball.yaml", text))
    if not refusal:
        assert check_scene(scene).size[2] == pytest.approx(2.0 * radius, rel=1e-3)
        return
    with pytest.raises(InputError, match=refusal):
        check_scene(scene)


def test_colours_are_those_of_viridis():
    values = np.linspace(0.0, 1.0, 256)
    theirs = 255.0 * mpl.colormaps["viridis"](values)[:, :3]
    assert np.abs(viridis(values, 1.0) - theirs).max() < 6.0  # a fortieth
    assert (hex_colour(0.0, 2.0), hex_colour(5.0, 2.0)) == ("#440154", "#fde725")
    values = np.array([-1.0, 0.0, 0.3, 1.0, 2.0])  # a surface is light where its value is 0
    assert (shades(values, 1.0)[1:4] == viridis(1.0 - values[1:4], 1.0)).all()
    assert (shades(values, 1.0)[[0, 4]] == shades(values, 1.0)[[1, 3]]).all()


def test_scale_ends_at_a_round_value_without_outliers():
    for value, top in ((0.00013, 0.00015), (0.0001, 0.0001), (0.9, 1.0), (0.0, 1e-6)):
        values = np.full(1000, value)
        assert scale_top(values) == pytest.approx(top)
        values[:5] = 1.0 + value
        assert scale_top(values) == pytest.approx(top)


# What a colour becomes for people without red, green or blue cones (Machado et al., 2009, Table 1,
# severity 1), in linear RGB.
CONES = {
    "all": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                   [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                     [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                   [0.004733, 0.691367, 0.303900]],
}  # fmt: skip
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def seen_as(quantity, cones):
    """Lightness and both hues in CIE 1976 L*a*b*, by formula."""
    share = np.array(rgb(quantity)) / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    x, y, z = np.cbrt(XYZ @ np.clip(np.array(cones) @ linear, 0.0, 1.0) / XYZ.sum(axis=1))
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


@pytest.mark.parametrize("cones", CONES)
def test_colours_of_quantities_differ_for_all_eyes(cones):
    seen = [seen_as(quantity, CONES[cones]) for quantity in COLOURS]
    apart = [np.linalg.norm(one - other) for one, other in combinations(seen, 2)]
    assert min(apart) > 15.0  # 2.3 is just noticeable
