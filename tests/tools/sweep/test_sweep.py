"""Sweeps: runs that are asked for, made by workers that answer at once, kept and compared."""

import csv
import json
import re
from itertools import product
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from palpate.launch import charts
from palpate.launch.files.source_map import InputError
from palpate.tools.sweep.results import SIZES, Row, draw_front, pareto_front
from palpate.tools.sweep.sweep_file import read_sweep
from palpate.tools.sweep.sweep_folder import run_sweep
from tests.tools.sweep.workers import RECORD, Workers

FAILED = dict.fromkeys(RECORD) | {"status": "died", "exit_code": 3, "reason": "no <luck>, a"}
FOUR = "scene: sphere\nseeds: 2\ngrid: {planner.tolerance: [1.0e-3, 0.5e-3]}\n"
XLINK = "{http://www.w3.org/1999/xlink}"


def good(number):
    return RECORD | {"rms_m": 1e-5 * (1 + number)}


@pytest.fixture
def sweep(write, tmp_path):
    """Makes a sweep with answers for its runs; what came of it."""

    def do(text=FOUR, answer=good, *, say=print, out=tmp_path / "out", by_place=False):
        workers = Workers(answer, by_place)
        done = run_sweep(read_sweep(write("four.yaml", text)), out, workers, say)
        assert workers.closed
        return done, workers

    return do


def table(folder):
    with (folder / "table.csv").open() as file:
        return list(csv.DictReader(file))


def test_grid_and_list_give_every_combination_with_seeds_innermost(write):
    grid = "planner.tolerance: [1.0e-3, 0.5e-3], scene.sensor.pitch: [1.0e-3, 1.2e-3]"
    runs = read_sweep(write("sweep.yaml", f"scene: sphere\nseeds: 2\ngrid: {{{grid}}}\n")).runs
    keys = ("scene", "planner.tolerance", "scene.sensor.pitch", "seed")
    assert [tuple(run.asked.items()) for run in runs] == [
        tuple(zip(keys, ("sphere", tolerance, pitch, seed), strict=True))
        for tolerance in (1e-3, 0.5e-3) for pitch in (1e-3, 1.2e-3) for seed in (0, 1)
    ]  # fmt: skip
    # Entries of a list are combined with the rest of the grid.
    text = "scene: [sphere, egg]\ngrid: {planner.planner: [predicted, fuzzy], fingers: [1, 2]}\n"
    text += "list:\n  - {}\n  - {planner.planner: uniform, planner.settings.count: 4}\n"
    found = [run.asked for run in read_sweep(write("sweep.yaml", text)).runs]
    assert [one["scene"] for one in found] == ["sphere"] * 6 + ["egg"] * 6
    kinds = [(one["planner.planner"], one["fingers"]) for one in found[:6]]
    planners = ("predicted", "fuzzy", "uniform")
    assert kinds == [(planner, fingers) for planner in planners for fingers in (1, 2)]
    counts = [one.get("planner.settings.count") for one in found[:6]]
    assert counts == [None] * 4 + [4] * 2


def test_values_reach_simulator_and_planner_in_their_units(write, tmp_path):
    text = "scene: sphere\nseeds: [7]\ngrid: {tolerance: [0.7mm], feature: [1 cm], budget: [10min],"
    text += " scene.effects.gaussian_noise.sigma: [3.0e-6],"
    text += " 'scene.object.superquadric.size[2]': [0.03]}\n"
    (run,) = read_sweep(write("sweep.yaml", text)).runs
    nodes = {one.name: one.params for one in run.plan(tmp_path / "run").wirings}
    planner, simulator = nodes["planner"], nodes["simulator"]
    demand = planner.tolerance, planner.feature, planner.most_seconds
    assert demand == pytest.approx((0.7e-3, 10e-3, 600.0)) and run.asked["tolerance"] == "0.7mm"
    assert simulator.seed == 7 and simulator.object.superquadric.size[2] == 0.03
    assert simulator.effects["gaussian_noise"] == {"sigma": 3.0e-6}


