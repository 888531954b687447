from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from palpate.launch.cli import main as cli

Write = Callable[[str, str], Path]
Output = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def sentence(output: Output) -> str:
    """The one line on standard error, which is all that there may be."""
    out, err = output.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "Traceback" not in err
    return err


def test_a_scene_is_checked_and_told(capsys: Output) -> None:
    assert cli.run(["scene", "check", "worn_sensor"]) == 0

    first, sensor, simulated, *effects = capsys.readouterr().out.splitlines()
    assert first.endswith("can be explored; the object measures 60.0 x 52.0 x 90.0 mm")
    assert "16 x 16 taxels" in sensor
    assert "and 7 effects, in this order:" in simulated
    assert effects[0].split() == ["aim", "pose_error", *effects[0].split()[2:]]
    assert "sigma 0.0001 m, rotation 0.05 deg" in effects[0]


def test_a_calibration_is_written_and_told(write: Write, home: Path, capsys: Output) -> None:
    write("s.yaml", "object: {superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}}")
    assert cli.run(["calibrate", "s.yaml", "--out", "found.yaml", "--quiet"]) == 0

    out, err = capsys.readouterr()
    assert err == ""
    assert "256 calibrated, 0 not reached, 0 not trusted" in out
    assert (home / "found.yaml").exists()
    assert cli.run(["calibrate", "s.yaml", "--out", "found.yaml"]) == 2
    assert sentence(capsys) == "palpate: found.yaml: is there already; choose another name\n"


def test_an_effect_is_begun(home: Path, capsys: Output) -> None:
    assert cli.run(["init", "effect", "hum"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "  - hum:Hum"
    assert (home / "hum.py").exists()


def test_the_effects_are_listed(capsys: Output) -> None:
    assert cli.run(["scene", "effects"]) == 0
    assert "\ngaussian_noise: Noise of the electronics" in capsys.readouterr().out


def test_a_word_that_is_none_of_a_few_is_refused_with_those(write: Write, capsys: Output) -> None:
    ball = "object: {superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}}\n"
    write("s.yaml", ball + "effects:\n  - aperture: {reading: median}\n")
    assert cli.run(["scene", "check", "s.yaml"]) == 2
    assert "reading is 'median'; expected one of max, mean" in sentence(capsys)
