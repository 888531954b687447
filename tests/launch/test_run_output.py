"""What a run prints and leaves: tables, progress, directory, summary, exit code, headline."""

import io
import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.launch.files.source_map import InputError, SourceMapped
from palpate.launch.launch_source import EXPLORE
from palpate.launch.printing import TEXT_WIDTH, text_table
from palpate.launch.progress import (
    Display,
    LineDisplay,
    LiveDisplay,
    Progress,
    ProgressWatcher,
    open_display,
    progress_share,
    progress_text,
)
from palpate.launch.run import load_run, perform, plan_run
from palpate.launch.run_directory import (
    choose_run_directory,
    exit_code,
    find_bag,
    find_run_mesh,
    read_summary,
    summarise,
)
from palpate.launch.summary_text import details_text, headline_text
from palpate.messages import types
from palpate.nodes.runtime.composed import Ending
from palpate.nodes.runtime.node import Finished, Node
from palpate.testing import example

pytestmark = pytest.mark.usefixtures("here")
RUN = Path("runs/r")


def test_table_is_aligned_and_broken_to_80_columns_without_loss():
    rows = [("topic", "n", "to"), ("/a", "12", ""), ("/[b]x", "3", ":smile:")]
    assert text_table(rows, (1,)) == ["topic   n  to", "/a     12", "/[b]x   3  :smile:"]
    assert "x" * 200 in text_table([("a", "b"), ("x" * 200, "1")], min_widths=(1, 3))
    assert text_table([("a", "b")], (1,), (3, 4)) == ["a       b"]
    names = ", ".join(f"node_{number}" for number in range(12))
    wide = [("topic", "field", "first", "told"), (50 * "x", 40 * "y", "1.5", "word " * 20)]
    for rows, right in (
        ([("topic", "to"), ("/a", names)], ()),
        ([("topic", "to"), (70 * "x", names)], ()),
        (wide, (2,)),
    ):
        lines = text_table(rows, right=right)
        assert max(map(len, lines)) <= 80
        words = " ".join(cell for row in rows for cell in row).split()
        assert sorted(" ".join(lines).split()) == sorted(words)


def record(text="the pad slipped", level="warning"):
    return types.LogRecord(node="tracer", level=level, text=text, robot_time=2.5)


def estimate(bound):
    return example(types.PlanEstimate, number=2, rms_bound_95=bound, largest_untouched=9e-3)


def test_progress_adds_up_fills_its_bar_and_log_is_json(contour, tetrahedron, score):
    log = io.StringIO()
    watcher = ProgressWatcher(3, Display(), log)
    watcher.ready(0.5)
    for message in (contour, replace(contour, robot_time=9.0), tetrahedron, score):
        watcher.received("/any", message)
    watcher.tick({})
    assert watcher.progress.compute_at(1.0) is None
    watcher.tick({name: example(types.NodeStatus, node=name, cpu=1.5) for name in "ab"})
    progress = watcher.progress
    assert (progress.contours, progress.touches, progress.robot_time) == (2, 60, 15.0)
    assert (progress.ready, progress.model, progress.score) == (0.5, tetrahedron, score)
    assert 0.0 <= progress.model_times[tetrahedron.number] <= progress.wall
    assert progress.compute_at(progress.wall) == 3.0
    assert 0.0 <= progress.scores[0][0] <= progress.wall
    watcher.log(record())
    line = json.loads(log.getvalue())
    assert line.pop("wall_s") >= 0.0
    fields = {"node": "tracer", "level": "warning", "text": "the pad slipped", "robot_time_s": 2.5}
    assert line == fields
    progress = Progress(tolerance=1e-4)
    assert progress_share(progress) == 0.0
    for bound, share in ((1e-2, 0.0), (1e-3, 0.5), (None, 0.5), (1e-4, 1.0), (5e-5, 1.0)):
        progress.estimates.append((1.0, estimate(bound)))
        assert progress_share(progress) == pytest.approx(share)
    progress.tolerance = None
    assert progress_share(progress) == 0.0


