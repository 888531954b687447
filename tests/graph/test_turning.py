"""A whole exploration of an object that is turned over, asked everything at once."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from palpate.launch.run_directory import read_summary
from tests.graph.conftest import palpate

pytestmark = pytest.mark.graph
SCENE = {
    "object": {
        "superquadric": {"size": [0.026, 0.018, 0.014], "exponents": [0.6, 0.8], "taper": [0.3, 0]},
        "pose": {"position": [0, 0, 0.014]},
    },
    "effects": [{"pose_error": {"sigma": 1e-4}}, {"gaussian_noise": {"sigma": 1e-5}}],
    "explore": {"planner": "touches", "tolerance": 3e-4, "underside": "known"},
    "seed": 3,
}


def test_underside_is_known_once_it_was_turned_over_and_all_of_it_is_replayed(tmp_path: Path):
    scene, out = tmp_path / "scene.yaml", tmp_path / "out"
    scene.write_text(json.dumps(SCENE))
    done = palpate("run", scene, "--composed", "--out", out)
    assert done.code == 0, done.out + done.err
    words = " ".join((done.out + done.err).split())
    assert "1 turn" in words and "turned over at most once, where that pays" in words
    summary = read_summary(out)
    assert summary["turns"] == 1 and len(summary["placements"]) == 1
    assert summary["placement_errors_m"][0] < 0.2e-3
    limits = {one["name"]: one["is_met"] for one in summary["criteria"]}
    assert limits["underside"] and limits["error bound"]
    assert summary["rms_m"] < summary["rms_bound_95_m"] < 3e-4
    again = palpate("replay", out, "--nodes", "planner,reconstructor")
    assert again.code == 0 and again.out.count("identical") == 2, again.out + again.err
    assert (out / "report.html").stat().st_size > 100_000


@pytest.mark.slow
def test_without_turns_the_underside_stays_unknown(tmp_path: Path):
    scene, out = tmp_path / "scene.yaml", tmp_path / "out"
    scene.write_text(json.dumps(SCENE))
    done = palpate("run", scene, "--composed", "--turns", "0", "--out", out)
    words = " ".join((done.out + done.err).split())
    assert done.code == 1 and "turned over never (--turns 0)" in words
    summary = read_summary(out)
    assert summary["turns"] == 0 and summary["placements"] == []
    assert [one["name"] for one in summary["criteria"] if not one["is_met"]] == ["underside"]
    refused = palpate("run", scene, "--turns", "9", "--out", tmp_path / "none")
    assert refused.code == 2 and "--turns 9: must be from 0 to 8" in refused.err
    assert not (tmp_path / "none").exists()
