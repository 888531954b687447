from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from palpate.launch.launch_path import EXPLORE
from palpate.launch.located import InputError, Located
from palpate.launch.run import plan_run

BALL = "object:\n  superquadric: {size: [0.03, 0.03, 0.03], exponents: [1, 1]}\n"


def planned(folder: Path, text: str, fingers: int = 1, **settings: Any) -> None:
    scene = folder / "s.yaml"
    scene.write_text(BALL + text)
    args = {"scene": Located(str(scene), "scene"), "fingers": Located(fingers, "fingers")}
    laid = {f"planner.{key}": Located(value, f"--set {key}") for key, value in settings.items()}
    plan_run(EXPLORE, args, laid, name="s", out=folder / "run")


def test_a_demand_that_can_be_met_passes(tmp_path: Path) -> None:
    planned(tmp_path, "explore: {tolerance: 0.1e-3}\n", fingers=2)


@pytest.mark.parametrize(
    ("text", "fingers", "words"),
    [
        (
            "explore:\n  tolerance: 5.0e-6\n",
            1,
            "s.yaml:4: tolerance is 5e-06 m; it must be at least what the sensor can tell, 1e-05 m",
        ),
        (
            "effects:\n  - gaussian_noise: {sigma: 50.0e-6}\nexplore:\n  tolerance: 40.0e-6\n",
            1,
            "s.yaml:6: tolerance is 4e-05 m; it must be at least what the sensor can tell, 5e-05 m",
        ),
        (
            "explore:\n  planner: uniform\n  settings:\n    count: 2\n",
            3,
            "s.yaml:6: count is 2, but there are 3 fingers; a finger would have nothing to do",
        ),
        ("", 4, "fingers is 4, but an object of 0.06 m has room for 3, 0.024 m apart"),
    ],
)
def test_a_demand_that_cannot_be_met_is_refused_in_its_place(
    tmp_path: Path, text: str, fingers: int, words: str
) -> None:
    with pytest.raises(InputError) as caught:
        planned(tmp_path, text, fingers)
    assert words in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["s.yaml"]


def test_a_setting_from_outside_is_named_as_such(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--set tolerance: tolerance is 1e-06 m"):
        planned(tmp_path, "", tolerance=1e-6)
