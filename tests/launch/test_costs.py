"""What is asked of an exploration, what it is expected to cost and has cost, and its charts."""

import math
import re
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from palpate.launch import charts
from palpate.launch.cost_chart import draw_cost, draw_panels
from palpate.launch.demand import (
    LENGTHS,
    NOISES,
    demand_text,
    demanded_of,
    read_demand,
    read_mesh_setup,
    read_quantity,
    read_setup,
)
from palpate.launch.exchange_rate import (
    AXES,
    BOUND,
    ERROR,
    HALVING_COSTS,
    cost_curve,
    draw_text,
    halving_lines,
    time_by_step,
)
from palpate.launch.files.source_map import InputError, SourceMapped, key_path
from palpate.launch.forecast import ellipsoid_area, expected_cost, forecast
from palpate.launch.launch_source import EXPLORE
from palpate.launch.log_scale import log_scale
from palpate.launch.progress import Progress
from palpate.launch.run import check_run
from palpate.launch.scene import find_scene, load_scene
from palpate.messages.types import NodeStatus, PlanDone, PlanEstimate, Score
from palpate.testing import example

SVG = "{http://www.w3.org/2000/svg}"


def resolved(settings, tmp_path):
    args = {"scene": SourceMapped(str(find_scene("sphere")), "scene")}
    return check_run(EXPLORE, args, settings, tmp_path / "run")[1]


def test_demand_is_told_with_its_cost_and_time_too_short_for_the_grasp_refused(tmp_path):
    settings = read_demand("0.4mm", None, "300s", None, "known", "fine")
    wirings = resolved(settings, tmp_path)
    text = " ".join(demand_text(wirings, settings, (0.08, 0.08, 0.08)).split())
    for part in (
        "tolerance 0.4 mm (--tolerance 0.4mm)",
        "feature 40 mm (100 times the tolerance)",
        "unknown at most 1 % of the surface, over half a feature from any touch",
        "gap between contours at most a feature",
        "a closed surface, no hole unentered",
        "the underside known (--underside known)",
        "at most 300 s (--budget 300s)",
        "quality fine (--quality fine)",
        "expected about",
        "for 0.5 % of 80 mm",
    ):
        assert part in text
    own = read_demand("0.4mm", "3mm", None, 90, None, None)
    text = " ".join(demand_text(resolved(own, tmp_path), own, None).split())
    assert "feature 3 mm (--feature 3mm)" in text
    assert "at most 90 touches (--touches 90)" in text
    assert "expected" not in text
    assert demand_text([], {}, (0.1, 0.1, 0.1)) == ""
    with pytest.raises(InputError, match=r"--budget 20s: most_seconds is 20 s; the grasp alone"):
        resolved(read_demand(None, None, "20s", None, None, None), tmp_path)
    assert resolved(read_demand(None, None, "31s", None, None, None), tmp_path)


def test_expected_cost_rises_with_accuracy_and_the_area_of_an_ellipsoid(tmp_path):
    costs = [expected_cost(tolerance) for tolerance in np.geomspace(1e-4, 0.02, 40)]
    touches = np.array([one.touches for one in costs])
    assert (np.diff(touches[:, 1]) <= 0.0).all() and touches[0, 1] > 2.0 * touches[-1, 1]
    assert (np.diff(touches, axis=1) >= 0.0).all()
    assert (np.diff([one.seconds for one in costs], axis=1) >= 0.0).all()
    for name in ("predicted", "touches"):
        settings = {"planner.planner": SourceMapped(name, "")}
        asked = demanded_of(resolved(settings, tmp_path)).asked
        ball, wide = forecast(asked, (0.08,) * 3), forecast(asked, (0.16, 0.16, 0.08))
        assert ball.touches[1] < wide.touches[1] < 4.0 * ball.touches[1]
        assert forecast(asked, (0.08,) * 3, quality="fine").compute > ball.compute
        finer = forecast(type(asked)(planner=name, tolerance=1e-4), (0.08,) * 3)
        assert finer.touches[1] > ball.touches[1] and finer.seconds[1] > ball.seconds[1]
    eccentricity = math.sqrt(8.0) / 3.0  # of semi-axes 1, 1 and 3
    spheroid = 2.0 * math.pi * (1.0 + 3.0 * math.asin(eccentricity) / eccentricity)
    assert ellipsoid_area((2.0, 2.0, 2.0)) == pytest.approx(4.0 * math.pi, rel=1e-12)
    assert ellipsoid_area((2.0, 2.0, 6.0)) == pytest.approx(spheroid, rel=0.012)  # Thomsen


