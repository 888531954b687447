"""Procedures as whole graphs: performed, recorded, replayed, refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from palpate.tools.cli.command_line import run

pytestmark = pytest.mark.graph
# Procedure and the scene that it suits, and a figure of its result.
SUITED = {
    "containment": ("egg", "Superquadric"),
    "planar": ("block", "BoundaryRepresentation"),
    "follower": ("amphora", "GeneralisedCone"),
    "fearing": ("cone", "ConePose"),
    "openings": ("cup", "Openings"),
}


def performed(name: str, scene: str, out: Path, *more: str) -> tuple[int, dict, dict]:
    code = run(["run", scene, "--procedure", name, "--out", str(out), "--quiet", *more])
    summary = json.loads((out / "summary.json").read_text())
    return code, summary, json.loads((out / "result.json").read_text())


@pytest.mark.parametrize("name", SUITED)
def test_a_procedure_explores_records_and_replays(name, tmp_path, capsys):
    scene, model = SUITED[name]
    code, summary, result = performed(name, scene, tmp_path / "run")
    assert code == 0 and summary["procedure"]["status"] == "done"
    assert set(result) == {"result", model}
    assert summary["touches"] == result["result"]["touches"]
    assert (tmp_path / "run" / "mesh.ply").exists() == (name not in ("fearing", "openings"))
    assert run(["replay", str(tmp_path / "run"), "--nodes", "procedure"]) == 0
    assert "procedure: identical" in capsys.readouterr().out


def test_one_process_or_many_come_to_the_same(tmp_path):
    _, apart, _ = performed("follower", "amphora", tmp_path / "apart", "--no-record")
    _, together, _ = performed("follower", "amphora", tmp_path / "one", "--no-record", "--composed")
    assert apart["mesh_sha256"] == together["mesh_sha256"] is not None


@pytest.mark.parametrize(
    ("name", "scene", "why"),
    [
        ("planar", "sphere", "it has no plane face where it was touched"),
        ("follower", "gem", "no generalised cone fits"),
        ("containment", "dented", "no superquadric contains it"),
        ("fearing", "sphere", "met a feature of a cone"),
    ],
)
def test_an_object_that_is_not_of_its_kind_is_unsuited_with_the_reason(name, scene, why, tmp_path):
    code, summary, result = performed(name, scene, tmp_path / "run", "--no-record")
    assert code == 1 and summary["procedure"]["status"] == "unsuited"
    assert why in summary["procedure"]["reason"] and set(result) == {"result"}
    assert summary["mesh_sha256"] is None and summary["missed"] == [
        f"unsuited: {summary['procedure']['reason']}"
    ]


def test_touches_that_are_allowed_are_not_exceeded(tmp_path):
    code, summary, _ = performed("planar", "block", tmp_path / "run", "--touches", "20")
    assert code == 1 and summary["procedure"]["status"] == "incomplete"
    assert summary["touches"] == 20
    assert "20 touches were not enough" in summary["procedure"]["reason"]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--tolerance", "0.1mm"], "--tolerance 0.1mm: --procedure planar explores in its own way"),
        (["--budget", "60s"], "only --touches limits it"),
        (["--set", "procedure.settings.steps=3"], "has no setting 'steps'; it has none"),
        (["--set", "planner.tolerance=1e-3"], "there is no node 'planner'"),
    ],
)
def test_what_a_procedure_cannot_keep_is_refused_before_it_begins(
    arguments, told, tmp_path, capsys
):
    out = tmp_path / "run"
    assert run(["run", "block", "--procedure", "planar", "--out", str(out), *arguments]) == 2
    text = capsys.readouterr().err
    assert told in text and text.count("\n") == 1 and not out.exists()


def test_a_procedure_of_ones_own_is_named_by_module_and_function(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("poke.py").write_text(
        "import numpy as np\n"
        "from palpate.procedures import Findings, approach, touch\n"
        "def poke(setting, times=1):\n"
        "    for _ in range(times):\n"
        "        move = approach(np.zeros(3), np.array([0, 0, 1.0]), 0.1, 0.0)\n"
        "        met = yield from touch(setting, move)\n"
        "    return Findings(status='done', reason=f'met it at {met.middle[2]:.3f} m')\n"
    )
    settings = ["procedure.procedure=poke:poke", "procedure.settings.times=2"]
    arguments = [text for one in settings for text in ("--set", one)]
    assert run(["run", "sphere", "--procedure", "planar", "--out", "here", *arguments]) == 0
    assert "done: met it at 0.080 m" in capsys.readouterr().out
    assert np.load("here/model.npz")["touches"] == 2