def test_equal_runs_are_found_by_their_parameters(write):
    plain = read_sweep(write("a.yaml", "scene: sphere\n")).runs
    text = "scene: sphere\nseeds: [0]\ngrid: {fingers: [1, 1, 2]}\n"
    same = read_sweep(write("b.yaml", text))
    assert same.repeated == 1 and len({run.mark for run in same.runs}) == 2
    assert plain[0].mark == same.runs[0].mark and plain[0].name != same.runs[0].name
    silent = read_sweep(write("a.yaml", "scene: sphere\n"), record=False).runs
    assert silent[0].mark == plain[0].mark  # whether it is recorded changes nothing
    assert re.fullmatch(r"[\w.-]{1,80}", same.runs[0].name)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("scene: []\n", "1: scene is []; expected list of length >= 1"),
        ("scene: sphere\nseeds: 0\n", "2: seeds is 0; expected whole number >= 1"),
        ("scene: sphere\nseeds: 10001\n", "2: seeds is 10001"),
        ("scene: sphere\nseeds: 5001\ngrid: {fingers: [1, 2]}\n", "1: has more than 10000 runs"),
        ("scene: sphere\ngrid: {fingers: []}\n", "2: grid is a map of fingers"),
        ("scene: sphere\ngrid:\n  planner.tolernce: [1.0e-3]\n", "3: unknown key 'tolernce' in"),
        ("scene: sphere\ngrid:\n  planer.tolerance: [1.0e-3]\n", "3: there is no node 'planer'"),
        ("scene: sphere\ngrid:\n  scene.effects.gaussian_noise.sigma: [-1]\n",
         "3: effects.gaussian_noise: sigma is -1 m; expected 0 to 0.001 m"),
        ("scene: sphere\ngrid: {tolernce: [1.0e-3]}\n", "2: there is no parameter"),
        ("scene: sphere\ngrid:\n  tolerance: [1mm, 0.2]\n", "3: tolerance 0.2: must have"),
        ("scene: sphere\nlist:\n  - {planner.planner: fuzzy,\n     planner.settings.curl: 9}\n",
         "4: "),
        ("scene: sphere\ngrid: {fingers: [1]}\nlist: [{fingers: 2}]\n", "2: every entry of list"),
        ("scene: sphere\ngrid:\n  planner.feature: [3.0e-3]\n  planner.tolerance: [1.0e-3, 1e-9]\n",
         "4: "),  # the last combination
    ],
)  # fmt: skip
def test_runs_that_cannot_be_made_are_refused_with_their_line(write, text, complaint):
    path = write("sweep.yaml", text)
    with pytest.raises(InputError) as refused:
        read_sweep(path)
    assert str(refused.value).startswith(f"{path}:{complaint}")


def test_every_run_has_a_folder_and_a_row(sweep, tmp_path):
    said, out = [], tmp_path / "out"
    done, workers = sweep(say=said.append)
    assert (done.exit_code, done.left, done.kept, done.figures["finished"]) == (0, 0, 0, 4)
    rows = table(out)
    assert [row["run"] for row in rows] == ["1", "2", "3", "4"]
    head = list(rows[0])
    assert head == ["run", "scene", "planner.tolerance", "seed", *RECORD, "folder"]
    for row in rows:
        record = json.loads((out / row["folder"] / "run.json").read_text())
        assert record["palpate"] and record["asked"]["seed"] == int(row["seed"])
        assert float(row["chamfer_m"]) == 1e-5 and row["tolerance_met"] == "true"
    assert {one.name for one in out.iterdir()} == {"sweep.yaml", "runs", "table.csv", "index.html"}
    assert said[0] == f"{out}: 4 runs" and done.text.endswith("index.html")
    assert said[-1].startswith("4 of 4, best 0.010 mm, 0 s left; sphere_tolerance")
    before = [(out / name).read_text() for name in ("table.csv", "index.html")]
    again, workers = sweep()
    assert (again.kept, workers.begun) == (4, [])
    assert [(out / name).read_text() for name in ("table.csv", "index.html")] == before