def test_pose_noise_and_mesh_become_keys_of_the_scene_and_bad_lengths_are_refused():
    for text, words in (
        ("0.2s", "the unit 's' is none of m, cm, mm, um"),
        ("0mm", "must be more than 0"),
        ("1e999mm", "must be more than 0"),
    ):
        with pytest.raises(InputError, match=f"^--tolerance {text}: {words}"):
            read_quantity(text, LENGTHS, "--tolerance")
    assert read_setup(None, None) == []
    assert read_setup(None, "none") == [("--noise none", "scene.effects", [])]
    for text in ("1,2", "a,b,c", ""):
        with pytest.raises(InputError, match="must be 3 or 7 numbers"):
            read_setup(text, None)
    for noise in NOISES:
        changes = {
            key_path(f".{key}")[1:]: SourceMapped(value, option)
            for option, key, value in read_setup("0.01,0,0.05,0,0,0.6,0.8", noise)
        }
        spec = load_scene("vase", changes).spec
        assert list(spec.effects) == (["pose_error", "gaussian_noise"] if NOISES[noise] else [])
        assert spec.object.pose.position == (0.01, 0.0, 0.05)
        assert spec.object.pose.rotation == (0.0, 0.0, 0.6, 0.8)
    assert read_mesh_setup(Path("part.ply"), None, "12cm", "y") == [
        ("--size", "scene.object.mesh.size", 0.12),
        ("--up", "scene.object.mesh.up", "y"),
    ]
    assert read_mesh_setup(Path("vase"), None, None) == []


def estimate(number, touches, bound, halving=None, seconds=2.0):
    return example(
        PlanEstimate, number=number, touches=touches, robot_time=seconds * touches,
        rms_bound_95=bound, largest_untouched=5e-3, halving_touches=halving,
        halving_seconds=None if halving is None else 3.0 * halving,
    )  # fmt: skip


def scored(number, touches, rms):
    return example(Score, number=number, touches=touches, robot_time=2.0 * touches, rms=rms)


def curve(estimates=(), scores=(), compute=None, **more):
    progress = Progress(
        estimates=[(1.0 * one.number, one) for one in estimates],
        scores=[(1.0 * one.number + 5.0, one) for one in scores],
        **more,
    )
    return cost_curve(progress, compute)


TWO = [estimate(2, 20, 1e-3), estimate(3, 40, 1e-4)]


def test_score_and_estimate_are_one_entry_and_the_last_has_all_compute_time():
    estimates = [estimate(2, 20, 1e-3), estimate(3, 40, 5e-4, 12.0)]
    times = {"model_times": {2: 1.5}, "compute_times": [(1.0, 2.0), (3.0, 6.0)]}
    first, second = curve(estimates, [scored(2, 20, 8e-4)], **times)
    assert [one["rms_m"] for one in (first, second)] == [8e-4, None]
    assert [one["rms_bound_95_m"] for one in (first, second)] == [1e-3, 5e-4]
    assert [one["wall_s"] for one in (first, second)] == [1.5, 3.0]
    assert [one["compute_s"] for one in (first, second)] == [3.0, 6.0]
    assert (first["forecast"], first["largest_untouched_m"]) == (None, 5e-3)
    assert second["forecast"] == {"touches": 12.0, "robot_time_s": 36.0}
    done, times = example(PlanDone, number=3), [(2.0, 1.0), (3.0, 2.0)]
    assert curve(TWO, compute_times=times, done=done, compute=7.5)[-1]["compute_s"] == 7.5
    assert curve(TWO, compute_times=times, compute=7.5)[-1]["compute_s"] == 2.0
    assert curve(TWO)[-1]["compute_s"] is None
    assert curve(compute=7.5) == []


