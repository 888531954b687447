from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from palpate.core.touch.effects.catalogue import effect_type
from palpate.launch.init_effect import init_effect
from palpate.launch.located import InputError
from palpate.launch.scene import load_scene

Write = Callable[[str, str], Path]


def test_a_new_effect_can_be_listed_at_once(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, listed = init_effect("mains_hum", tmp_path)
    assert (path, listed) == (tmp_path / "mains_hum.py", "mains_hum:MainsHum")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    ball = "object:\n  superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}\n"
    scene = write("s.yaml", ball + f"effects:\n  - {listed}: {{size: 2.0e-6}}\n")
    assert load_scene(scene).spec.effects == {listed: {"size": 2e-6}}
    assert effect_type(listed).__name__ == "MainsHum"
    assert "emplate" not in path.read_text().replace("the template", "")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Mains", "'Mains' cannot name a module"),
        ("mains-hum", "'mains-hum' cannot name a module"),
        ("../hum", "cannot name a module"),
        ("drift", "'drift' is an effect that palpate has"),
        ("_", "'_' cannot name a module"),
        ("if", "'if' cannot name a module"),
        ("none", "the class None of 'none' has a meaning already"),
        ("stage", "the class Stage of 'stage' has a meaning already"),
        ("signal", "'signal' is a module that Python has"),
        ("numpy", "'numpy' is a module that Python has"),
    ],
)
def test_a_bad_name_is_refused(name: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        init_effect(name, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "hum.py").write_text("mine")
    with pytest.raises(InputError, match="is there already"):
        init_effect("hum", tmp_path)
    assert (tmp_path / "hum.py").read_text() == "mine"


def test_a_folder_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written: No such file"):
        init_effect("hum", tmp_path / "no")
