import math

import pytest

from palpate.launch import check_run, find_scene
from palpate.launch.demand import (
    LENGTHS,
    NOISES,
    TIMES,
    demand_text,
    demanded_of,
    read_demand,
    read_quantity,
    read_setup,
)
from palpate.launch.files import InputError, SourceMapped, key_path
from palpate.launch.forecast import COSTS, ellipsoid_area, expected_cost, forecast
from palpate.launch.launch_source import EXPLORE
from palpate.launch.scene import load_scene


@pytest.mark.parametrize(
    ("text", "units", "value"),
    [
        ("0.2mm", LENGTHS, 2e-4),
        (" 200 um", LENGTHS, 2e-4),
        ("200µm", LENGTHS, 2e-4),
        (".5cm", LENGTHS, 5e-3),
        ("1e-3m", LENGTHS, 1e-3),
        ("300s", TIMES, 300.0),
        ("5 min", TIMES, 300.0),
    ],
)
def test_a_number_with_its_unit_is_read(text, units, value):
    assert read_quantity(text, units, "--x") == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0.2", "must have a unit: m, cm, mm, um, in, ft, as in 0.2mm"),
        ("0.2s", "the unit 's' is none of m, cm, mm, um"),
        ("mm", "must be a number with a unit, as 0.2mm"),
        ("nanmm", "must be a number with a unit"),
        ("0mm", "must be more than 0"),
        ("-1mm", "must be more than 0"),
        ("1e999mm", "must be more than 0"),
    ],
)
def test_what_is_no_length_is_refused_in_one_sentence(text, words):
    with pytest.raises(InputError, match=words) as caught:
        read_quantity(text, LENGTHS, "--tolerance")
    assert str(caught.value).startswith(f"--tolerance {text}: ")


def test_only_what_is_asked_for_is_set():
    found = read_demand("0.2mm", None, "2min", 150, "draft")
    assert {key: one.value for key, one in found.items()} == {
        "planner.tolerance": pytest.approx(2e-4),
        "planner.most_seconds": 120.0,
        "planner.most_touches": 150,
        "reconstructor.quality": "draft",
    }
    assert found["planner.tolerance"].source == "--tolerance 0.2mm"
    assert read_demand(None, None, None, None, None) == {}
    with pytest.raises(InputError, match="--touches 0: must be at least 1"):
        read_demand(None, None, None, 0, None)


def test_costs_rise_with_accuracy_and_are_those_measured():
    shares = sorted(COSTS)
    medians = [COSTS[one].touches[1] for one in shares]
    assert medians == sorted(medians, reverse=True)
    assert expected_cost(0.01 * shares[0]).touches == pytest.approx(COSTS[shares[0]].touches)
    between = expected_cost(0.01 * (shares[0] * shares[1]) ** 0.5)
    assert medians[1] < between.touches[1] < medians[0]
    for one in COSTS.values():
        assert one.touches == tuple(sorted(one.touches))
        assert one.seconds == tuple(sorted(one.seconds))


def resolved(settings, tmp_path):
    args = {"scene": SourceMapped(str(find_scene("sphere")), "scene")}
    return check_run(EXPLORE, args, settings, tmp_path / "run")


def test_what_is_asked_is_told_with_its_reason_and_what_it_is_expected_to_cost(tmp_path):
    settings = read_demand("0.4mm", None, "300s", None, "fine")
    _, wirings = resolved(settings, tmp_path)
    text = " ".join(demand_text(wirings, settings, (0.08, 0.08, 0.08)).split())
    assert "tolerance 0.4 mm (--tolerance 0.4mm)" in text
    assert "feature 40 mm (100 times the tolerance)" in text
    assert "unknown at most 1 % of the surface, over half a feature from any touch" in text
    assert "gap between contours at most a feature" in text
    assert "a closed surface, no hole unentered" in text
    assert "at most 300 s (--budget 300s)" in text
    assert "quality fine (--quality fine)" in text
    assert "expected about" in text and "for 0.5 % of 80 mm" in text
    own = read_demand("0.4mm", "3mm", None, 90, None)
    _, wirings = resolved(own, tmp_path)
    text = " ".join(demand_text(wirings, own, None).split())
    assert "feature 3 mm (--feature 3mm)" in text
    assert "at most 90 touches (--touches 90)" in text
    assert "expected" not in text
    assert demand_text([], {}, (0.1, 0.1, 0.1)) == ""


def test_expected_touches_grow_with_the_surface_and_with_accuracy(tmp_path):
    for name in ("predicted", "touches"):
        settings = {"planner.planner": SourceMapped(name, "")}
        asked = demanded_of(resolved(settings, tmp_path)[1]).asked
        ball, wide = forecast(asked, (0.08,) * 3), forecast(asked, (0.16, 0.16, 0.08))
        assert ball.touches[1] < wide.touches[1] < 4.0 * ball.touches[1]
        assert forecast(asked, (0.08,) * 3, quality="fine").compute > ball.compute
        finer = forecast(type(asked)(planner=name, tolerance=1e-4), (0.08,) * 3)
        assert finer.touches[1] > ball.touches[1] and finer.seconds[1] > ball.seconds[1]


def test_the_area_of_an_ellipsoid_is_that_of_closed_forms():
    assert ellipsoid_area((2.0, 2.0, 2.0)) == pytest.approx(4.0 * math.pi, rel=1e-12)
    long = 2.0 * math.pi * (1.0 + 3.0 / math.sqrt(1 - 1 / 9) * math.asin(math.sqrt(1 - 1 / 9)))
    assert ellipsoid_area((2.0, 2.0, 6.0)) == pytest.approx(long, rel=0.011)


def test_a_robot_time_in_which_no_hand_can_close_twice_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"--budget 20s: most_seconds is 20 s; the grasp alone"):
        resolved(read_demand(None, None, "20s", None, None), tmp_path)
    resolved(read_demand(None, None, "31s", None, None), tmp_path)


def test_pose_and_noise_become_keys_of_the_scene():
    assert read_setup(None, None) == []
    at, turn = [0.01, 0.0, 0.05], [0.0, 0.0, 0.6, 0.8]
    keys = {key: value for _, key, value in read_setup("0.01,0,0.05,0,0,0.6,0.8", "default")}
    assert keys == {
        "scene.object.pose.position": at, "scene.object.pose.rotation": turn,
        "scene.effects.pose_error.sigma": 1e-4, "scene.effects.gaussian_noise.sigma": 1e-5,
    }  # fmt: skip
    assert read_setup(None, "none") == [("--noise none", "scene.effects", [])]
    for text in ("1,2", "a,b,c", ""):
        with pytest.raises(InputError, match="must be 3 or 7 numbers"):
            read_setup(text, None)


def test_presets_of_noise_are_effects_that_there_are(tmp_path):
    for noise in NOISES:
        changes = {
            key_path(f".{key}")[1:]: SourceMapped(value, option)
            for option, key, value in read_setup("0,0,0.1", noise)
        }
        spec = load_scene("vase", changes).spec
        assert list(spec.effects) == (["pose_error", "gaussian_noise"] if NOISES[noise] else [])
        assert spec.object.pose.position == (0.0, 0.0, 0.1)