def test_actual_cost_of_halving_stands_beside_its_forecast_also_in_words():
    estimates = [estimate(2, 20, 1e-3, 30.0), estimate(3, 40, 9e-4, 10.0), estimate(4, 60, 1e-4)]
    first, second, third = curve(estimates)
    assert first["halved"] == {"touches": 40, "robot_time_s": 80.0}
    assert second["halved"] == {"touches": 20, "robot_time_s": 40.0}
    assert first["ratio"] == {"touches": 0.75, "robot_time_s": 1.125}
    assert second["ratio"] == {"touches": 0.5, "robot_time_s": 0.75}
    assert third["halved"] is third["ratio"] is None
    # The forecast is of the bound, whatever the truth; and neither what the finer final mesh
    # brings nor a model of which nothing is stated is a halving.
    scores = [scored(2, 20, 4e-4), scored(3, 40, 1e-4), scored(5, 60, 1e-5)]
    found = curve([*estimates, estimate(5, 60, 4e-5)], scores)
    assert [one["halved"] and one["halved"]["touches"] for one in found] == [40, 20, None, None]
    assert curve([], scores)[0]["halved"] is None
    still = [estimate(2, 20, 1e-3, 30.0, seconds=0.0), estimate(3, 40, 1e-4, seconds=0.0)]
    entry = curve(still)[0]  # a robot without a clock
    assert (entry["halved"], entry["ratio"]) == ({"touches": 20, "robot_time_s": 0.0}, None)
    estimates = [estimate(2, 20, 1e-3, 16.0), estimate(3, 40, 4e-4, 12.3)]
    assert halving_lines(curve(estimates)) == [
        "next halving of the bound: about 12 touches, 37 s",
        "last halving of the bound: expected 16 touches, 48 s; took 20 touches, 40 s",
    ]
    none = "no further slice is expected to halve the bound"
    assert halving_lines(curve(TWO[:1])) == [none]
    assert halving_lines([]) == []


def test_processor_time_is_added_up_by_steps():
    cpu = {"simulator_1": 2.0, "simulator_2": 1.5, "reconstructor": 4.25}
    steps = [{"casting": 1.5}, {"casting": 1.0}, {"lattice": 3.0, "ends": 1.25}]
    statuses = {
        name: example(NodeStatus, cpu=seconds, steps=one)
        for (name, seconds), one in zip(cpu.items(), steps, strict=True)
    }
    by_step = time_by_step(statuses)
    expected = {"lattice": 3.0, "casting": 2.5, "ends": 1.25, "rest": 1.0}
    assert list(by_step.items()) == list(expected.items())
    assert time_by_step({}) == {}


FORECAST = {"touches": 40.0, "robot_time_s": 90.0}


def entry(touches, rms, bound, forecast=None, compute=True):
    return {
        "touches": touches, "robot_time_s": 2.5 * touches,
        "compute_s": 0.05 * touches if compute else None, "rms_m": rms, "rms_bound_95_m": bound,
        "forecast": forecast,
    }  # fmt: skip


CURVE = [
    entry(20, 3e-3, 8e-3),
    entry(40, 1e-3, 6e-3, FORECAST),
    entry(70, 1e-4, 9e-4),
    entry(110, 3e-5, 3e-5, FORECAST),
    entry(110, 2e-5, 3e-5, FORECAST),
]


def summary(entries=CURVE, truth=True, **more: Any) -> dict[str, Any]:
    nodes = {"simulator": {"cpu_s": 1.0}, "filter": {"cpu_s": 0.5}}
    return {
        "curve": entries if truth else [{**one, "rms_m": None} for one in entries],
        "sampling_floor_m": 8e-6 if truth else None, "tolerance_m": None, "scene": "<vase>",
        "status": "finished", "contours": 4, "touches": 110, "robot_time_s": 275.0,
        "compute_s": 5.5, "missed": [], "largest_untouched_m": 2e-3,
        "steps": {"casting": 1.0, "rest": 0.0}, "nodes": nodes, **more,
    }  # fmt: skip


