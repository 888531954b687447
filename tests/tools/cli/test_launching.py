import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from palpate.tools.chaos.fault_injection import Fault, InjectionLog, NodeRecovery
from palpate.tools.chaos.trials import Tally
from palpate.tools.cli.command_line import run
from palpate.tools.sweep.results import FIGURES, Row
from palpate.tools.sweep.sweep_folder import SweepResult


def test_a_kind_that_there_is_not_is_refused(capsys):
    assert run(["dev", "chaos", "--kinds", "kil"]) == 2
    text = capsys.readouterr().err
    assert text.startswith("palpate: --kinds kil: there is no 'kil'; ") and "kill" in text


def test_the_line_says_what_came_of_all_runs(monkeypatch, capsys):
    fault = Fault("kill", ("tracer",), "tracing", "/finger/goal", 3, 0.1)
    tally = Tally(5, runs=1, survived=1, failed=[(6, "gap: /a 1 of b is not there")], lost=1)
    back = [NodeRecovery("kill", "tracer", "tracing", seconds) for seconds in (0.75, 0.25, 0.5)]
    back.append(NodeRecovery("stop", "tracer", "tracing", 1.0))
    tally.injected.update(one.kind for one in InjectionLog([fault, fault]).faults)
    tally.back += back
    monkeypatch.setattr("palpate.tools.chaos.run_trials", lambda *_, **__: tally)
    assert run(["dev", "chaos"]) == 1
    text = capsys.readouterr()
    recovery = "recovery p50 0.50 s p99 0.75 s stopped p50 1.00 s p99 1.00 s"
    assert text.out == f"injected 2 survived 1 lost 1 duplicated 0 {recovery}\n"
    assert text.err == "palpate: dev chaos --seed 6 --minutes 0: gap: /a 1 of b is not there\n"
    run(["dev", "chaos", "--json"])
    assert json.loads(capsys.readouterr().out)["recovery_p99_s"] == 0.75


@pytest.fixture
def swept(monkeypatch):
    """What `palpate sweep` hands on, instead of exploring."""
    calls = []
    rows = [Row(1, {"scene": "sphere", "seed": 0}, dict.fromkeys(FIGURES) | {"exit_code": 1})]

    def run_sweep(asked, out, workers, say):
        calls.append((asked, out, workers.width))
        say("1 of 1")
        return SweepResult(Path("there"), rows, left=0, kept=0)

    monkeypatch.setattr("palpate.tools.sweep.run_sweep", run_sweep)
    return calls


def test_a_sweep_is_printed_and_missed_goals_are_an_exit_code(swept, write, capsys):
    file = write("two.yaml", "scene: sphere\nseeds: 2\n")
    assert run(["sweep", str(file), "--workers", "3"]) == 1
    text = capsys.readouterr()
    assert text.out.splitlines()[-1] == "sweep  there/index.html"
    assert text.err == "1 of 1\n"
    ((asked, out, width),) = swept
    assert (asked.name, len(asked.runs), out, width) == ("two", 2, None, 3)
    run(["sweep", str(file), "--json", "--quiet"])
    text = capsys.readouterr()
    assert json.loads(text.out)["runs"][0]["scene"] == "sphere"
    assert text.err == ""


def test_the_folder_of_a_sweep_stands_for_its_file(swept, write, tmp_path):
    write("sweep.yaml", "scene: sphere\n")
    run(["sweep", str(tmp_path)])
    assert swept[0][1] == tmp_path


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--workers", "2", "--scheduler", "tcp://a:1"], "--workers and --scheduler exclude each"),
        (["--out", "x"], "so do --out and a folder"),
        (["--workers", "0"], "0 is not in the range"),
    ],
)
def test_a_sweep_that_cannot_be_is_refused_in_a_sentence(swept, tmp_path, capsys, more, words):
    assert run(["sweep", str(tmp_path), *more]) == 2
    text = capsys.readouterr().err
    assert text.startswith("palpate: ") and words in text
    assert swept == []


def test_a_mesh_is_explored_as_it_is_and_what_is_mended_is_told_first(tmp_path, capsys):
    box = trimesh.creation.box([0.06, 0.05, 0.04]).subdivide().subdivide().subdivide().subdivide()
    box.update_faces(np.arange(len(box.faces)) > 0)
    box.export(tmp_path / "box.stl")
    asked = ["run", str(tmp_path / "box.stl"), "--touches", "3", "--composed", "--no-record"]
    assert run([*asked, "--unit", "m", "--out", str(tmp_path / "run")]) == 1
    said = capsys.readouterr().err
    assert said.startswith("mesh       box.stl: 1 hole of up to 4.5 mm closed\nasked ")
    assert "unit: m" in (tmp_path / "run" / "scene.yaml").read_text()
    assert run(["scene", "check", str(tmp_path / "box.stl")]) == 0
    assert (
        "\nmesh       box.stl: taken to be in m, 60 x 50 x 40 mm; 1 hole" in capsys.readouterr().out
    )


@pytest.mark.parametrize(("how", "size"), [
    (["--unit", "in"], "127.0 x 101.6 x 76.2 mm"),
    (["--unit", "cm"], "50.0 x 40.0 x 30.0 mm"),
    (["--size", "120mm"], "120.0 x 96.0 x 72.0 mm"),
])  # fmt: skip
def test_check_takes_the_unit_or_the_size_of_a_mesh(here, capsys, how, size):
    trimesh.creation.box([5.0, 4.0, 3.0]).export(here / "box.off")
    assert run(["scene", "check", "box.off", *how]) == 0
    assert f"the object measures {size}" in capsys.readouterr().out


@pytest.mark.parametrize(("more", "words"), [
    (["vase", "--unit", "mm"], "--unit mm: vase is no mesh; a scene has object.mesh.unit"),
    (["box.off"], "box.off: measures 5, in a unit that the file does not tell"),
    (["box.off", "--unit", "cm"], "box.off: is open: it has a hole of "),
    (["box.off", "--size", "120"], "--size 120: must have a unit: m, cm, mm, um, in, ft, as in"),
    (["box.off", "--unit", "cm", "--size", "1m"], "--unit and --size exclude each other"),
    (["none.stl"], "none.stl: the scene does not exist; a scene is a YAML file, or a mesh"),
])  # fmt: skip
def test_what_is_no_mesh_to_explore_is_refused(here, capsys, more, words):
    box = trimesh.creation.box([5.0, 4.0, 3.0])
    box.update_faces(np.arange(12) > 1)
    box.export(here / "box.off")
    assert run(["run", *more]) == 2
    text = capsys.readouterr().err
    assert words in text and text.count("\n") == 1
    assert [path.name for path in here.iterdir()] == ["box.off"]