@pytest.mark.slow
def test_interrupted_sweep_keeps_what_is_finished(sweep, tmp_path):
    said, out = [], tmp_path / "out"
    answers = [RECORD, RECORD, KeyboardInterrupt()]
    done, _ = sweep(answer=lambda number: answers[number], say=said.append)
    assert (done.exit_code, done.left, len(table(out))) == (130, 2, 2)
    message = f"interrupted: 2 of 4 runs are finished and kept; palpate sweep {out}"
    assert said[-1].startswith(message)
    (out / "runs" / ".half").mkdir()  # of a sweep that was killed
    done, workers = sweep()
    assert (done.exit_code, len(workers.begun), len([*(out / "runs").iterdir()])) == (0, 2, 4)
    answers = [RECORD, InputError("the disk is full")]
    with pytest.raises(InputError, match=r"the disk is full; 1 of 4 runs are finished and kept"):
        sweep(answer=lambda number: answers[number], out=tmp_path / "other")
    said.clear()  # another file keeps the runs that still occur
    more = "scene: sphere\nlist: [{planner.tolerance: 0.5e-3}, {planner.tolerance: 0.4e-3}]\n"
    _, workers = sweep(more, say=said.append)
    assert said[0] == f"{out}: 2 runs, 1 finished already"
    assert len(workers.begun) == 1 and len(table(out)) == 2
    assert len([*(out / "runs").iterdir()]) == 5 and (out / "sweep.yaml").read_text() == more


@pytest.mark.slow
def test_runs_of_dead_workers_and_damaged_records_are_begun_again(sweep, tmp_path):
    done, workers = sweep(answer=lambda number: None if number in (0, 1) else RECORD)
    assert done.exit_code == 0 and len(workers.begun) == 6
    done, _ = sweep(answer=lambda _: None, out=tmp_path / "other")
    assert done.exit_code == 1
    assert {row["reason"] for row in table(tmp_path / "other")} == {"its worker died 3 times"}
    assert sweep(out=tmp_path / "other")[0].kept == 0
    done, _ = sweep(answer=lambda n: RECORD | {"exit_code": int(n == 1)}, out=tmp_path / "missed")
    assert done.exit_code == 1  # missed goals are kept
    for text in (b"{", b"[]", b'{"exit_code": 0}', b"\xff"):
        next((tmp_path / "missed" / "runs").glob("*/run.json")).write_bytes(text)
        assert sweep(out=tmp_path / "missed")[0].kept == 3


@pytest.mark.slow
def test_folders_in_use_or_of_something_else_are_refused(sweep, tmp_path, monkeypatch):
    def second(number):
        with pytest.raises(InputError, match="out: another sweep is at work there"):
            sweep()
        return RECORD

    assert sweep(answer=second)[0].exit_code == 0
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="full: holds no sweep; choose a new or an empty folder"):
        sweep(out=tmp_path / "full")
    with pytest.raises(InputError, match=r"mine\.txt: cannot be written"):
        sweep(out=tmp_path / "full" / "mine.txt")
    monkeypatch.chdir(tmp_path)
    folder = sweep(out=None)[0].folder
    assert folder.parent.name == "sweeps" and folder.name.endswith("_four")


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), max_size=30))
def test_front_has_all_points_that_are_not_dominated(points):
    cost, error = np.reshape(points, (-1, 2)).T
    betters = [any((c <= x and e < y) or (c < x and e <= y) for c, e in points) for x, y in points]
    assert pareto_front(cost, error).tolist() == [not one for one in betters]


def test_front_refuses_values_that_are_not_finite():
    for error in ([1.0, np.nan], [1.0, None], [np.inf, 1.0], [1.0], ["a", "b"]):
        with pytest.raises(ValueError, match=r"must be finite numbers|dimensions"):
            pareto_front([1.0, 2.0], error)


def test_text_shows_differing_settings_and_marks_front(sweep):
    answers = [{"touches": 90}, {"touches": 91, "exit_code": 1, "rms_m": 3e-5}, FAILED]
    text = "scene: sphere\nseeds: 3\ngrid: {planner.tolerance: [1.0e-3]}\n"
    shown = sweep(text, lambda place: RECORD | answers[place], by_place=True)[0].text
    lines = [line.split() for line in shown.splitlines()]
    (first,) = (line for line in lines if line[:2] == ["*", "1"])
    assert first == ["*", "1", "0", "done", "0.0200", "0.0500", "90", "300", "4.5"]
    assert next(line for line in lines if line[:1] == ["2"])[:3] == ["2", "1", "missed"]
    assert next(line for line in lines if line[:1] == ["3"])[:3] == ["3", "2", "died"]
    assert next(line for line in lines if line[:1] == ["run"])[:3] == ["run", "seed", "status"]


