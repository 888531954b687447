"""Procedures as whole graphs: performed, recorded, replayed, refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.graph.conftest import palpate

pytestmark = pytest.mark.graph
# Procedure, the scene that it suits, and the model that it makes.
SUITED = [
    ("planar", "block", "BoundaryRepresentation"),
    *(
        pytest.param(*case, marks=pytest.mark.slow)
        for case in (
            ("containment", "egg", "Superquadric"),
            ("openings", "cup", "Openings"),
            ("follower", "amphora", "GeneralisedCone"),
            ("fearing", "cone", "ConePose"),
        )
    ),
]


def performed(name: str, scene: str, out: Path, *more: object) -> tuple[int, Any, Any]:
    done = palpate("run", scene, "--procedure", name, "--out", out, "--quiet", *more)
    read = (json.loads((out / f"{one}.json").read_text()) for one in ("summary", "result"))
    return done.code, *read


@pytest.mark.parametrize(("name", "scene", "model"), SUITED)
def test_procedure_explores_records_and_replays(name, scene, model, tmp_path):
    code, summary, result = performed(name, scene, tmp_path / "run")
    assert code == 0 and summary["procedure"]["status"] == "done"
    assert set(result) == {"result", model}
    assert summary["touches"] == result["result"]["touches"]
    assert (tmp_path / "run" / "mesh.ply").exists() == (name not in ("fearing", "openings"))
    done = palpate("replay", tmp_path / "run", "--nodes", "procedure")
    assert done.code == 0 and "procedure: identical" in done.out
    if name == "follower":
        _, together, _ = performed(name, scene, tmp_path / "one", "--no-record", "--composed")
        assert together["mesh_sha256"] == summary["mesh_sha256"] is not None


@pytest.mark.parametrize(
    ("name", "scene", "why"),
    [
        ("planar", "sphere", "it has no plane face where it was touched"),
        pytest.param("follower", "gem", "no generalised cone fits", marks=pytest.mark.slow),
        pytest.param(
            "containment", "dented", "no superquadric contains it", marks=pytest.mark.slow
        ),
        ("fearing", "sphere", "met a feature of a cone"),
    ],
)
def test_unsuited_object_is_named_with_the_reason(name, scene, why, tmp_path):
    code, summary, result = performed(name, scene, tmp_path / "run", "--no-record", "--composed")
    assert code == 1 and summary["procedure"]["status"] == "unsuited"
    assert why in summary["procedure"]["reason"] and set(result) == {"result"}
    assert summary["mesh_sha256"] is None
    assert summary["missed"] == [f"unsuited: {summary['procedure']['reason']}"]


def test_limit_of_touches_is_kept(tmp_path):
    more = ("--touches", 20, "--composed")
    code, summary, _ = performed("planar", "block", tmp_path / "run", *more)
    assert code == 1 and summary["procedure"]["status"] == "incomplete"
    assert summary["touches"] == 20
    assert "20 touches were not enough" in summary["procedure"]["reason"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("--tolerance 0.1mm", "--tolerance 0.1mm: --procedure planar does not use it"),
        ("--budget 60s", "it uses only --touches"),
        ("--set procedure.settings.steps=3", "has no setting 'steps'; it has none"),
        ("--set planner.tolerance=1e-3", "there is no node 'planner'"),
    ],
)
def test_demand_on_procedure_is_refused_before_it_begins(arguments, words, tmp_path):
    out = tmp_path / "run"
    procedure = ("--procedure", "planar", "--out", out)
    done = palpate("run", "block", *procedure, *arguments.split())
    assert done.code == 2 and not out.exists()
    assert words in done.err and done.err.count("\n") == 1


OWN = """
import numpy as np
from palpate.procedures import Findings, approach, touch
def poke(setting, times=1):
    for _ in range(times):
        move = approach(np.zeros(3), np.array([0, 0, 1.0]), 0.1, 0.0)
        met = yield from touch(setting, move)
    return Findings(status='done', reason=f'met it at {met.middle[2]:.3f} m')
"""


def test_own_procedure_is_named_by_module_and_function(here):
    (here / "poke.py").write_text(OWN)
    settings = ["procedure.procedure=poke:poke", "procedure.settings.times=2"]
    arguments = [text for one in settings for text in ("--set", one)]
    words = ("run", "sphere", "--procedure", "planar", "--composed", "--out", "here", *arguments)
    done = palpate(*words, folder=here)
    assert done.code == 0 and "done: met it at 0.080 m" in done.out
    assert np.load(here / "here" / "model.npz")["touches"] == 2
