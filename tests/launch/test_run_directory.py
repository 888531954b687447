import dataclasses
import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from palpate.launch import run_directory as run_dir
from palpate.launch.files.source_map import InputError
from palpate.launch.progress import Progress
from palpate.launch.run_directory import choose_run_directory, exit_code, read_summary, summarise
from palpate.launch.summary_text import headline_text
from palpate.messages.types.catalogue import NodeStatus
from palpate.messages.types.model import PlanDone, PlanEstimate
from palpate.nodes.runtime.composed import Ending


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_choosing_leaves_no_trace_and_latest_is_the_last_run_made():
    folder = choose_run_directory("vase", None)
    assert re.fullmatch(r"runs/\d{4}-\d\d-\d\dT\d\d-\d\d-\d\d_vase", str(folder.path))
    assert not Path("runs").exists()
    for name in ("one", "two"):
        choose_run_directory(name, None).create()
    assert Path("runs/latest").resolve().name.endswith("_two")
    assert len([p for p in Path("runs").iterdir() if not p.is_symlink()]) == 2
    assert not any(p.name.startswith(".") for p in Path("runs").iterdir())


def test_two_runs_in_one_second_get_a_folder_each(monkeypatch):
    monkeypatch.setattr(run_dir.time, "strftime", lambda _: "now")
    for _ in range(3):
        choose_run_directory("vase", None).create()
    names = {path.name for path in Path("runs").iterdir()}
    assert names == {"now_vase", "now_vase-2", "now_vase-3", "latest"}


def test_a_folder_that_the_user_chooses_is_taken_as_it_is():
    folder = choose_run_directory("vase", Path("here/there"))
    folder.create()
    assert not any(folder.path.iterdir())
    assert not Path("here/latest").exists()


def test_files_are_written_whole_and_only_as_json_has_them(tmp_path):
    folder = choose_run_directory("vase", Path("here"))
    folder.create()
    folder.write_json("summary.json", {"a": 1.5, "b": None})
    assert os.listdir("here") == ["summary.json"]
    assert json.loads(Path("here/summary.json").read_text()) == {"a": 1.5, "b": None}
    with pytest.raises(ValueError, match="not JSON compliant"):
        folder.write_json("summary.json", {"a": float("nan")})


def test_a_folder_that_holds_something_is_refused():
    Path("here").mkdir()
    Path("here/x").write_text("mine")
    with pytest.raises(InputError, match="--out here: is not empty"):
        choose_run_directory("vase", Path("here"))


def test_a_file_in_the_place_of_the_folder_is_refused():
    Path("here").write_text("mine")
    with pytest.raises(InputError, match="--out here: is a file"):
        choose_run_directory("vase", Path("here"))


def test_a_folder_whose_name_is_no_text_is_refused_before_anything_is_made():
    with pytest.raises(InputError, match="its name is no text in UTF-8, so that nodes could not"):
        choose_run_directory("vase", Path("here\udcff"))
    assert not any(Path().iterdir())


def test_a_folder_that_cannot_be_made_is_refused():
    Path("file").write_text("mine")
    with pytest.raises(InputError, match="file/here: cannot be written: Not a directory"):
        choose_run_directory("vase", Path("file/here")).create()


def test_a_folder_that_cannot_be_written_is_refused(monkeypatch):
    def refuse(*_):
        raise OSError(30, os.strerror(30))

    monkeypatch.setattr(Path, "write_bytes", refuse)
    with pytest.raises(InputError, match="cannot be written: Read-only file system"):
        choose_run_directory("vase", Path("here")).create()


def test_a_disk_that_is_too_full_is_refused_before_anything_is_made(tmp_path):
    folder = choose_run_directory("vase", tmp_path / "a" / "run")
    folder.check_room(0)
    with pytest.raises(InputError, match=r"a/run: only \d+ MiB are free on its disk, and the"):
        folder.check_room(1 << 60)
    assert list(tmp_path.iterdir()) == []


