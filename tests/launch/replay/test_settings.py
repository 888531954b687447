from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from palpate.launch.graph import Entry, Graph
from palpate.launch.located import InputError
from palpate.launch.override import override, read_settings
from palpate.launch.replay.chosen import Chosen
from palpate.launch.replay.settings import lay_over
from palpate.nodes import tracer
from palpate.nodes.recording import describe_wirings
from palpate.nodes.wiring import Wiring, load_node


def tracers(*fingers: int) -> list[Wiring]:
    """Tracers of several fingers."""
    return [
        Wiring(
            name=f"tracer_{finger}",
            module="palpate.nodes.tracer",
            params=tracer.Params(finger=finger),
            inputs=(),
            outputs={"/finger/goal": f"/finger_{finger}/finger/goal"},
            listeners={},
        )
        for finger in fingers
    ]


def chosen(wirings: list[Wiring]) -> list[Chosen]:
    return [Chosen(tracer.NODE, wiring) for wiring in wirings]


def test_a_setting_is_laid_over_the_recorded_parameters() -> None:
    wirings = tracers(1, 2)
    again = chosen(wirings)

    found = lay_over(again, describe_wirings(wirings), read_settings(["tracer_2.most_touches=90"]))

    assert found[0] == again[0]
    assert found[1].wiring.params == tracer.Params(finger=2, most_touches=90)


def test_a_setting_without_a_number_means_the_nodes_of_all_fingers() -> None:
    wirings = tracers(1, 2)

    found = lay_over(
        chosen(wirings), describe_wirings(wirings), read_settings(["tracer.most_touches=90"])
    )

    assert [one.wiring.params.most_touches for one in found] == [90, 90]
    assert [one.wiring.params.finger for one in found] == [1, 2]


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("tracer_1.x=1", "'tracer_1' is not among the nodes to run again: tracer_2; add it to"),
        ("tracr.x=1", "there is no node 'tracr'; did you mean 'tracer'?"),
        ("most_touches=1", "must look like planner.tolerance=0.2e-3"),
    ],
)
def test_a_setting_of_another_node_is_refused(setting: str, words: str) -> None:
    one, other = tracers(1, 2)

    with pytest.raises(InputError) as caught:
        lay_over(chosen([other]), describe_wirings([one, other]), read_settings([setting]))

    assert str(caught.value).startswith(f"--set {setting}: {words}")


@pytest.mark.parametrize(
    "setting", ["filter.oder=median", "filter.order=median-frist", "filter.contact=1"]
)
def test_what_run_refuses_is_refused_in_the_same_words(setting: str, tmp_path: Path) -> None:
    node = load_node("palpate.nodes.filter")
    one = replace(tracers(1)[0], name="filter", module="palpate.nodes.filter", outputs={})
    plain = Graph((Entry(name="filter"),), ends="filter")
    with pytest.raises(InputError) as run:
        override(plain, read_settings([setting])).wirings()

    with pytest.raises(InputError) as again:
        wiring = replace(one, params=node.params())
        lay_over([Chosen(node, wiring)], describe_wirings([one]), read_settings([setting]))  # type: ignore[arg-type]

    assert str(again.value) == str(run.value)
    assert str(run.value).startswith(f"--set {setting}: ")
