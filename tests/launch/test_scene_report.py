from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from palpate.core.touch.effects.catalogue import NAMES
from palpate.launch.scene import load_scene
from palpate.launch.scene_report import simulated

Write = Callable[[str, str], Path]

BALL = "object:\n  superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}\n"


def test_a_scene_without_effects_says_so(write: Write) -> None:
    said = simulated(load_scene(write("s.yaml", BALL)).spec)
    assert said.splitlines()[-1] == "simulated  exact contact, and no effects"
    assert "16 x 16 taxels, pitch 1 mm; pad domed 15 mm, 3 mm thick; sends times of flight" in said


def test_effects_are_told_in_the_order_in_which_they_act_with_units(write: Write) -> None:
    text = BALL + "effects:\n  - drift\n  - gaussian_noise: {sigma: 2.0e-6}\n  - pose_error\n"
    said = simulated(load_scene(write("s.yaml", text)).spec).splitlines()
    names = [line.split()[1] for line in said[2:]]
    assert names == ["pose_error", "drift", "gaussian_noise"]
    assert said[-1].split(maxsplit=2) == ["signal", "gaussian_noise", "sigma 2e-06 m"]


def test_every_effect_can_be_told(write: Write) -> None:
    listed = "".join(f"  - {name}\n" for name in reversed(NAMES))
    said = simulated(load_scene(write("s.yaml", BALL + "effects:\n" + listed)).spec)
    assert [line.split()[1] for line in said.splitlines()[2:]] == list(NAMES)