KEYS = {
    "palpate", "status", "reason", "scene", "seed", "chamfer_m", "rms_m", "hausdorff_m", "p95_m",
    "normal_deg", "volume_error", "sampling_floor_m", "size_m", "watertight", "genus", "contours",
    "contours_failed", "uncovered_m", "rms_bound_95_m", "tolerance_m", "tolerance_met",
    "largest_untouched_m", "limits", "criteria", "reached", "true_genus", "self_crossings",
    "open_share", "open_width_m", "open_places_m", "open_normals", "open_touches",
    "under_share", "method",
    "predicted_m", "rejected",
    "contacts", "touches", "robot_time_s", "ready_s", "wall_s", "compute_s", "touches_per_s",
    "mesh_sha256", "final", "gaps", "duplicates", "restarts", "nodes", "numerics", "curve",
    "steps", "missed", "procedure",
}  # fmt: skip


def ending(status="finished", reason="all slices are traced"):
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
        steps={"filter": 1.0},
    )
    return Ending(status=status, reason=reason, statuses={"filter": filter_status})


@pytest.fixture
def progress(tetrahedron, score):
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


def test_a_summary_has_the_same_keys_and_null_for_what_is_unknown(progress):
    assert set(summarise(ending(), progress, "vase", 7)) == KEYS
    assert set(summarise(ending("died"), Progress(), None, None)) == KEYS
    found = summarise(Ending(status="died", reason="x"), Progress(), None, None)
    unknown = ("chamfer_m", "watertight", "mesh_sha256", "compute_s", "touches_per_s", "ready_s")
    assert {found[key] for key in unknown} == {None}


def test_a_summary_holds_the_figures_of_the_run(progress, score):
    found = summarise(ending(), progress, "vase", 7)
    assert found["chamfer_m"] == 0.0003
    assert found["touches_per_s"] == 20.0  # 40 in the 2 s between the reports
    assert found["compute_s"] == 1.5
    assert found["nodes"]["filter"] == {
        "messages": 40, "sent": 40, "p50_us": 80.0, "p99_us": 120.0, "cpu_s": 1.5,
    }  # fmt: skip
    assert found["numerics"] == {"condition": 3.5, "fallbacks": 0.0}
    assert found["steps"] == {"filter": 1.0, "rest": 0.5}
    nothing = ("compute_s", "rms_bound_95_m", "largest_untouched_m", "forecast", "halved", "ratio")
    assert found["curve"] == [
        {
            "contours": 2,
            "touches": 40,
            "robot_time_s": 20.0,
            "wall_s": 3.0,
            "chamfer_m": 0.0003,
            "rms_m": score.rms,
            **dict.fromkeys(nothing),
        }
    ]
    assert json.loads(json.dumps(found, allow_nan=False)) == found


@pytest.mark.parametrize(
    ("status", "code"), [("finished", 0), ("died", 3), ("stalled", 3), ("interrupted", 130)]
)
def test_the_exit_code_tells_how_it_ended(progress, status, code):
    assert exit_code(summarise(ending(status), progress, "vase", 7), rebuilds=True) == code


def test_a_run_without_a_solid_has_missed_its_goal(progress, tetrahedron, score):
    def code(rebuilds=True):
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


def planned(found, limits, reason="the budget is spent: 40 of 40 touches"):
    return PlanDone(
        number=3, contours=(1, 2), probes=(), touches=40, robot_time=20.0, reason=reason,
        reached=None, rms_bound_95=found.get("error_bound"), largest_untouched=2.5e-3,
        uncovered=0.0, findings=found, limits=limits,
    )  # fmt: skip


