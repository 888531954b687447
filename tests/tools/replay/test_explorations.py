"""The nodes of a real exploration run again on its recording."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from palpate.launch.files.source_map import SourceMapped
from palpate.launch.graph import read_settings
from palpate.launch.launch_source import EXPLORE
from palpate.launch.progress import Display
from palpate.launch.run import perform, plan_run
from palpate.nodes import filter as filtering
from palpate.tools.bag.contents import compare_recordings
from palpate.tools.replay.rerun import past_differences, plan_resume, replay

LOOP = ["simulator", "filter", "curvature", "tracer", "planner"]  # they receive from each other
ALL = [*LOOP, "reconstructor", "evaluator"]


def play(folder, nodes=(), settings=(), **how):
    lines: list[str] = []
    code = replay(folder, nodes, lines.append, settings=read_settings(settings), **how)
    return code, lines


def test_nodes_of_a_run_publish_the_same_again(run_folder):
    code, lines = play(run_folder)
    assert code == 0
    assert [line.partition(":")[0] for line in lines] == ["filter", "curvature", "evaluator"]
    assert all(": identical, " in line for line in lines)
    code, lines = play(run_folder, LOOP)
    assert code == 0
    assert [line.split()[:2] for line in lines] == [[f"{one}:", "identical,"] for one in LOOP]


def test_new_parameter_changes_only_dependent_values(run_folder):
    settings = ["filter.order=median-first"]
    code, lines = play(run_folder, ["filter", "curvature"], settings)
    assert code == 0 and lines[1].startswith("curvature: differs, /touch/patch ")
    fields = {tuple(line.split()[:2]) for line in lines[3:]}
    assert {("/touch/image", "compression"), ("/touch/patch", "k1")} <= fields
    assert ("/touch/patch", "pose[0:3]") not in fields  # of the arm


@pytest.mark.slow
def test_replay_with_a_parameter_equals_a_run_with_it(run_folder, tmp_path):
    values = {"filter.contact": 300e-6, "planner.most_touches": 40}
    setting = {name: SourceMapped(value, "") for name, value in values.items()}
    args = {"scene": SourceMapped(str(run_folder / "scene.yaml"), "")}
    plan = plan_run(EXPLORE, args, setting, name="ball", out=tmp_path / "run")
    other = perform(plan, composed=True, display=Display()).folder
    _, (text,) = play(run_folder, ALL, ["filter.contact=300e-6"], as_json=True)
    replayed = {
        topic: tuple(one[key] for key in ("compared", "differ", "fewer", "more"))
        for node in json.loads(text)["nodes"].values()
        for topic, one in node["topics"].items()
    }
    wanted = compare_recordings(run_folder, other).topics
    assert replayed["/touch/image"][1] > 0
    for topic, known in wanted.items():
        counts = known.compared, known.differ, known.only_a, known.only_b
        assert replayed.get(topic, counts) == counts, topic


def test_changed_filter_is_found_out(run_folder, monkeypatch):
    cls, handler = filtering.NODE.inputs["/touch/raw"]

    def off_by_a_bit(params, state, message):
        state, outputs = handler(params, state, message)
        [(topic, image)] = outputs
        image.compression.flat[100] *= 1 + 2**-52
        return state, [(topic, image)]

    inputs = {**filtering.NODE.inputs, "/touch/raw": (cls, off_by_a_bit)}
    monkeypatch.setattr(filtering, "NODE", replace(filtering.NODE, inputs=inputs))
    code, lines = play(run_folder, ["filter"])
    assert code == 1
    assert lines[0].startswith("filter: differs, /touch/image ")
    assert " compression[6, 4]: recorded " in " ".join(lines[0].split())


def test_replay_command_takes_folder_and_parameters(run_folder, call, refusal):
    verb = ["replay --nodes", "filter, curvature", run_folder]
    assert call(*verb, "--set", "filter.order=auto").out.count(": identical, ") == 2
    code, out, _ = call(*verb, "--set", "filter.order=none", "--set", "filter.contact=100e-6")
    assert code == 0 and "\n/touch/image  mask " in out
    for setting, words in (  # refused in the words of run
        ("filter.order=median-frist", "filter.order is 'median-frist'; expected one of auto, "),
        ("filter.oder=median", "unknown key 'oder' in filter; did you mean 'order'?"),
        ("filter.contact=1", "filter.contact is 1"),
    ):
        message = refusal("replay --nodes filter --set", setting, run_folder)
        assert message.startswith(f"palpate: --set {setting}: {words}")
        assert message == refusal("run vase --set", setting)


def test_resumption_repeats_earlier_decisions(run_folder, tmp_path):
    """Every node is handed what it had received until that contour, in its order."""
    plans = [
        plan_resume(run_folder, number, out=Path(tmp_path / str(number))) for number in (1, None)
    ]
    first, whole = (plan.before.consumed for plan in plans)
    assert first.keys() == whole.keys() >= {*ALL}
    for name, consumed in first.items():
        assert consumed == whole[name][: len(consumed)]
    assert len(first["reconstructor"]) < len(whole["reconstructor"])
    with pytest.raises(ValueError, match=r"has \d contours, so none to resume after 99"):
        plan_resume(run_folder, 99, out=tmp_path / "99")
    assert past_differences(run_folder, run_folder) == ""
    assert past_differences(run_folder, tmp_path) == ""
