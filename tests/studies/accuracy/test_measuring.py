from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.core.geometry import prepare_surface
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.shapes import Mesh, Superquadric
from palpate.launch.files import InputError, write_mesh
from tests.studies.__main__ import main
from tests.studies.accuracy import measuring, methods
from tests.studies.accuracy.conftest import SIZE, point, run_of
from tests.studies.accuracy.measuring import accuracy_rows, sheet_rows, units_of
from tests.studies.accuracy.methods import (
    CONTENDERS,
    OURS,
    Model,
    Unit,
    contender_of,
    even_count,
    f_score,
    measure_run,
    meshes_in,
    runs_of,
    touched_shares,
)
from tests.studies.accuracy.runs import read_runs
from tests.studies.accuracy.sheet import COSTS, draw_sheet

BALL = Superquadric(np.full(3, 0.045), np.ones(2)).mesh(3)


def named(rows: Any, part: str) -> Any:
    [found] = [row for row in rows if part in row.name]
    return found


def guess(problem: Any, tolerance: float, seed: int) -> Any:
    """A ball that grows, whatever is touched."""
    middle = problem.box.mean(axis=0)
    for touches in (1, 5, 12):
        mesh = Mesh(BALL.vertices * (0.9 + 0.008 * touches) + middle, BALL.faces)
        some = ContactPoints(middle[None] + [[0.0, 0.0, 0.045]], None, np.zeros(1, np.int32))
        yield Model(mesh, touches, 2.0 * touches, [some] * touches)


def test_a_method_is_one_function_and_scored_from_outside():
    name = f"{__name__}:guess"
    [run] = runs_of(Unit((name,), "sphere", 0, 0.01, 5))
    assert (run.failed, run.method, run.size_m) == ("", name, pytest.approx(0.09))
    assert [one.touches for one in run.curve] == [1, 5]  # the limit of one without an end is 5
    assert not any(one.endless for one in CONTENDERS.values() if one.asked)
    first, last = run.curve
    assert first.rms_m > last.rms_m == pytest.approx(0.06 * 0.045, rel=0.05)
    assert last.chamfer_m == pytest.approx(0.5 * run.final.chamfer_sum_m)
    assert (run.final.f_score_1mm, run.final.f_score_5mm) == (0.0, 1.0)
    assert set(run.final.touched_5mm) == {"5"}
    assert 0.0 < run.final.touched_5mm["5"] < 0.02
    assert 0.0 < run.sampling_floor_m < 1e-4


def dies(*_: Any) -> Any:
    raise RuntimeError("no way on")
    yield


def makes_nothing(*_: Any) -> Any:
    return []


def goes_back(problem: Any, tolerance: float, seed: int) -> Any:
    for touches in (5, 4):
        yield Model(BALL, touches, 1.0, [])


@pytest.mark.parametrize(
    ("method", "why"),
    [
        (dies, "RuntimeError: no way on"),
        (makes_nothing, "RuntimeError: the method made no model"),
        (goes_back, "ValidationError: .* must not become cheaper|ValueError: .* cheaper"),
    ],
)
def test_a_method_that_fails_is_kept_with_why(method, why):
    surface = prepare_surface(*BALL)
    truth = methods.TrueObject(surface, SIZE, 0.0, np.zeros((2, 3)))
    problem = methods.Problem("egg", Path("scene.yaml"), truth.box)
    contender = methods.Contender("it fails", method)
    unit = Unit(("fails",), "egg", 0, 0.01, 5)
    run = measure_run("fails", contender, problem, truth, unit)
    assert re.match(why, run.failed)
    assert (run.curve, run.final) == ((), None)


@pytest.mark.parametrize("name", ["nothing", "no_module:explore", f"{__name__}:SIZE"])
def test_what_is_no_method_is_refused(name):
    with pytest.raises(InputError, match="method"):
        contender_of(name)


def test_f_scores_and_touched_shares():
    there, back = np.array([0.0, 0.0, 1.0, 1.0]), np.zeros(4)
    assert f_score(there, back, 0.5) == pytest.approx(2 * 0.5 / 1.5)
    assert f_score(there, there + 1.0, 0.5) == 0.0
    samples = np.column_stack([np.arange(10) * 1e-2, np.zeros((10, 2))])
    touched = [ContactPoints(samples[i : i + 1], None, np.zeros(1, np.int32)) for i in range(7)]
    assert touched_shares(samples, touched) == {"5": 0.5}
    assert [even_count(share) for share in (0.01, 0.002, 0.0005)] == [3, 6, 9]