def test_plain_lines_come_once_a_contour_and_once_a_warning(score):
    stream = io.StringIO()
    lines, progress = LineDisplay(stream), Progress(touches=4, wall=1.0, tolerance=2e-4)
    lines.ready(8, 1.25)
    lines.show(progress)
    progress.contours, progress.touches, progress.wall = 1, 20, 2.0
    lines.show(progress)
    lines.show(progress)
    progress.contours, progress.estimates = 2, [(2.0, estimate(4e-4))]
    progress.scores.append((1.0, score))
    lines.show(progress)
    for item in (record(), record(), record("all is well", "info")):
        lines.note(item)
    progress.touches = 45
    lines.show(progress)
    lines.close()
    assert stream.getvalue().splitlines() == [
        "ready    8 nodes in 1.2 s",
        "tracing  1 contour  20 touches  2 s",
        "tracing  2 contours  20 touches  bound 0.400 of 0.2 mm  true 0.400 mm  2 s",
        "warning  tracer: the pad slipped",
        "tracing  2 contours  45 touches  bound 0.400 of 0.2 mm  true 0.400 mm  2 s",
    ]


def test_display_suits_the_terminal_and_shows_bound_bar_and_contour(score, capfd, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    goal = example(types.ContourGoal, height=0.035, reason="the widest gap")
    progress = Progress(
        contours=99, touches=9999, wall=999.0, tolerance=2e-4, scores=[(1.0, score)], goal=goal,
        estimates=[(1.0, estimate(91.977e-3))],
    )  # fmt: skip
    assert len(progress_text(progress)) <= 71
    live = LiveDisplay()
    live.show(progress)
    live.note(record())
    live.close()
    live.close()
    shown = capfd.readouterr().err
    assert "warning  tracer: the pad slipped" in shown
    assert "contour at 35 mm: the widest gap" in shown and "bound 91.977 of 0.2 mm" in shown
    monkeypatch.setattr(sys.stderr, "isatty", lambda: False, raising=False)
    assert type(open_display(quiet=False)) is LineDisplay
    assert type(open_display(quiet=True)) is Display
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    assert type(open_display(quiet=False)) is LiveDisplay
    silence = Display()
    silence.ready(1, 1.0)
    silence.show(Progress(scores=[(1.0, score)]))
    silence.note(record())
    silence.close()
    assert capfd.readouterr() == ("", "")


def test_directory_is_made_when_needed_and_its_files_are_written_whole(monkeypatch):
    folder = choose_run_directory("vase", None)
    assert re.fullmatch(r"runs/\d{4}-\d\d-\d\dT\d\d-\d\d-\d\d_vase", str(folder.path))
    assert not Path("runs").exists()
    monkeypatch.setattr("palpate.launch.run_directory.time.strftime", lambda _: "now")
    for _ in range(3):
        choose_run_directory("vase", None).create()
    choose_run_directory("two", None).create()
    names = {path.name for path in Path("runs").iterdir()}
    assert names == {"now_vase", "now_vase-2", "now_vase-3", "now_two", "latest"}
    assert Path("runs/latest").resolve().name == "now_two"
    folder = choose_run_directory("vase", Path("here/there"))
    folder.create()
    assert not any(folder.path.iterdir()) and not Path("here/latest").exists()
    folder.write_json("summary.json", {"a": 1.5, "b": None})
    assert os.listdir("here/there") == ["summary.json"]
    assert json.loads(Path("here/there/summary.json").read_text()) == {"a": 1.5, "b": None}
    with pytest.raises(ValueError, match="not JSON compliant"):
        folder.write_json("summary.json", {"a": float("nan")})
    folder.check_room(0)
    with pytest.raises(InputError, match=r"only \d+ MiB are free on its disk, and the"):
        folder.check_room(1 << 60)


@pytest.mark.parametrize(("name", "words"), [
    ("full", "--out full: is not empty"),
    ("file", "--out file: is a file"),
    ("here\udcff", "its name cannot be encoded in UTF-8 for the nodes"),
    ("file/here", "file/here: cannot be written: Not a directory"),
])  # fmt: skip
def test_unusable_directory_is_refused(name, words):
    Path("full").mkdir()
    Path("full/x").touch()
    Path("file").touch()
    with pytest.raises(InputError, match=words):
        choose_run_directory("vase", Path(name)).create()
    assert sorted(os.listdir()) == ["file", "full"]


def ending(status="finished", reason="all slices are traced"):
    counters = {"messages": 40, "sent": 40, "p50": 80.0, "p99": 120.0, "steps": {"filter": 1.0}}
    status_message = example(types.NodeStatus, node="filter", state="ending", cpu=1.5, **counters)
    return Ending(status=status, reason=reason, statuses={"filter": status_message})


KEPT = {"error_bound": 6e-4, "unknown_share": 4e-3, "untouched_gap": 9e-3, "unentered_hole": 0.0}
ASKED = {"tolerance": 1e-3, "feature": 0.02, "unknown_share": 0.01}


def planned(findings=KEPT, limits=ASKED, reason="enough", **more):
    bound, gap = findings.get("error_bound"), {"largest_untouched": 2.5e-3}
    fields = {"findings": findings, "limits": limits, "reason": reason, "rms_bound_95": bound}
    return example(
        types.PlanDone, number=3, contours=(1, 2), touches=40, **{**fields, **gap, **more}
    )


@pytest.fixture
def progress(tetrahedron, score):
    return Progress(
        contours=2, touches=40, robot_time=20.0, ready=0.5, reports=[(0.5, 0), (2.5, 40)],
        wall=4.0, model=tetrahedron, scores=[(3.0, score)],
    )  # fmt: skip


def summary_of(progress, *ends):
    return summarise(ending(*ends), progress, "vase", 7)


def headline(progress, *ends, files=(), folder=RUN):
    text = headline_text(summary_of(progress, *ends), files, folder)
    return text.splitlines(), " ".join(text.split())


def test_summary_has_figures_or_null_and_is_read_again_or_refused(progress, score):
    summary = summary_of(progress)
    nothing = summarise(Ending(status="died", reason="x"), Progress(), None, None)
    assert nothing.keys() == summary.keys()
    unknown = ("chamfer_m", "watertight", "mesh_sha256", "compute_s", "touches_per_s", "ready_s")
    assert {nothing[key] for key in unknown} == {None}
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert (summary["chamfer_m"], summary["compute_s"]) == (0.0003, 1.5)
    assert summary["touches_per_s"] == 20.0  # 40 in the 2 s between the reports
    node = {"messages": 40, "sent": 40, "p50_us": 80.0, "p99_us": 120.0, "cpu_s": 1.5}
    assert summary["nodes"] == {"filter": node}
    assert summary["numerics"] == {"condition": 3.5, "fallbacks": 0.0}
    assert summary["steps"] == {"filter": 1.0, "rest": 0.5}
    spent = {"contours": 2, "touches": 40, "robot_time_s": 20.0, "wall_s": 3.0}
    none = ("compute_s", "rms_bound_95_m", "largest_untouched_m", "forecast", "halved", "ratio")
    errors = {"chamfer_m": 0.0003, "rms_m": score.rms}
    assert summary["curve"] == [{**spent, **errors, **dict.fromkeys(none)}]
    folder, summary = choose_run_directory("vase", Path("here")), summary_of(progress)
    folder.create()
    folder.write_summary(summary)
    assert sorted(os.listdir("here")) == ["cost.svg", "summary.json"]
    assert read_summary(Path("here")) == summary
    with pytest.raises(InputError, match=r"there: is no directory of a run: there is no summary"):
        read_summary(Path("there"))
    for text, why in (("{", "is no JSON"), ("[]", "must hold a map, got list")):
        Path("here/summary.json").write_text(text)
        with pytest.raises(InputError, match=f"here/summary.json: {why}"):
            read_summary(Path("here"))


def test_exit_code_says_how_it_ended_and_whether_a_solid_was_missed(progress, tetrahedron, score):
    def code(status="finished", rebuilds=True):
        return exit_code(summary_of(progress, status), rebuilds=rebuilds)

    ends = ("finished", "died", "stalled", "interrupted")
    assert [code(status) for status in ends] == [0, 3, 3, 130]
    progress.scores = [(1.0, replace(score, watertight=False))]
    assert code() == 1
    progress.scores = []
    assert code() == 0
    empty = np.zeros((0, 3), np.int32)
    for model in (replace(tetrahedron, final=False), replace(tetrahedron, faces=empty), None):
        progress.model = model
        assert code() == 1
    assert code(rebuilds=False) == 0


@pytest.mark.parametrize(("changes", "missed"), [
    ({}, []),
    ({"error_bound": 3e-3}, ["error bound 3.000 mm (limit 1 mm)"]),
    ({"unknown_share": 0.03}, ["unknown share 3.0 % (limit 1 %)"]),
    ({"untouched_gap": 0.03}, ["untouched gap 30.000 mm (limit 20 mm)"]),
    ({"unentered_hole": 5e-3}, ["perhaps a hole, 5.000 mm wide: no finger entered it"]),
    ({"untraced_height": 5e-3}, ["untraced height 5.000 mm (none is allowed)"]),
    ({"error_bound": 3e-3, "crease_error": 7e-3, "crease_share": 0.16},
     ["error bound 3.000 mm (limit 1 mm)", "crease error 7.000 mm (limit 2.5 mm)"]),
])  # fmt: skip
def test_limit_that_is_not_kept_is_named(progress, changes, missed):
    reason = "the budget is spent: 40 of 40 touches"
    progress.done = planned(KEPT | changes, reason=reason)
    summary = summary_of(progress)
    assert [exit_code(summary, rebuilds=one) for one in (True, False)] == [bool(missed)] * 2
    assert (summary["reached"], summary["missed"]) == (not missed, missed)
    assert summary["limits"] == {"tolerance_m": 1e-3, "feature_m": 0.02, "unknown_share": 0.01}
    _, words = headline(progress)
    assert ("missed" in words) == bool(missed) and all(one in words for one in missed)
    assert reason in words


def test_bound_that_cannot_be_stated_is_missed_unless_the_run_was_interrupted(progress):
    progress.done = planned({}, ASKED)
    assert summary_of(progress)["missed"] == ["no error bound can be stated (limit 1.000 mm)"]
    progress.done = planned({}, {"unknown_share": 0.01})
    assert summary_of(progress)["missed"] == []
    progress.done, progress.estimates = None, [(3.0, estimate(4e-4))]
    summary = summary_of(progress, "interrupted", "Ctrl-C")
    assert (summary["rms_bound_95_m"], summary["largest_untouched_m"]) == (4e-4, 9e-3)
    assert (summary["reached"], summary["missed"]) == (None, [])


@pytest.mark.parametrize(("model", "truth", "missed", "kind"), [
    ({"genus": 2}, {"genus": 2, "true_genus": 2}, [], "a closed solid with 2 holes through it"),
    ({}, {"true_genus": 1}, ["genus 0 (the object's is 1)"], "a closed solid,"),
    ({"self_crossings": 6}, {}, ["6 self-crossings"], "a surface that crosses itself"),
    ({"closed": False, "genus": None}, {}, ["1 open surface"], "a surface that is NOT closed"),
    ({"missing": 2e-3}, {}, ["error bound 2.000 mm (limit 1 mm)"], "a closed solid,"),
    ({}, {"rms": 2e-3}, ["rms error 2.000 mm (limit 1 mm)"], "a closed solid,"),
])  # fmt: skip
def test_mesh_and_truth_are_judged_too(progress, tetrahedron, score, model, truth, missed, kind):
    facts = {"closed": True, "genus": 0, "self_crossings": 0} | model
    progress.model = replace(tetrahedron, **facts)
    progress.scores = [(3.0, replace(score, **truth))]
    progress.done = planned(reason="every limit is kept", reached=True)
    summary = summary_of(progress)
    assert summary["missed"] == missed and exit_code(summary, rebuilds=True) == bool(missed)
    assert summary["reason"].startswith("every limit is kept;") != bool(missed)
    assert kind in headline_text(summary, [], RUN)


def test_headline_says_found_asked_and_spent_and_details_have_all_figures(progress):
    limits = {**ASKED, "tolerance": 5e-4}
    progress.done, progress.tolerance = planned({"error_bound": 28e-6}, limits), 5e-4
    lines, _ = headline(progress, files=["mesh.glb", "topics.mcap"])
    assert lines[0] == "found      a closed solid, 30 mm high  rms error 0.400 mm"
    assert lines[1].strip() == "sampling floor 0.050 mm"
    assert lines[2].startswith("reached    error bound 0.028 mm (limit 0.5 mm)")
    assert "cost       2 contours  40 touches  robot 20.0 s  wall 4.0 s  compute 1.5 s" in lines
    assert lines[-2] == "done       enough; all slices are traced"
    assert lines[-1] == "open       runs/r/mesh.glb  (all figures in summary.json)"
    nothing = summarise(Ending(status="died", reason="boom"), Progress(), None, None)
    lines = headline_text(nothing, ["log.jsonl"], RUN).splitlines()
    assert lines[0] == "found      no solid" and lines[-2] == "died       boom"
    assert "result     no model was measured" in details_text(nothing, [])
    files = [f"a_rather_long_name_{i}.json" for i in range(9)]
    progress.done = planned()
    lines = details_text(summary_of(progress), files).splitlines()
    assert max(map(len, lines)) <= TEXT_WIDTH
    text = "\n".join(lines)
    assert "chamfer 0.300 mm (1.00 % of the height)" in text and "watertight yes" in text
    assert ["filter", "40", "80", "120", "1.50"] in [line.split() for line in lines]
    assert all(name in text for name in files)
    assert "steps      filter 67 %  rest 33 %  of 1.5 s" in lines
    assert any(line.startswith("curve  ") for line in lines)


OPEN = {
    "open_share": 0.4, "open_width": 0.02, "under_share": 0.1, "open_touches": 99.4,
    "open_places": np.array([[0.01, 0.02, 0.03]]),
}  # fmt: skip


@pytest.mark.parametrize("status", ["finished", "died", "stalled", "interrupted"])
@pytest.mark.parametrize("folder", [RUN, Path("runs") / ("a_long_name_" * 8)])
def test_headline_cuts_nothing_off(progress, status, folder):
    progress.failed_contours, reason = 3, "why " * 100 + "indeed"
    progress.done = planned({"error_bound": 1e-3}, reason=reason, **OPEN)
    lines, words = headline(progress, status, "so " * 90 + "there", files=["a"], folder=folder)
    assert max(len(line) for line in lines if str(folder) not in line) <= TEXT_WIDTH
    for part in (
        f"{reason}; {'so ' * 90}there",
        "40.0 % of the surface is unknown and may have holes, the widest part 20.000 mm wide",
        "wide at (10, 20, 30) mm",
        "10.0 % of the surface is the underside",
        "3 slices could not be traced",
    ):
        assert part in words
    assert "..." not in words


def test_headline_names_doubts_and_what_a_procedure_found(progress, score):
    bound, progress.failed_contours = 0.5 * score.rms, 1
    progress.done = planned({"error_bound": bound}, **OPEN | {"open_share": 4e-4})
    summary = summary_of(progress) | {"restarts": {"tracer": 2}, "gaps": 3}
    words = " ".join(headline_text(summary, [], RUN).split())
    assert "under 0.1 % of the surface is unknown" in words
    assert "the rms error is larger than the stated bound" in words
    assert "1 slice could not be traced" in words and "restarted: tracer" in words
    assert "messages lost: 3, received twice: 0" in words
    figures = {"axis_error_deg": 0.1, "residual_rms_m": 1e-5, "volume_m3": 1e-4, "faces": 6.0}
    alone = Progress(touches=40)
    fields = {"procedure": "planar", "figures": figures, "touches": 40}
    alone.procedure = example(types.ProcedureResult, status="done", reason="it closes", **fields)
    lines, words = headline(alone, files=["result.json"])
    assert lines[0] == "planar      done: it closes  axis error 0.100 deg  faces 6"
    assert "residual rms 0.010 mm volume 100.0 cm3" in words and "runs/r/result.json" in words
    alone.procedure = example(
        types.ProcedureResult, status="unsuited", reason="it is round", **fields
    )
    lines, _ = headline(alone)
    assert lines[0] == "found      no solid" and "missed     unsuited: it is round" in lines


LAUNCH = """
args: {seed: 5, maker: t.maker}
nodes:
  maker: {kind: $(maker)}
  judge: {kind: t.judge}
ends: judge
"""


@pytest.fixture
def launch_file(make_node, write, tetrahedron, contour, score):
    """A graph of two nodes: one makes a contour and a model, the other scores it and ends."""
    make_node("t.judge")
    params = sys.modules["t.judge"].NODE.params
    outputs = {"/contour/traced": types.Contour, "/model/shape": types.ShapeModel}
    solid = replace(tetrahedron, closed=True, genus=0, self_crossings=0)
    messages = [("/contour/traced", contour), ("/model/shape", solid)]

    def judge(_, state, message):
        return state, [("/score", score), Finished("scored")]

    def fail(*_):
        raise ValueError("the finger fell off")

    maker = Node(params=params, start=lambda _: (None, messages), inputs={}, outputs=outputs)
    hears = {"/model/shape": (types.ShapeModel, judge)}
    judging = replace(
        maker, start=lambda _: (None, []), inputs=hears, outputs={"/score": types.Score}
    )
    make_node("t.maker", value=maker)
    make_node("t.broken", value=replace(maker, start=fail))
    make_node("t.judge", value=judging)
    return write("f.yaml", LAUNCH)


def start(path, **args):
    located = {name: SourceMapped(value, name) for name, value in args.items()}
    plan = plan_run(path, located, {}, name="toy", out=Path("here"))
    assert not Path("here").exists()
    return perform(plan, composed=True, display=Display())


def test_run_leaves_its_results_in_its_directory_and_is_loaded_from_it(launch_file):
    run = start(launch_file)
    assert run.exit_code == 0
    meshes = {"mesh.glb", "mesh.ply", "mesh.stl", "model.npz"}
    texts = {"cost.svg", "launch.yaml", "log.jsonl", "summary.json"}
    assert {path.name for path in run.folder.iterdir()} == meshes | texts
    summary = read_summary(run.folder)
    assert summary == run.summary
    assert (summary["status"], summary["reason"], summary["seed"]) == ("finished", "scored", 5)
    assert (summary["contours"], summary["touches"]) == (1, 30)
    assert summary["chamfer_m"] == 0.0003 and set(summary["nodes"]) == {"maker", "judge"}
    assert run.model is not None and run.model.vertices.shape == (4, 3)
    assert "here/mesh.glb" in run.text and "mesh.stl" in run.details
    text = (run.folder / "launch.yaml").read_text()
    assert "kind: t.maker" in text and "ends: judge" in text and "$(" not in text
    (run.folder / "topics.mcap").touch()
    for path in (run.folder, run.folder / "topics.mcap"):
        again = load_run(path)
        assert (again.summary, again.exit_code, again.folder) == (run.summary, 0, run.folder)
        np.testing.assert_array_equal(again.model.vertices, run.model.vertices)
        assert find_run_mesh(path) == run.folder / "mesh.ply"
        assert find_bag(path) == run.folder / "topics.mcap"
    assert find_run_mesh(Path("f.yaml")) == Path("f.yaml")
    for name in ("model.npz", "mesh.ply", "topics.mcap"):
        (run.folder / name).unlink()
    assert load_run(run.folder).model is None
    for find, path, words in (
        (find_run_mesh, run.folder, "holds no rebuilt solid: there is no mesh.ply in it"),
        (find_run_mesh, Path("none"), "none: does not exist; it must be a run or a file"),
        (find_bag, run.folder, "holds no recording: there is no topics.mcap in it"),
        (find_bag, Path("none"), "none: the recording does not exist"),
    ):
        with pytest.raises(InputError, match=words):
            find(path)


def test_failing_node_ends_the_run_with_3_and_its_name(launch_file):
    run = start(launch_file, maker="t.broken")
    assert run.exit_code == 3 and run.summary["chamfer_m"] is None
    assert re.search("maker.*the finger fell off", run.summary["reason"])


@pytest.mark.parametrize(("text", "fingers", "words"), [
    ("explore:\n  tolerance: 5.0e-6\n", 1,
     "s.yaml:4: tolerance is 5e-06 m; it must be at least the resolution of the sensor, 1e-05 m"),
    ("effects:\n  - gaussian_noise: {sigma: 50.0e-6}\nexplore:\n  tolerance: 40.0e-6\n", 1,
     "s.yaml:6: tolerance is 4e-05 m; it must be at least the resolution of the sensor, 5e-05 m"),
    ("explore:\n  planner: uniform\n  settings:\n    count: 2\n", 3,
     "s.yaml:6: count is 2, but there are 3 fingers; a finger would have nothing to do"),
    ("", 4, "fingers is 4, but an object of 0.06 m has room for 3, 0.024 m apart"),
    ("explore: {tolerance: 0.1e-3}\n", 2, "--set tolerance: tolerance is 1e-06 m"),
])  # fmt: skip
def test_demand_that_cannot_be_met_is_refused_in_its_place(write, text, fingers, words):
    ball = "object:\n  superquadric: {size: [0.03, 0.03, 0.03], exponents: [1, 1]}\n"
    scene = {"scene": str(write("s.yaml", ball + text)), "fingers": fingers}
    args = {name: SourceMapped(value, name) for name, value in scene.items()}
    settings = {}
    if words.startswith("--set"):  # what the scene asks can be met
        plan_run(EXPLORE, args, settings, name="s", out=Path("run"))
        settings = {"planner.tolerance": SourceMapped(1e-6, "--set tolerance")}
    with pytest.raises(InputError, match=re.escape(words)):
        plan_run(EXPLORE, args, settings, name="s", out=Path("run"))
    assert os.listdir() == ["s.yaml"]


LIGHT = """
import sys
from pathlib import Path
from palpate.launch.files.source_map import SourceMapped
from palpate.launch.launch_source import EXPLORE
from palpate.launch.run import plan_run
from palpate.launch.scene import find_scene
from palpate.launch.files.mesh_file import write_mesh
from palpate.tools.exploration import perform_and_print
args = {"scene": SourceMapped(str(find_scene("egg")), "")}
plan_run(EXPLORE, args, {}, name="egg", out=Path("run"))
import numpy as np
corners = np.eye(4)[:, :3]
for kind in ("ply", "stl", "glb"):
    write_mesh(Path(f"mesh.{kind}"), corners, np.array([[0, 1, 2]]))
print(sorted({"scipy.linalg", "trimesh", "rich", "matplotlib"} & set(sys.modules)))
"""


def test_planning_and_writing_import_nothing_heavy():
    done = subprocess.run([sys.executable, "-c", LIGHT], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("[]\n", "")