def test_curve_in_text_shows_error_bound_floor_and_costs():
    lines = draw_text(summary())
    text = "\n".join(lines)
    assert max(map(len, lines)) <= 80
    assert "o stated bound (95 %)" in text and "* true error (rms)" in text
    assert "@ both" in text  # the last but one error is as large as its bound
    assert "sampling floor 0.008 mm" in text and "- - - - -" in text
    assert [line.split()[-1] for line in lines[-5:-2]] == ["110", "275", "5.5"]
    assert lines[-5].split() == ["touches", "20", "40", "70", "110"]
    # The higher the error, the higher its mark; the later, the farther to the right.
    marks = [(row, line.index("*")) for row, line in enumerate(lines[:9]) if "*" in line]
    assert marks == sorted(marks) and len(marks) >= 3


@pytest.mark.parametrize(("facts", "shown", "hidden"), [
    (summary(CURVE[:1]), "*", "@ both"),
    (summary(truth=False), "o", "true error"),
    (summary(CURVE[:1], truth=False), "o", "sampling floor"),
    (summary([entry(20, 3e-3, None, compute=False)]), "*", "bound"),
    (summary(sampling_floor_m=1e-9), "*", "floor"),
    (summary(sampling_floor_m=0.0), "*", "floor"),
])  # fmt: skip
def test_curve_without_truth_bound_or_floor_is_drawn(facts, shown, hidden):
    text = "\n".join(draw_text(facts))
    assert shown in text and hidden not in text
    assert shown_by(draw_cost(facts))


def shown_by(figure):
    """All texts of a figure."""
    root = ElementTree.fromstring(charts.svg_text(figure, "t"))
    return ["".join(one.itertext()) for one in root.iter(f"{SVG}text")]


def test_without_a_model_only_times_are_drawn_and_errors_of_rounding_in_their_panel():
    nothing = summary([entry(20, None, None)], steps={}, nodes={}, scene=None, compute_s=None)
    for facts in (nothing, {**nothing, "curve": [], "largest_untouched_m": None}):
        assert draw_text(facts) == []
        assert any("no model was judged" in text for text in shown_by(draw_cost(facts)))
        assert list(draw_panels(facts)) == ["Processor time by step of the work"]
    facts = summary([entry(86, 6.5e-17, None)])
    for figure in (draw_cost(facts), *draw_panels(facts).values()):
        for axes in figure.axes:
            lowest, highest = sorted(axes.get_ylim())
            for line in axes.lines:
                assert lowest <= min(line.get_ydata()) <= max(line.get_ydata()) <= highest


def lines_of(axes):
    """What is drawn in a panel, by its name in the legend."""
    return {one.get_label(): one.get_xydata() for one in axes.lines}


