from __future__ import annotations

import re

import pytest

from palpate.launch.files import InputError
from palpate.tools.sweep import read_sweep
from palpate.tools.sweep.sweep_file import MOST_RUNS, run_name

GRID = """scene: sphere
seeds: 2
grid:
  planner.tolerance: [1.0e-3, 0.5e-3]
  scene.sensor.pitch: [1.0e-3, 1.2e-3]
"""


def asked(write, text):
    return [dict(run.asked) for run in read_sweep(write("sweep.yaml", text)).runs]


def test_a_grid_is_every_combination_with_the_seeds_innermost(write):
    found = asked(write, GRID)
    assert [tuple(one.values()) for one in found[:3]] == [
        ("sphere", 1e-3, 1e-3, 0),
        ("sphere", 1e-3, 1e-3, 1),
        ("sphere", 1e-3, 1.2e-3, 0),
    ]
    assert len(found) == 8
    assert list(found[0]) == ["scene", "planner.tolerance", "scene.sensor.pitch", "seed"]


def test_each_entry_of_a_list_goes_through_the_rest_of_the_grid(write):
    text = "scene: [sphere, egg]\ngrid: {planner.planner: [predicted, fuzzy], fingers: [1, 2]}\n"
    text += "list:\n  - {}\n  - {planner.planner: uniform, planner.settings.count: 4}\n"
    found = asked(write, text)
    assert [one["scene"] for one in found] == ["sphere"] * 6 + ["egg"] * 6
    kinds = [(one["planner.planner"], one["fingers"]) for one in found[:6]]
    assert kinds == [
        *(("predicted", 1), ("predicted", 2), ("fuzzy", 1), ("fuzzy", 2)),
        *(("uniform", 1), ("uniform", 2)),
    ]
    assert "planner.settings.count" not in found[0]
    assert found[5]["planner.settings.count"] == 4


def test_what_is_asked_for_reaches_simulator_and_planner(write, tmp_path):
    text = "scene: sphere\nseeds: [7]\ngrid:\n  planner.tolerance: [0.7e-3]\n"
    text += "  scene.effects.gaussian_noise.sigma: [3.0e-6]\n  'scene.object.superquadric.size[2]':"
    (run,) = read_sweep(write("sweep.yaml", f"{text} [0.03]\n")).runs
    nodes = {one.name: one.params for one in run.plan(tmp_path / "run").wirings}
    assert nodes["planner"].tolerance == 0.7e-3
    assert nodes["simulator"].seed == 7
    assert nodes["simulator"].effects["gaussian_noise"] == {"sigma": 3.0e-6}
    assert nodes["simulator"].object.superquadric.size[2] == 0.03


def test_demands_have_units_as_on_the_command_line(write, tmp_path):
    text = "scene: sphere\ngrid: {tolerance: [0.7mm], feature: [1 cm], budget: [10min]}\n"
    (run,) = read_sweep(write("sweep.yaml", text)).runs
    (planner,) = (w.params for w in run.plan(tmp_path / "run").wirings if w.name == "planner")
    found = planner.tolerance, planner.feature, planner.most_seconds
    assert found == pytest.approx((0.7e-3, 10e-3, 600.0))
    assert run.asked["tolerance"] == "0.7mm"


def test_runs_are_told_apart_by_what_their_parameters_come_to(write):
    plain = read_sweep(write("a.yaml", "scene: sphere\n")).runs
    same = read_sweep(write("b.yaml", "scene: sphere\nseeds: [0]\ngrid: {fingers: [1, 1, 2]}\n"))
    assert len({run.mark for run in same.runs}) == 2
    assert same.repeated == 1
    assert plain[0].mark == same.runs[0].mark
    assert plain[0].name != same.runs[0].name
    silent = read_sweep(write("a.yaml", "scene: sphere\n"), record=False).runs
    assert silent[0].mark == plain[0].mark  # whether it is recorded does not change a run