KEPT = {"error_bound": 6e-4, "unknown_share": 4e-3, "untouched_gap": 9e-3, "unentered_hole": 0.0}
ASKED = {"tolerance": 1e-3, "feature": 0.02, "unknown_share": 0.01}


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({}, []),
        ({"error_bound": 3e-3}, ["error bound 3.000 mm (limit 1 mm)"]),
        ({"unknown_share": 0.03}, ["unknown share 3.0 % (limit 1 %)"]),
        ({"untouched_gap": 0.03}, ["untouched gap 30.000 mm (limit 20 mm)"]),
        ({"unentered_hole": 5e-3}, ["unentered hole 5.000 mm (none is allowed)"]),
        ({"untraced_height": 5e-3}, ["untraced height 5.000 mm (none is allowed)"]),
        (
            {"error_bound": 3e-3, "underside_error": 7e-3, "underside_share": 0.16},
            ["error bound 3.000 mm (limit 1 mm)", "underside error 7.000 mm (limit 2.5 mm)"],
        ),
    ],
)
def test_the_limit_that_is_not_kept_is_named_whatever_ended_the_run(
    progress, changes, told, tmp_path
):
    progress.done = planned(KEPT | changes, ASKED)
    summary = summarise(ending(), progress, "vase", 7)
    code = int(bool(told))
    assert [exit_code(summary, rebuilds=rebuilds) for rebuilds in (True, False)] == [code, code]
    assert (summary["reached"], summary["missed"]) == (not told, told)
    assert summary["limits"] == {"tolerance_m": 1e-3, "feature_m": 0.02, "unknown_share": 0.01}
    text = " ".join(headline_text(summary, [], tmp_path).split())
    assert ("missed" in text) == bool(told) and all(one in text for one in told)
    assert "the budget is spent: 40 of 40 touches" in text


def test_a_bound_that_nobody_can_state_is_not_within_any_tolerance(progress):
    progress.done = planned({}, ASKED)
    summary = summarise(ending(), progress, "vase", 7)
    assert summary["missed"] == ["no error bound can be stated (limit 1.000 mm)"]
    progress.done = planned({}, {"unknown_share": 0.01})
    assert summarise(ending(), progress, "vase", 7)["missed"] == []


@pytest.mark.parametrize(
    ("model", "score_changes", "told", "kind"),
    [
        ({"genus": 2}, {"genus": 2, "true_genus": 2}, [], "a closed solid with 2 holes through it"),
        ({}, {"true_genus": 1}, ["genus 0 (the object's is 1)"], "a closed solid,"),
        ({"self_crossings": 6}, {}, ["6 self-crossings"], "a surface that crosses itself"),
        ({"closed": False, "genus": None}, {}, ["1 open surface"], "a surface that is NOT closed"),
        ({"missing": 2e-3}, {}, ["error bound 2.000 mm (limit 1 mm)"], "a closed solid,"),
        ({}, {"rms": 2e-3}, ["rms error 2.000 mm (limit 1 mm)"], "a closed solid,"),
    ],
)
def test_what_the_mesh_and_the_truth_say_is_judged_too(
    progress, tetrahedron, score, model, score_changes, told, kind, tmp_path
):
    facts = {"closed": True, "genus": 0, "self_crossings": 0} | model
    progress.model = dataclasses.replace(tetrahedron, **facts)
    progress.scores = [(3.0, dataclasses.replace(score, **score_changes))]
    progress.done = planned(KEPT, ASKED)
    summary = summarise(ending(), progress, "vase", 7)
    assert summary["missed"] == told and exit_code(summary, rebuilds=True) == bool(told)
    assert kind in headline_text(summary, [], tmp_path)


def test_an_interrupted_run_tells_what_was_known_by_then(progress):
    progress.estimates = [
        (3.0, PlanEstimate(
            number=2, contours=2, touches=40, robot_time=20.0, rms_bound_95=4e-4,
            largest_untouched=9e-3, halving_touches=None, halving_seconds=None,
        )),
    ]  # fmt: skip
    summary = summarise(ending("interrupted", "Ctrl-C"), progress, "vase", 7)
    assert (summary["rms_bound_95_m"], summary["largest_untouched_m"]) == (4e-4, 9e-3)
    assert (summary["reached"], summary["missed"]) == (None, [])
    assert exit_code(summary, rebuilds=True) == 130


def test_a_summary_is_read_again_or_refused_with_the_reason(progress, tmp_path):
    folder = choose_run_directory("vase", Path("here"))
    folder.create()
    summary = summarise(ending(), progress, "vase", 7)
    folder.write_summary(summary)
    assert sorted(os.listdir("here")) == ["cost.svg", "summary.json"]
    assert read_summary(Path("here")) == summary
    with pytest.raises(InputError, match=r"there: is no directory of a run: there is no summary"):
        read_summary(Path("there"))
    for text, why in (("{", "is no JSON"), ("[]", "must hold a map, got list")):
        Path("here/summary.json").write_text(text)
        with pytest.raises(InputError, match=f"here/summary.json: {why}"):
            read_summary(Path("here"))
