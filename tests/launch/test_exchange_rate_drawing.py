from itertools import pairwise
from typing import Any
from xml.etree import ElementTree

import pytest

from palpate.launch.exchange_rate import ERROR, PANEL, chart_of, draw_svg, draw_text, scale
from palpate.launch.printing import TEXT_WIDTH, TITLE_WIDTH

SVG = "{http://www.w3.org/2000/svg}"


def entry(touches, rms, bound, forecast=None, compute=True):
    return {
        "touches": touches,
        "robot_time_s": 2.5 * touches,
        "compute_s": 0.05 * touches if compute else None,
        "rms_m": rms,
        "rms_bound_95_m": bound,
        "forecast": forecast,
    }


FORECAST = {"touches": 40.0, "robot_time_s": 90.0}
CURVE = [
    entry(20, 3e-3, 8e-3),
    entry(40, 1e-3, 6e-3, FORECAST),
    entry(70, 1e-4, 9e-4),
    entry(110, 3e-5, 3e-5, FORECAST),
    entry(110, 2e-5, 3e-5, FORECAST),
]


def summary(curve: list[dict[str, Any]], **more: Any) -> dict[str, Any]:
    nodes = {"simulator": {"cpu_s": 1.0}, "filter": {"cpu_s": 0.5}}
    return {
        "curve": curve, "sampling_floor_m": 8e-6, "tolerance_m": None,
        "scene": "<vase>", "status": "finished",
        "contours": 4, "touches": 110, "robot_time_s": 275.0, "compute_s": 5.5, "missed": [],
        "largest_untouched_m": 2e-3, "steps": {"casting": 1.0, "rest": 0.0}, "nodes": nodes, **more,
    }  # fmt: skip


def without_truth(curve):
    return summary([{**one, "rms_m": None} for one in curve], sampling_floor_m=None)


def test_the_curve_in_text_shows_error_bound_floor_and_all_three_costs():
    lines = draw_text(summary(CURVE))
    text = "\n".join(lines)
    assert max(map(len, lines)) <= TEXT_WIDTH - TITLE_WIDTH
    assert "o stated bound (95 %)" in text and "* true error (rms)" in text
    assert "@ both" in text  # the last but one error is as large as its bound
    assert "sampling floor 0.008 mm" in text and "- - - - -" in text
    costs = {line.partition("  ")[2].split()[0]: line.split() for line in lines[-5:-2]}
    assert [line.split()[-1] for line in lines[-5:-2]] == ["110", "275", "5.5"], costs
    assert lines[-5].split() == ["touches", "20", "40", "70", "110"]
    # The higher the error, the higher its mark; the later, the farther to the right.
    marks = [(row, line.index("*")) for row, line in enumerate(lines[:9]) if "*" in line]
    assert marks == sorted(marks) and len(marks) >= 3


@pytest.mark.parametrize(
    ("found", "shown", "hidden"),
    [
        (summary(CURVE[:1]), "*", "@ both"),
        (without_truth(CURVE), "o", "true error"),
        (without_truth(CURVE[:1]), "o", "sampling floor"),
        (summary([entry(20, 3e-3, None, compute=False)]), "*", "bound"),
        (summary(CURVE, sampling_floor_m=1e-9), "*", "floor"),
        (summary(CURVE, sampling_floor_m=0.0), "*", "floor"),
    ],
)
def test_one_model_no_truth_no_bound_and_no_floor_are_drawn_sanely(found, shown, hidden):
    text = "\n".join(draw_text(found))
    assert shown in text and hidden not in text
    ElementTree.fromstring(draw_svg(found))


def test_without_a_model_nothing_is_drawn_but_times():
    nothing = summary([entry(20, None, None)], steps={}, nodes={}, scene=None, compute_s=None)
    for found in (nothing, {**nothing, "curve": [], "largest_untouched_m": None}):
        assert draw_text(found) == []
        assert "no model was judged" in draw_svg(found)


def marked(root: ElementTree.Element, tag: str, kind: str) -> list[ElementTree.Element]:
    return [one for one in root.iter(f"{SVG}{tag}") if one.get("class") == kind]


def test_the_picture_has_three_panels_with_a_mark_a_model_and_bars():
    root = ElementTree.fromstring(draw_svg(summary(CURVE, missed=["too coarse"])))
    assert len(marked(root, "rect", "frame")) == 3
    assert len(marked(root, "circle", "true")) == len(marked(root, "rect", "stated")) == 15 + 1
    assert len(marked(root, "circle", "forecast")) == 2  # nobody foretells compute time
    assert len(marked(root, "rect", "bar")) == 4
    texts = [one.text or "" for one in root.iter(f"{SVG}text")]
    assert "What accuracy cost: <vase> (finished, goal missed)" in texts
    assert "1.00 s (100 %)" in texts and "0.00 s" in texts
    lefts = [float(one.get("x", 0)) for one in marked(root, "rect", "frame")]
    for one in marked(root, "circle", "true")[1:]:
        assert any(left <= float(one.get("cx", 0)) <= left + PANEL for left in lefts)


def test_where_there_are_too_many_bars_the_shortest_are_one():
    steps = {f"step {number}": 1.0 / (1 + number) for number in range(30)}
    text = draw_svg(summary(CURVE, steps=steps))
    assert "17 others" in text and "step 12" in text and "step 13" not in text


def test_the_forecast_leads_from_the_last_model_to_half_its_bound():
    chart = chart_of(summary(CURVE), "touches")
    assert chart is not None and chart.forecast == ((110, 3e-5), (150.0, 1.5e-5))
    blind = chart_of(without_truth(CURVE), "robot_time_s")
    assert blind is not None and blind.forecast == ((275.0, 3e-5), (365.0, 1.5e-5))
    compute = chart_of(summary(CURVE), "compute_s")
    assert compute is not None and compute.forecast is None
    assert len(compute.series[ERROR]) == 5


def test_a_log_scale_has_round_ticks_and_room_for_all_its_values():
    found = scale([20.0, 110.0], 0.0, 100.0)
    assert 0.0 < found.at(20.0) < found.at(110.0) < 100.0
    assert found.ticks(7) == [20.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0]
    assert found.ticks(3) == [20.0, 50.0, 100.0]
    assert scale([5.0], 0.0, 10.0).at(5.0) == pytest.approx(5.0)


def test_the_tolerance_is_a_line_across_every_panel_and_has_room():
    told = summary(CURVE, tolerance_m=1e-6)
    root = ElementTree.fromstring(draw_svg(told))
    lines = [one.get("points", "").split() for one in root.iter(f"{SVG}polyline")
             if one.get("class") == "tolerance"]  # fmt: skip
    assert len(lines) == 3 + 1  # and one in the legend
    heights = {float(place.partition(",")[2]) for line in lines[1:] for place in line}
    assert len(heights) == 1
    texts = [one.text for one in root.iter(f"{SVG}text")]
    assert "tolerance 0.001 mm" in texts
    without = ElementTree.fromstring(draw_svg(summary(CURVE)))
    assert not [one for one in without.iter() if one.get("class") == "tolerance"]


def test_labels_of_ticks_do_not_run_into_each_other():
    root = ElementTree.fromstring(
        draw_svg(summary([entry(38, 1e-3, 2e-3), entry(200, 1e-4, 1e-3)]))
    )
    labels = [(float(one.get("x", "0")), one.text or "") for one in root.iter(f"{SVG}text")
              if one.get("class") == "small middle"]  # fmt: skip
    for (left, text), (right, _) in pairwise(labels):
        assert right - left > 7.0 * len(text) or right < left
