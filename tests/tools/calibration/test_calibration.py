"""Sensors calibrated on a known flat and ball: errors, reports, doubts, files."""

import re

import numpy as np
import pytest

from palpate.launch.files.source_map import InputError
from palpate.launch.scene import load_scene, write_calibration
from palpate.tools.calibration.calibrating import (
    PressSettings,
    calibrate,
    calibration_figures,
    calibration_text,
    calibration_warnings,
)

BALL = "object:\n  superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}\n"
WORN = f"{BALL}effects:\n  - gain_offset\n  - gaussian_noise\n  - dead_taxels\nseed: 3\n"


def calibration_of(path, **settings):
    return calibrate(load_scene(path).spec, lambda text: None, PressSettings(**settings))


@pytest.fixture(scope="module")
def worn(tmp_path_factory):
    path = tmp_path_factory.mktemp("scenes") / "worn.yaml"
    path.write_text(WORN)
    return calibration_of(path), load_scene(path).spec.sensor


def test_errors_are_a_fifth_of_the_data_sheets(worn):
    estimate = worn[0].estimate
    used = estimate.reached
    assert (estimate.trusted == used).all() and 0 < (
        ~estimate.trusted
    ).sum() < 10  # the dead taxels
    assert np.std(estimate.gain[used]) > 0.025  # the scene's sensor is 3 % off
    assert np.median(estimate.gain_error[used]) < 0.2 * 0.03
    assert np.median(estimate.offset_error[used]) < 0.2 * 10e-6
    assert abs(estimate.sound_speed - 1000.0) < 4 * estimate.sound_speed_error
    assert estimate.noise == pytest.approx(10e-6, rel=0.1)


def test_report_gives_figures_with_errors_and_a_better_ball(worn):
    text = calibration_text(calibration_figures(*worn))
    lines = dict(line.split(maxsplit=1) for line in text.splitlines())
    assert {*lines} == {"touches", "sound", "gain", "offset", "noise", "arm", "taxels", "ball"}
    assert all("+-" in lines[name] for name in ("sound", "gain", "offset", "ball"))
    measured, by_sheet = re.findall(r"([\d.]+) \+- ([\d.]+)", lines["ball"])[-2:]
    assert abs(float(measured[0]) - 30.0) < 0.5 * abs(float(by_sheet[0]) - 30.0)
    assert float(measured[1]) < float(by_sheet[1])


@pytest.mark.slow
def test_flat_pad_that_sends_forces_is_calibrated(write):
    path = write("s.yaml", WORN + "sensor: {signal: force, pad: {radius: null}}\n")
    calibrated = calibration_of(path)
    assert calibrated.estimate.reached.sum() > 240 and calibrated.estimate.sound_speed_error == 0.0
    text = calibration_text(calibration_figures(calibrated, load_scene(path).spec.sensor))
    assert "not estimated: the array sends forces" in text


@pytest.mark.slow
def test_yielding_and_shipped_sensors_give_no_warning(write):
    yielding = calibration_of(write("s.yaml", WORN.replace("- dead_taxels", "- half_space")))
    shipped = calibration_of("worn_sensor")
    assert calibration_warnings(yielding) == calibration_warnings(shipped) == []
    speed = yielding.estimate
    assert abs(speed.sound_speed - 1000.0) < 4 * speed.sound_speed_error
    # 10 um of noise, and steps of 25.
    assert shipped.estimate.noise == pytest.approx(12.3e-6, rel=0.15)
    assert 0 < (~shipped.estimate.trusted).sum() < 10


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        ("saturation: {share: 0.1}", ("a speed of sound of", "not measured as a ball")),
        ("gain_offset: {sigma_gain: 0.3, sigma_offset: 1.0e-3}", ("taxels could not be calibrat",)),
        ("tenting: {decay: 0.02}", ("taxels could not be calibrated",)),
    ],
)
def test_bad_calibrations_give_warnings(effect, words, write):
    text = f"{BALL}effects:\n  - {effect}\n  - gaussian_noise\nseed: 1\n"
    doubts = " ".join(calibration_warnings(calibration_of(write("s.yaml", text), n_tilts=5)))
    assert all(part in doubts for part in words)


def test_written_calibration_is_read_by_a_scene_and_not_overwritten(worn, write, tmp_path):
    calibrated, path = worn[0], tmp_path / "found.yaml"
    write_calibration(path, calibrated.estimate, calibrated.pad)
    sensor = load_scene(write("s.yaml", WORN + "sensor: {calibration: found.yaml}\n")).spec.sensor
    gain = calibrated.estimate.gain.reshape(16, 16)
    assert np.allclose(sensor.calibration.gain, gain, rtol=1e-5)
    for target, words in ((path, "exists already"), (tmp_path / "no" / "x.yaml", "no folder")):
        with pytest.raises(InputError, match=words):
            write_calibration(target, calibrated.estimate, calibrated.pad)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("3", "bad.yaml:8: sensor.calibration must be the name of a file"),
        ("../found.yaml", "it must lie in the scene's own folder"),
        ("none.yaml", "none.yaml"),
        ("odd.yaml", "odd.yaml:1: calibration.noise is -1; expected number >= 0"),
        ("small.yaml", "calibration.gain must have 16 rows of 16"),
    ],
)
def test_bad_calibration_files_are_refused(write, name, words):
    write("odd.yaml", "noise: -1\nsound_speed: 1000\ngain: [[1]]\noffset: [[0]]\n")
    write("small.yaml", "noise: 0\nsound_speed: 1000\ngain: [[1]]\noffset: [[0]]\n")
    with pytest.raises(InputError) as caught:
        load_scene(write("bad.yaml", WORN + f"sensor: {{calibration: {name}}}\n"))
    assert words in str(caught.value) and "\n" not in str(caught.value)