def parts_of(text, tag):
    """Elements of a page, which is well formed but for heads without an end, with this tag."""
    root = ElementTree.fromstring(re.sub(r"<((?:meta|link)[^>]*)>", r"<\1/>", text))
    return [one for one in root.iter() if one.tag.rpartition("}")[2] == tag]


COSTS = [{"rms_m": 1e-4 / n, "touches": 40 * n} for n in (1, 2, 3)]


def test_page_leads_to_every_run_without_network(sweep, tmp_path):
    answers = [COSTS[0], COSTS[1] | {"exit_code": 1}, COSTS[2], FAILED]
    four = "scene: sphere\nseeds: 4\n"
    sweep(four, lambda place: RECORD | answers[place], by_place=True)
    text = (tmp_path / "out" / "index.html").read_text()
    links = [one.get(f"{XLINK}href") or one.get("href") for one in parts_of(text, "a")]
    folders = {row["folder"] for row in table(tmp_path / "out")}
    assert {f"{one}/" for one in folders} <= {*links} and len(parts_of(text, "figure")) == 3
    dots = re.findall(r"<title>(\d): (?:(?!<title>).)*?<a xlink:href", text, re.DOTALL)
    assert dots == 3 * len(SIZES) * ["1", "2", "3"] and len(parts_of(text, "tr")) == 5
    assert not re.search(r"https?://(?!www\.w3\.org)|src=|@import|url\((?!#)", text)
    assert "no <luck>" not in text and "1 run without a model" in text
    sweep(four, lambda _: FAILED, out=tmp_path / "failed")
    assert parts_of((tmp_path / "failed" / "index.html").read_text(), "figure") == []


def drawn(rows):
    """What is drawn of runs: their dots by ``gid``, and the steps of the fronts."""
    figure, notes = draw_front(rows, "touches", "scene", Path("x"), (600.0, 400.0))
    [axes] = figure.axes
    dots = {one.get_gid(): one for one in axes.lines if one.get_gid()}
    assert {*dots} == {*notes}
    return axes, dots, [one for one in axes.lines if one.get_drawstyle() == "steps-post"]


def row_of(number, scene="sphere", **figures):
    return Row(number, {"scene": scene}, RECORD | {"folder": "f"} | figures)


def test_chart_shows_each_run_with_its_bound_and_the_front():
    doubtful = {"touches": 200, "rms_m": 9e-5, "rms_bound_95_m": None, "exit_code": 1}
    rows = [row_of(n, **one) for n, one in enumerate((*COSTS, doubtful, FAILED), 1)]
    axes, dots, [front] = drawn(rows)
    for row in rows[:4]:
        [(x, y)] = dots[f"run{row.number}"].get_xydata()
        assert (x, y) == pytest.approx((row.record["touches"], 1e3 * row.record["rms_m"]))
    hollow = {name for name, one in dots.items() if one.get_markerfacecolor() == charts.PAGE}
    assert len(dots) == 4 and hollow == {"run4"}
    ends = [path.vertices[-1] for path in axes.collections[0].get_paths() if len(path.vertices)]
    assert np.isclose([y for _, y in ends if np.isfinite(y)], 0.05).sum() == 3
    x, y = front.get_xydata().T  # to the right and down
    assert (np.diff(x) > 0.0).all() and (np.diff(y) <= 0.0).all() and x[-1] == axes.get_xlim()[1]
    assert [one.get_text() for one in axes.texts] == ["1", "2", "3"]
    assert axes.get_ylabel().endswith("error, mm") and axes.get_xlabel() == "touches"

    pairs = enumerate(product(("sphere", "egg"), COSTS[:2]), 1)  # scenes have their own fronts
    rows = [row_of(n, scene=scene, **one) for n, (scene, one) in pairs]
    axes, dots, fronts = drawn(rows)
    assert axes.get_ylabel().endswith("error, % of the height")
    assert [len(one.get_xydata()) for one in fronts] == [3, 3]
    assert len({one.get_color() for one in (*fronts, *dots.values())}) == 2
