import numpy as np
import pytest

from palpate.launch.files.source_map import InputError
from palpate.launch.scene import load_scene, read_calibration, write_calibration
from palpate.tools import calibration
from palpate.tools.calibration.calibrating import (
    calibrate,
    calibration_figures,
    calibration_text,
    calibration_warnings,
)

WORN = """
object:
  superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}
effects:
  - gain_offset
  - gaussian_noise
  - dead_taxels
seed: 3
"""


@pytest.fixture(scope="module")
def worn(tmp_path_factory):
    path = tmp_path_factory.mktemp("scenes") / "worn.yaml"
    path.write_text(WORN)
    return load_scene(path).spec


@pytest.fixture(scope="module")
def calibrated(worn):
    return calibrate(worn, lambda text: None)


def test_every_taxel_of_a_domed_pad_is_reached_but_for_the_dead(calibrated):
    estimate = calibrated.estimate
    assert (estimate.trusted == estimate.reached).all()
    assert 0 < (~estimate.trusted).sum() < 10


def test_errors_are_a_fifth_of_what_the_data_sheet_leaves(calibrated):
    estimate = calibrated.estimate
    used = estimate.reached
    assert np.std(estimate.gain[used]) > 0.025  # the scene's sensor is 3 % off
    assert np.median(estimate.gain_error[used]) < 0.2 * 0.03
    assert np.median(estimate.offset_error[used]) < 0.2 * 10e-6
    assert abs(estimate.sound_speed - 1000.0) < 4 * estimate.sound_speed_error
    assert estimate.noise == pytest.approx(10e-6, rel=0.1)


def test_the_report_gives_each_figure_with_its_error(calibrated, worn):
    lines = dict(
        line.split(maxsplit=1)
        for line in calibration_text(calibration_figures(calibrated, worn.sensor)).splitlines()
    )
    assert set(lines) == {"touches", "sound", "gain", "offset", "noise", "arm", "taxels", "ball"}
    assert all("+-" in lines[name] for name in ("sound", "gain", "offset", "ball"))


def test_the_ball_is_measured_better_with_the_calibration(calibrated, worn):
    ball = calibration_text(calibration_figures(calibrated, worn.sensor)).splitlines()[-1]
    measured, by_sheet = (
        part.split(" +- ") for part in ball.partition("measured as ")[2].split("; by sheet ")
    )
    radius, error = float(measured[0]), float(measured[1].split()[0])
    radius_by_sheet, error_by_sheet = float(by_sheet[0]), float(by_sheet[1].split()[0])
    assert abs(radius - 30.0) < 0.5 * abs(radius_by_sheet - 30.0)
    assert error < error_by_sheet


def test_a_flat_pad_that_sends_forces_is_calibrated_too(worn, write):
    text = WORN + "sensor: {signal: force, pad: {radius: null}}\n"
    spec = load_scene(write("s.yaml", text)).spec
    found = calibrate(spec, lambda text: None)
    assert found.estimate.reached.sum() > 240
    assert found.estimate.sound_speed_error == 0.0
    assert "not estimated: the array sends forces" in calibration_text(
        calibration_figures(found, spec.sensor)
    )


def test_a_written_calibration_is_read_by_a_scene(calibrated, write, tmp_path):
    write_calibration(tmp_path / "found.yaml", calibrated.estimate, calibrated.pad)
    scene = load_scene(write("s.yaml", WORN + "sensor: {calibration: found.yaml}\n"))
    sensor = scene.spec.sensor
    assert sensor.calibration == read_calibration(tmp_path / "found.yaml")
    assert sensor.calibration is not None
    gain = calibrated.estimate.gain.reshape(16, 16)
    assert np.allclose(sensor.calibration.gain, gain, rtol=1e-5)


def test_a_file_that_is_there_is_not_overwritten(calibrated, tmp_path):
    path = tmp_path / "found.yaml"
    path.write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        write_calibration(path, calibrated.estimate, calibrated.pad)
    assert path.read_text() == "mine"


def test_a_file_that_cannot_be_written_is_told(calibrated, tmp_path):
    with pytest.raises(InputError, match="cannot be written: there is no folder"):
        write_calibration(tmp_path / "no" / "x.yaml", calibrated.estimate, calibrated.pad)


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        ("{calibration: 3}", "bad.yaml:8: sensor.calibration must be the name of a file"),
        ("{calibration: ../found.yaml}", "it must lie in the scene's own folder"),
        ("{calibration: /found.yaml}", "it must lie in the scene's own folder"),
        ("{calibration: none.yaml}", "none.yaml"),
        ("{calibration: odd.yaml}", "odd.yaml:1: calibration.noise is -1; expected number >= 0"),
        ("{calibration: small.yaml}", "calibration.gain must have 16 rows of 16"),
    ],
)
def test_a_bad_calibration_is_refused_in_one_sentence(write, sensor, words):
    write("odd.yaml", "noise: -1\nsound_speed: 1000\ngain: [[1]]\noffset: [[0]]\n")
    write("small.yaml", "noise: 0\nsound_speed: 1000\ngain: [[1]]\noffset: [[0]]\n")
    with pytest.raises(InputError) as caught:
        load_scene(write("bad.yaml", WORN.lstrip() + f"sensor: {sensor}\n"))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_worn_sensor_can_be_calibrated():
    spec = load_scene("worn_sensor").spec
    found = calibrate(spec, lambda text: None)
    assert calibration_warnings(found) == []
    assert found.estimate.noise == pytest.approx(12.3e-6, rel=0.15)  # 10 um, and steps of 25
    assert 0 < (~found.estimate.trusted).sum() < 10


def test_pads_that_yield_are_calibrated_by_what_they_touch(write):
    text = WORN.replace("- dead_taxels", "- half_space")
    found = calibrate(load_scene(write("s.yaml", text)).spec, lambda text: None)
    assert calibration_warnings(found) == []
    assert abs(found.estimate.sound_speed - 1000.0) < 4 * found.estimate.sound_speed_error


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        ("saturation: {share: 0.1}", ("a speed of sound of", "not measured as a ball")),
        ("gain_offset: {sigma_gain: 0.3, sigma_offset: 1.0e-3}", ("taxels could not be calibrat",)),
        ("tenting: {decay: 0.02}", ("taxels could not be calibrated",)),
    ],
)
def test_what_makes_no_sense_is_doubted(effect, words, write, monkeypatch):
    monkeypatch.setattr(calibration, "TILTS", 5)
    text = WORN.partition("effects")[0] + f"effects:\n  - {effect}\n  - gaussian_noise\nseed: 1\n"
    found = calibrate(load_scene(write("s.yaml", text)).spec, lambda text: None)
    doubts = " ".join(calibration_warnings(found))
    assert all(one in doubts for one in words)
