from __future__ import annotations

import re

import pytest
from msgspec import Struct

from palpate.launch.files.source_map import InputError
from palpate.launch.graph import Graph, override, read_arguments, read_settings
from palpate.launch.node_kinds import Entry


class Dials(Struct, frozen=True, kw_only=True):
    turns: int = 3
    name: str = "x"


def test_a_setting_is_laid_over_the_parameters_and_says_so_in_its_place():
    graph = Graph((Entry(name="a", params={"name": "y"}), Entry(name="b")), "a")
    a, b = override(graph, read_settings(["a.turns=5", "a.turns=6"])).entries
    assert a.params == {"name": "y", "turns": 6}
    assert a.settings.place(("turns",)) == "--set a.turns=6"
    assert b.params == {}


def test_a_setting_is_laid_over_a_struct_too():
    graph = Graph((Entry(name="a", params=Dials(name="y")),), "a")
    (a,) = override(graph, read_settings(["a.turns=[1, 2]"])).entries
    assert a.params == {"name": "y", "turns": [1, 2]}


def test_a_setting_reaches_into_a_map_that_a_parameter_holds():
    graph = Graph((Entry(name="a", params={"numbers": {"count": 3, "most": 9}, "turns": 1}),), "a")
    (a,) = override(graph, read_settings(["a.numbers.count=5", "a.more.x=2"])).entries
    assert a.params == {"numbers": {"count": 5, "most": 9}, "turns": 1, "more": {"x": 2}}
    assert a.settings.place(("numbers", "count")) == "--set a.numbers.count=5"
    with pytest.raises(InputError, match="turns is 1, which has no x to set"):
        override(graph, read_settings(["a.turns.x=5"]))


def test_a_setting_reaches_the_nodes_of_all_fingers_or_that_of_one():
    names = ("a_1", "a_2", "b_1")
    entries = tuple(Entry(name=name, kind="k", namespace=f"finger_{name[-1]}") for name in names)
    found = override(Graph(entries, "a"), read_settings(["a.turns=5", "a_2.turns=6", "a_2.name=z"]))
    assert [entry.params for entry in found.entries] == [
        {"turns": 5},
        {"turns": 6, "name": "z"},
        {},
    ]


@pytest.mark.parametrize(("setting", "words"), [
    ("a.turns", "--set a.turns: must look like planner.tolerance=0.2e-3"),
    ("turns=3", "--set turns=3: must look like planner.tolerance=0.2e-3"),
    ("simulater.x=3", "there is no node 'simulater'; did you mean 'simulator'?"),
    ("a.turns=[", "--set a.turns=[:1: is not YAML"),
])  # fmt: skip
def test_a_wrong_setting_is_refused(setting, words):
    graph = Graph((Entry(name="a"), Entry(name="simulator")), "a")
    with pytest.raises(InputError, match=re.escape(words)):
        override(graph, read_settings([setting]))


def test_arguments_are_read_as_yaml():
    found = read_arguments(["scene:=vase", "record:=false", "seed:=3"])
    assert {name: value.value for name, value in found.items()} == {
        "scene": "vase",
        "record": False,
        "seed": 3,
    }


@pytest.mark.parametrize("text", ["scene=vase", ":=vase"])
def test_a_wrong_argument_is_refused(text):
    with pytest.raises(InputError, match="an argument must look like scene:=vase"):
        read_arguments([text])