def test_names_need_no_care_in_folders_and_links():
    name = run_name("my scene", {"scene": "x", "planner.planner": "mine:Own", "a.axis": [0, 1]})
    assert name == "my-scene_planner-mine-Own_axis--0-1-"
    assert re.fullmatch(r"[\w.-]{1,80}", run_name("s" * 200, {}))


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("scene: vaze\n", "sweep.yaml:1: there is no scene 'vaze'; did you mean 'vase'?"),
        ("scene: []\n", "sweep.yaml:1: scene is []; expected list of length >= 1"),
        ("scene: sphere\nseeds: 0\n", "sweep.yaml:2: seeds is 0; expected whole number >= 1"),
        (f"scene: sphere\nseeds: {MOST_RUNS + 1}\n", "sweep.yaml:2: seeds is 10001"),
        (
            "scene: sphere\nseeds: 5001\ngrid: {fingers: [1, 2]}\n",
            "sweep.yaml:1: has more than 10000 runs",
        ),
        ("scene: sphere\ngird: {}\n", "sweep.yaml:2: unknown key 'gird'; did you mean 'grid'?"),
        ("scene: sphere\ngrid: {fingers: []}\n", "sweep.yaml:2: grid is a map of fingers"),
        (
            "scene: sphere\ngrid:\n  planner.tolernce: [1.0e-3]\n",
            "sweep.yaml:3: unknown key 'tolernce' in planner; did you mean 'tolerance'?",
        ),
        (
            "scene: sphere\ngrid:\n  planer.tolerance: [1.0e-3]\n",
            "sweep.yaml:3: there is no node 'planer'; did you mean 'planner'?",
        ),
        (
            "scene: sphere\ngrid:\n  scene.sensr.pitch: [1.0e-3]\n",
            "sweep.yaml:3: unknown key 'sensr'; did you mean 'sensor'?",
        ),
        (
            "scene: sphere\ngrid:\n  scene.sensor.pitch:\n    - 1.0e-3\n    - -2\n",
            "sweep.yaml:5: sensor.pitch is -2; expected number >= 0.0002",
        ),
        (
            "scene: sphere\ngrid:\n  scene.effects.gaussian_noise.sigma: [-1]\n",
            "sweep.yaml:3: effects.gaussian_noise: sigma is -1 m; expected 0 to 0.001 m",
        ),
        (
            "scene: sphere\ngrid: {tolernce: [1.0e-3]}\n",
            "sweep.yaml:2: there is no parameter 'tolernce'; did you mean 'tolerance'?; others",
        ),
        (
            "scene: sphere\ngrid:\n  tolerance: [1mm, 0.2]\n",
            "sweep.yaml:3: tolerance 0.2: must have a unit: m, cm, mm, um, in, ft, as in 0.2mm",
        ),
        (
            "scene: sphere\ngrid: {budget: [0s]}\n",
            "sweep.yaml:2: budget 0s: must be more than 0",
        ),
        (
            "scene: sphere\nlist:\n  - {planner.planner: fuzzy,\n     planner.settings.curl: 9}\n",
            "sweep.yaml:4: ",
        ),
        (
            "scene: sphere\ngrid: {fingers: [1]}\nlist: [{fingers: 2}]\n",
            "sweep.yaml:2: every entry of list says fingers",
        ),
    ],
)
def test_what_cannot_be_run_is_refused_with_its_line(write, text, complaint):
    path = write("sweep.yaml", text)
    with pytest.raises(InputError) as refused:
        read_sweep(path)
    assert str(refused.value).replace(str(path), "sweep.yaml").startswith(complaint)


def test_the_last_combination_is_checked_too_and_named(write):
    text = (
        "scene: sphere\ngrid:\n  planner.feature: [3.0e-3]\n  planner.tolerance: [1.0e-3, 1e-9]\n"
    )
    with pytest.raises(
        InputError, match=r":4: .*\(with planner.feature 0.003, planner.tolerance 1"
    ):
        read_sweep(write("sweep.yaml", text))
