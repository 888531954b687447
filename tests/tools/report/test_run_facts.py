from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.messages.types import Contour
from palpate.tools.report.run_facts import effect_costs, places_of, read_run
from palpate.tools.view import Timeline, read_timeline


@pytest.fixture
def line(contour: Contour) -> Timeline:
    found = Timeline()
    found.add(contour)
    return found


def gaping(contour: Contour, **more: Any) -> Contour:
    ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.02, 0.0]])
    return replace(
        contour,
        gap_starts=ends[:1],
        gap_ends=ends[1:],
        gap_reasons=("bridged",),
        **more,
    )


def test_a_gap_leads_to_its_middle_at_its_contours_time(contour):
    line = Timeline()
    line.add(gaping(contour))
    (place,) = places_of(line, {})
    assert place.kind == "gaps in contours"
    assert "20.000 mm bridged" in place.text
    assert place.point.tolist() == [0.0, 0.01, 0.0]
    assert place.time == contour.robot_time


def test_a_contour_that_did_not_close_leads_to_where_it_ended(contour):
    line = Timeline()
    line.add(replace(contour, status="stuck"))
    (place,) = places_of(line, {})
    assert place.kind == "contours that did not close"
    assert place.point.tolist() == contour.points[-1].tolist()


def test_touches_that_fit_badly_or_not_at_all_are_named(run_folder):
    line = read_timeline(run_folder)
    residual = float(np.median([one.residual for one in line.touches]))
    line.touches[3] = line.touches[3]._replace(residual=9.0 * residual)
    line.touches[5] = line.touches[5]._replace(kind="insufficient")
    line.touches[7] = line.touches[7]._replace(outcome="bottomed")
    found: dict[str, list[float]] = {}
    for one in places_of(line, {}):
        found.setdefault(one.kind, []).append(one.time)
    assert line.touches[3].time in found["touches that fit badly"]
    poor = [line.touches[5].time, line.touches[7].time]
    assert found["touches too poor for a local fit"] == poor


def test_what_was_not_touched_and_left_out_is_named(run_folder, contour):
    line = read_timeline(run_folder)
    last, first = line.models[-1], line.contours[0].id
    line.models[-1] = replace(
        last, dropped=(first,), dropped_reasons=("it crosses itself",), openings=np.zeros((1, 3))
    )
    kinds = {one.kind: one.text for one in places_of(line, {"open_places_m": [[0.01, 0, 0.02]]})}
    assert kinds["contours left out of the fit"] == f"contour {first}: it crosses itself"
    assert kinds["unknown places"] == "1: the widest"
    assert "hollows" in kinds


def test_an_effect_costs_time_and_without_effects_nothing_is_told(run_folder):
    from palpate.nodes import simulator
    from palpate.nodes.specs import ObjectSpec

    facts = read_run(run_folder)
    names = [one.name for one in facts.effects]
    assert "gaussian_noise" in names
    assert "cast" in names
    assert all(one.seconds > 0.0 for one in facts.effects)
    assert facts.line is not None
    shape = {"superquadric": {"size": [0.03, 0.03, 0.03], "exponents": [1.0, 1.0]}}
    import msgspec

    bare = simulator.Params(object=msgspec.convert(shape, ObjectSpec))
    assert list(effect_costs(bare, facts.line)) == []


def test_without_effects_the_page_says_that_none_was_simulated(run_folder, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(run_folder, folder)
    text = (folder / "launch.yaml").read_text()
    cut = re.sub(r"\n( +)effects:\n(?:\1 +.*\n)+", r"\n\1effects: {}\n", text)
    assert cut != text
    (folder / "launch.yaml").write_text(cut)
    assert read_run(folder).effects == ()
    (folder / "topics.mcap").unlink()
    assert read_run(folder).effects == ()


def test_warnings_and_errors_of_the_log_are_kept_and_nothing_else(run_folder, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(run_folder, folder)
    lines = [{"level": level, "node": "filter", "text": level} for level in ("info", "warning")]
    (folder / "log.jsonl").write_text("".join(json.dumps(one) + "\n" for one in lines))
    assert [one["text"] for one in read_run(folder).log] == ["warning"]