def test_panels_have_a_mark_a_model_in_named_units():
    facts = summary(missed=["too coarse"])
    for figure in (draw_cost(facts), *draw_panels(facts).values()):
        for axes in (one for one in figure.axes if one.lines):
            axis = next(key for key, (name, _) in AXES.items() if name == axes.get_xlabel())
            lines = lines_of(axes)
            for label, key in (("true error (rms)", ERROR), ("error bound (95 %)", BOUND)):
                models = np.array([(one[axis], 1e3 * one[key]) for one in CURVE])
                assert lines[label] == pytest.approx(models)
            assert ("next halving of the bound" in lines) == (axis in HALVING_COSTS)
            if axis in HALVING_COSTS:  # from the last bound to its half
                (x, y), (to_x, to_y) = lines["next halving of the bound"]
                assert (x, y) == pytest.approx((CURVE[-1][axis], 1e3 * CURVE[-1][BOUND]))
                assert (to_x - x, to_y) == pytest.approx((FORECAST[axis], 0.5 * y))
            (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
            for points in (lines[label] for label in lines if " mm" not in label):
                assert ((left < points[:, 0]) & (points[:, 0] < right)).all()
                assert ((low < points[:, 1]) & (points[:, 1] < high)).all()
    texts = shown_by(draw_cost(facts))
    assert "What accuracy cost: <vase> (finished, goal missed)" in texts
    assert {"rms error, mm", *(name for name, _ in AXES.values())} < {*texts}
    assert {"1.00 s (100%)", "0.00 s", "simulator", "filter", "casting", "rest"} < {*texts}
    assert not [text for text in texts if "tolerance" in text]


def test_levels_cross_every_panel_and_shortest_of_too_many_bars_are_one():
    steps = {f"step {number}": 1.0 / (1 + number) for number in range(30)}
    figure = draw_cost(summary(tolerance_m=1e-6, steps=steps))
    for axes in figure.axes[:3]:
        lines = lines_of(axes)
        for label, level in (("tolerance 0.001 mm", 1e-3), ("sampling floor 0.008 mm", 8e-3)):
            assert lines[label] == pytest.approx(np.array([(0.0, level), (1.0, level)]))
    texts = shown_by(figure)
    assert {"17 others", "step 12"} < {*texts} and "step 13" not in texts


def test_log_scale_has_round_ticks_and_room_for_its_values():
    scale = log_scale([20.0, 110.0])
    assert 0.0 < scale.share(20.0) < scale.share(110.0) < 1.0
    middle = scale.share((20.0 * 110.0) ** 0.5)
    assert middle == pytest.approx(0.5 * (scale.share(20.0) + scale.share(110.0)))
    assert scale.ticks(7) == [20.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0]
    assert scale.ticks(3) == [20.0, 50.0, 100.0]
    assert log_scale([1e-7, 1e7]).ticks(5) == pytest.approx([1e-7, 1e-4, 0.1, 1e2, 1e5])
    assert log_scale([5.0]).share(5.0) == pytest.approx(0.5)


NOTE = {"dot": 'a <dot> & "more"'}


@charts.styled
def figure_of(values=(1.0, 20.0, 300.0), size=(320.0, 240.0)):
    figure = charts.new_figure(*size)
    axes = figure.subplots()
    axes.loglog(values, values, "o-", color=charts.BLUE, gid="dot", label="$5 < $6")
    axes.set(xlabel="cost, s", ylabel="error, mm")
    axes.grid()
    figure.legend()
    charts.log_ticks(axes)
    return figure


def test_figure_is_self_contained_text_for_light_and_dark_pages():
    text = charts.svg_text(figure_of(), "What <it> is", NOTE)
    assert text == charts.svg_text(figure_of(), "What <it> is", NOTE)
    assert not re.search(r"\b20\d\d-\d\d", text)  # no date
    root = ElementTree.fromstring(text)
    assert root.get("aria-label") == root.findtext(f"{SVG}title") == "What <it> is"
    assert {one.text for one in root.iter(f"{SVG}title")} == {"What <it> is", *NOTE.values()}
    texts = {one.text for one in root.iter(f"{SVG}text")}
    assert {"cost, s", "error, mm", "$5 < $6", "1", "10", "100"} < texts
    sides = [root.get(side) for side in ("width", "height")]
    assert [float((side or "").removesuffix("pt")) for side in sides] == [240.0, 180.0]
    assert not re.search(r"<image|<script|@import|@font-face|url\((?!#)", text)
    assert {*re.findall(r"https?://[\w.]+", text)} == {"http://www.w3.org"}  # its namespaces
    style, body = text.split("</style>", 1)
    for used in {*re.findall(r"(?:fill|stroke): #\w+", body)} - {f"stroke: {charts.GREY}"}:
        assert f'[style*="{used}"]' in style
    assert len(text) < 20_000


@pytest.mark.parametrize("width", [358.0, 670.0])
@pytest.mark.parametrize("most", [1.01, 1.3, 90.0, 1e4, 1e12])
def test_numbers_of_an_axis_do_not_touch(width, most):
    figure = figure_of((40.0, 40.0 * most), (width, 330.0))
    figure.canvas.draw()
    for axis, end in ((figure.axes[0].xaxis, "x"), (figure.axes[0].yaxis, "y")):
        labels = [one for one in axis.get_ticklabels() if one.get_text()]
        spans = [one.get_window_extent() for one in labels]
        low, high = f"{end}0", f"{end}1"
        assert len(spans) >= 2
        assert all(getattr(a, high) < getattr(b, low) for a, b in pairwise(spans))


def test_figure_is_written_whole_or_refused(tmp_path):
    path = charts.write_figure(figure_of(), tmp_path / "new" / "one.svg", "one")
    assert path.read_text("utf-8").startswith("<svg ")
    assert charts.write_figure(figure_of(), tmp_path / "one.png").read_bytes()[1:4] == b"PNG"
    (tmp_path / "two.png").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        charts.write_figure(figure_of(), tmp_path / "two.png")