def test_meshes_of_the_user_are_explored_standing_in_the_middle(tmp_path):
    write_mesh(tmp_path / "ball.ply", BALL.vertices + 0.3, BALL.faces)
    assert meshes_in(tmp_path) == ["ball.ply"]
    found = methods.object_of("ball.ply", tmp_path)
    assert isinstance(found, Mesh)
    low, high = found.vertices.min(axis=0), found.vertices.max(axis=0)
    assert low[2] == pytest.approx(0.0)
    assert (low + high)[:2] == pytest.approx([0.0, 0.0], abs=1e-7)
    units = units_of(True, (OURS,), tmp_path)
    assert {unit.object for unit in units} == {*measuring.QUICK_OBJECTS, "ball.ply"}


def test_work_is_shared_out_and_what_is_there_is_not_made_again():
    units = units_of(True, tuple(CONTENDERS), None)
    assert {name for unit in units for name in unit.methods} == set(CONTENDERS)
    gp = [unit for unit in units if unit.methods == ("Gaussian process",)]
    assert len(gp) == len(measuring.QUICK_OBJECTS)  # it takes no tolerance
    made = run_of(method="Gaussian process")
    assert measuring._is_made(gp[0], [made])
    asked = Unit((OURS,), "egg", 0, 0.002, 9)
    assert measuring._is_made(asked, [run_of(method=OURS, share=0.002)])
    assert not measuring._is_made(asked, [run_of(method=OURS, share=0.01)])


def finished(bound: float, touches: int = 40) -> Any:
    ours = {"object": "egg", "method": OURS}
    loose = run_of(share=0.01, curve=(point(18, 4e-4, bound),), **ours)
    strict = run_of(
        share=0.0005, curve=(point(19, 4e-4, bound), point(touches, 2e-5, bound)), **ours
    )
    return [loose, strict, run_of(curve=(point(30, 3e-4), point(60, 1.1e-4)))]


def test_what_is_demanded_is_met_or_missed():
    rows = list(sheet_rows(finished(bound=5e-4)))
    assert named(rows, "dominates mine").holds
    assert named(rows, "bound of 95 % holds").holds
    assert named(rows, "0.5 % on 1 smooth").value == "19"
    assert named(rows, "touches at 1 % over").value == "0.45"
    assert named(rows, "mine: targets reached").value == "47%"
    late = list(sheet_rows(finished(bound=1e-6, touches=70)))
    row = named(late, "dominates mine")
    assert (row.holds, row.value) == (False, "8 of 11 (not at 0.27, 0.19, 0.14 %)")
    assert not named(late, "bound of 95 % holds").holds


def test_methods_that_share_no_object_cannot_be_compared():
    with pytest.raises(InputError, match="no object and seed was explored by every method"):
        list(sheet_rows([run_of(), run_of(method="other", object="box")]))


@pytest.mark.parametrize("which", COSTS)
def test_a_sheet_is_drawn_against_any_cost(which):
    figure = draw_sheet([*finished(bound=5e-4), run_of(method="dead", curve=())], OURS, which)
    left, middle, right = figure.axes
    assert left.get_xlabel() == middle.get_xlabel() == COSTS[which]
    assert "palpate: 100% of 2 held" in [text.get_text() for text in right.get_legend().texts]


def test_runs_of_another_method_are_laid_beside_ours(tmp_path, monkeypatch):
    made = [*finished(1e-3)[:2], run_of(method="thesis")]
    monkeypatch.setattr(measuring, "_make_runs", lambda file, units: file.add(made) or [])
    folder = tmp_path / "here"
    lines = list(accuracy_rows(True, sheet=folder))
    assert {one.name for one in folder.iterdir()} == {"results.json", "sheet.svg", "sheet.png"}
    assert "methods that are not installed: " in str(lines[0])
    other, text = tmp_path / "other.json", (folder / "results.json").read_text()
    theirs = {**json.loads(text), "methods": {"theirs": "", "older": ""}}
    for run in theirs["runs"]:
        run["method"] = "older" if run["method"] == OURS else "theirs"
    other.write_text(json.dumps(theirs))
    monkeypatch.setattr(measuring, "_make_runs", lambda file, units: [])
    rows = list(accuracy_rows(True, sheet=folder, add=(other,)))
    assert any("dominates theirs" in str(row) for row in rows)
    other.write_text(json.dumps({**theirs, "methods": {**theirs["methods"], OURS: ""}}))
    with pytest.raises(InputError, match=r"there is a method '.*' already; call it something else"):
        list(accuracy_rows(True, sheet=folder, add=(other,)))
    assert len(read_runs(folder / "results.json").runs) == 3


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["casts", "--add", "x.json"], "--add belongs to accuracy/methods"),
        (["accuracy", "--add", "none.json"], "none.json: the results cannot be read"),
        (["accuracy", "--meshes", "."], "has no mesh in it: no .glb"),
        (["accuracy", "--meshes", "nowhere"], "nowhere: is no folder of meshes"),
        (["accuracy", "--method", "nothing"], "there is no method 'nothing'"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_starts(
    tmp_path, monkeypatch, capsys, arguments, words
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match="2"):
        main(arguments)
    assert words in capsys.readouterr().err
    assert not [*tmp_path.iterdir()]
