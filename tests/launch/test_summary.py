from __future__ import annotations

import dataclasses
import json
from typing import Any

import numpy as np
import pytest

from palpate.launch.printing import TEXT_WIDTH, summary_text
from palpate.launch.progress import Progress
from palpate.launch.run_directory import exit_code, summarise
from palpate.messages.types.catalogue import NodeStatus
from palpate.messages.types.model import Score, ShapeModel
from palpate.nodes.runtime.composed import Ending

KEYS = {
    "palpate", "status", "reason", "scene", "seed", "chamfer_m", "rms_m", "hausdorff_m", "p95_m",
    "normal_deg", "volume_error", "sampling_floor_m", "size_m", "watertight", "genus", "contours",
    "contours_failed", "uncovered_m", "rms_bound_95_m", "tolerance_met", "largest_untouched_m",
    "contacts", "touches", "robot_time_s", "ready_s", "wall_s", "compute_s", "touches_per_s",
    "mesh_sha256", "final", "gaps", "duplicates", "restarts", "nodes", "numerics", "curve",
}  # fmt: skip


def ending(status: Any = "finished", reason: str = "all slices are traced") -> Ending:
    filter_status = NodeStatus(
        node="filter",
        state="ending",
        messages=40,
        sent=40,
        gaps=0,
        duplicates=0,
        p50=80.0,
        p99=120.0,
        cpu=1.5,
    )
    return Ending(status=status, reason=reason, statuses={"filter": filter_status})


@pytest.fixture
def progress(tetrahedron: ShapeModel, score: Score) -> Progress:
    return Progress(
        contours=2,
        touches=40,
        robot_time=20.0,
        ready=0.5,
        reports=[(0.5, 0), (2.5, 40)],
        wall=4.0,
        model=tetrahedron,
        scores=[(3.0, score)],
    )


def test_the_keys_are_stable_whatever_happened(progress):
    assert set(summarise(ending(), progress, "vase", 7)) == KEYS
    assert set(summarise(ending("died"), Progress(), None, None)) == KEYS


def test_a_summary_holds_the_figures_of_the_run(progress, score):
    found = summarise(ending(), progress, "vase", 7)
    assert found["chamfer_m"] == 0.0003
    assert found["touches_per_s"] == 20.0  # 40 in the 2 s between the reports
    assert found["compute_s"] == 1.5
    assert found["nodes"]["filter"] == {
        "messages": 40, "sent": 40, "p50_us": 80.0, "p99_us": 120.0, "cpu_s": 1.5,
    }  # fmt: skip
    assert found["numerics"] == {"condition": 3.5, "fallbacks": 0.0}
    assert found["curve"] == [
        {
            "contours": 2,
            "touches": 40,
            "robot_time_s": 20.0,
            "wall_s": 3.0,
            "chamfer_m": 0.0003,
            "rms_m": score.rms,
        }
    ]
    assert json.loads(json.dumps(found, allow_nan=False)) == found


def test_what_is_unknown_is_null():
    found = summarise(Ending(status="died", reason="x"), Progress(), None, None)
    unknown = ("chamfer_m", "watertight", "mesh_sha256", "compute_s", "touches_per_s", "ready_s")
    assert {found[key] for key in unknown} == {None}


@pytest.mark.parametrize(
    ("status", "code"), [("finished", 0), ("died", 3), ("stalled", 3), ("interrupted", 130)]
)
def test_the_exit_code_says_how_it_ended(progress, status, code):
    assert exit_code(summarise(ending(status), progress, "vase", 7), rebuilds=True) == code


def test_a_run_without_a_solid_has_missed_its_goal(progress, tetrahedron, score):
    def code(rebuilds: bool = True) -> int:
        return exit_code(summarise(ending(), progress, "vase", 7), rebuilds=rebuilds)

    progress.scores = [(1.0, dataclasses.replace(score, watertight=False))]
    assert code() == 1
    progress.scores = []
    assert code() == 0
    progress.model = dataclasses.replace(tetrahedron, final=False)
    assert code() == 1
    progress.model = dataclasses.replace(tetrahedron, faces=np.zeros((0, 3), np.int32))
    assert code() == 1
    progress.model = None
    assert code() == 1
    assert code(rebuilds=False) == 0


def test_the_closing_words_fit_on_a_screen(progress, tmp_path):
    summary = summarise(ending(reason="the tracer died of " + "x " * 300), progress, "vase", 7)
    files = [f"a_rather_long_name_{i}.json" for i in range(9)]
    lines = summary_text(summary, files, tmp_path / "r").splitlines()
    assert max(map(len, lines[:-1])) <= TEXT_WIDTH
    text = "\n".join(lines)
    assert "chamfer 0.300 mm (1.00 % of the height)" in text
    assert "sampling floor 0.050 mm" in text
    assert "watertight yes" in text
    assert ["filter", "40", "80", "120", "1.50"] in [line.split() for line in lines]
    assert all(name in text for name in files)
    assert lines[-1] == f"run        {tmp_path / 'r'}"


def test_the_closing_words_do_without_figures(tmp_path):
    summary = summarise(Ending(status="died", reason="boom"), Progress(), None, None)
    lines = summary_text(summary, [], tmp_path).splitlines()
    assert lines[0] == "result     no model was measured"
    assert "died       boom" in lines


def test_the_closing_words_tell_what_the_run_promises_of_its_error(progress, tmp_path):
    summary = summarise(ending(), progress, "vase", 7)
    summary |= {"rms_bound_95_m": 28e-6, "rms_m": 16e-6, "largest_untouched_m": 2.5e-3}
    text = summary_text(summary, [], tmp_path)
    assert "rms below 0.028 mm (95 %), in truth 0.016 mm" in text
    assert "untouched at most 2.500 mm" in text
