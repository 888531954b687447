"""Graphs are checked whole: names, topics, types, namespaces, parameters, settings."""

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import pytest
from msgspec import Meta, Struct

from palpate.launch.files.source_map import InputError
from palpate.launch.files.yaml_file import parse_yaml
from palpate.launch.graph import Graph, override, read_arguments, read_settings, resolved_text
from palpate.launch.node_kinds import Entry
from palpate.messages import schema
from palpate.messages.fields import Metres
from palpate.messages.types import LogRecord, NodeStatus, Truth, World
from palpate.nodes.runtime.node import Sink, schemas_of, with_description


class Dials(Struct, frozen=True, kw_only=True):
    turns: Annotated[int, Meta(ge=1)] = 3


class Named(Struct, frozen=True, kw_only=True):
    turns: int = 3
    name: str = "x"


def graph_of(*entries, ends="b"):
    return Graph(entries, ends, "f.yaml:9")


@pytest.fixture
def pair(make_node):
    make_node("t.a", outputs={"/x": LogRecord}, params=Dials)
    make_node("t.b", inputs={"/x": LogRecord})
    return Entry(name="a", kind="t.a", source="f.yaml:2"), Entry(name="b", kind="t.b")


def test_wiring_table_and_resolved_text_name_topics_and_what_differs_from_defaults(pair):
    a, b = graph_of(*pair).wirings()
    assert a.outputs == {"/x": "/x"}
    assert a.subscribers == {"/x": ("b",)}
    assert a.params == Dials(turns=3)
    [edge] = b.inputs
    assert (edge.publisher, edge.topic, edge.local, edge.type) == ("a", "/x", "/x", "LogRecord")
    table = graph_of(*pair).table().splitlines()
    assert table[0].split() == ["topic", "type", "from", "to"]
    assert table[1].split() == ["/x", "LogRecord", "a", "b"]
    assert table[-1] == "ends with the Finished of b"
    a = replace(pair[0], remap={"/x": "/z"}, namespace="one")
    b = replace(pair[1], remap={"/x": "/z"})
    first, second = graph_of(a, b).wirings()
    assert first.outputs == {"/x": "/z"}
    assert [(i.topic, i.local) for i in second.inputs] == [("/z", "/x")]
    a = replace(pair[0], remap={"/x": "/z"}, nice=3, host="lab2", on_exit="stop")
    graph = graph_of(a, replace(pair[1], remap={"/x": "/z"}, namespace="one"))
    assert parse_yaml(resolved_text(graph, graph.wirings(), Path("out")), "f").value == {
        "nodes": {
            "a": {
                "kind": "t.a", "params": {"turns": 3}, "remap": {"/x": "/z"}, "host": "lab2",
                "nice": 3, "on_exit": "stop",
            },
            "b": {"kind": "t.b", "params": {}, "remap": {"/x": "/z"}, "namespace": "one"},
        },
        "ends": "b",
    }  # fmt: skip
    assert "remap" not in resolved_text(graph_of(*pair), graph_of(*pair).wirings(), Path("out"))


def spaced(kind, *namespaces):
    return [Entry(name=f"{kind}{n}", kind=f"t.{kind}", namespace=one) for n, one in namespaces]


def received(wiring):
    return {one.local: (one.publisher, one.topic) for one in wiring.inputs}


def test_namespace_is_searched_first_and_fan_in_takes_all(make_node):
    make_node("t.a", outputs={"/x": LogRecord})
    make_node("t.b", inputs={"/x": LogRecord, "/y": LogRecord})
    make_node("t.c", outputs={"/y": LogRecord})
    sources = spaced("a", (1, "one"), (2, "two"))
    wirings = graph_of(*sources, *spaced("b", ("", "two")), *spaced("c", ("", ""))).wirings()
    assert received(wirings[2]) == {"/x": ("a2", "/two/x"), "/y": ("c", "/y")}
    make_node("t.b", inputs={"/x": LogRecord}, fan_in=("/x",))
    b = graph_of(*sources, *spaced("b", ("", ""))).wirings()[-1]
    edges = [(one.publisher, one.topic, one.local) for one in b.inputs]
    assert edges == [("a1", "/one/x", "/x"), ("a2", "/two/x", "/x")]
    make_node("t.b", inputs={"/x": LogRecord})
    with pytest.raises(InputError, match="subscribes to /x, which no node publishes"):
        graph_of(*sources[:1], *spaced("b", ("", ""))).wirings()


def test_shared_topics_belong_to_the_first_finger(make_node):
    make_node(
        "t.a",
        inputs={"/x": LogRecord, "/ask": LogRecord},
        outputs={"/y": LogRecord, "/told": LogRecord},
        shared=("/ask", "/told"),
    )
    make_node("t.b", inputs={"/told": LogRecord}, outputs={"/x": LogRecord})
    make_node("t.c", inputs={"/y": LogRecord}, outputs={"/ask": LogRecord}, fan_in=("/y",))
    fingers = [(f"_{n}", f"finger_{n}") for n in (1, 2)]
    entries = [*spaced("a", *fingers), *spaced("b", *fingers), *spaced("c", ("", ""))]
    a1, a2, b1, b2, c = graph_of(*entries, ends="c").wirings()
    assert a1.outputs == {"/y": "/finger_1/y", "/told": "/told"}
    assert a2.outputs == {"/y": "/finger_2/y"}
    assert [received(one) for one in (a1, a2, b1, b2)] == [
        {"/x": ("b_1", "/finger_1/x"), "/ask": ("c", "/ask")},
        {"/x": ("b_2", "/finger_2/x")},
        {"/told": ("a_1", "/told")},
        {"/told": ("a_1", "/told")},
    ]
    assert a1.subscribers["/told"] == ("b_1", "b_2")
    assert [i.topic for i in c.inputs] == ["/finger_1/y", "/finger_2/y"]


def test_sink_takes_every_topic_and_a_node_ends_the_graph(pair, make_node):
    nothing: Any = lambda params, types: None  # noqa: E731
    make_node("t.s", value=Sink(params=Dials, open=nothing))
    wirings = graph_of(*pair, Entry(name="s", kind="t.s")).wirings()
    assert [i.topic for i in wirings[2].inputs] == ["/x"]
    assert wirings[0].subscribers == {"/x": ("b", "s")}
    with pytest.raises(InputError, match="ends names 's'"):
        graph_of(*pair, Entry(name="s", kind="t.s"), ends="s").wirings()
    for ends in ("c", ""):
        with pytest.raises(InputError, match=f"^f.yaml:9: ends names '{ends}'"):
            graph_of(*pair, ends=ends).wirings()


@pytest.mark.parametrize(("which", "change", "words"), [
    (1, {"name": "a"}, "node 'a': the name is taken by f.yaml:2"),
    (0, {"name": "A b"}, "the name must be a letter"),
    (0, {"name": "launcher"}, "the name of the launcher"),
    (0, {"namespace": "/one"}, "the namespace '/one' must be"),
    (0, {"kind": "plannet"}, "there is no kind of node 'plannet'; did you mean 'planner'?"),
    (0, {"kind": "t.none"}, "f.yaml:2: node 'a': no module 't.none'"),
    (0, {"kind": "palpate.nodes.runtime.node"}, "holds no NODE"),
    (0, {"remap": {"/xx": "/x"}}, "has no topic '/xx' to remap; did you mean '/x'?"),
    (0, {"remap": {"/x": "x y"}}, "/x cannot become 'x y'"),
    (0, {"params": {"turn": 1}}, "f.yaml:2: unknown key 'turn' in a; did you mean 'turns'?"),
    (0, {"params": {"turns": 0}}, "a.turns is 0; expected whole number >= 1"),
    (0, {"params": [1]}, "params must be a map"),
    (0, {"remap": {"/x": "/xx"}}, "subscribes to /x, which no node publishes; did you mean '/xx'?"),
])  # fmt: skip
def test_graph_that_could_not_run_is_refused(pair, which, change, words):
    entries = list(pair)
    entries[which] = replace(entries[which], **change)
    with pytest.raises(InputError, match=re.escape(words)):
        graph_of(*entries).wirings()


def test_topics_and_types_that_do_not_fit_are_refused(pair, make_node):
    a = replace(pair[0], params={"turns": 0}, places={("turns",): "--set a.turns=0"})
    with pytest.raises(InputError, match=r"^--set a.turns=0: a.turns is 0"):
        graph_of(a, pair[1]).wirings()
    with pytest.raises(InputError, match="publishes /x, which 'a' publishes already"):
        graph_of(*pair, replace(pair[0], name="c")).wirings()
    make_node("t.c", inputs={"/x": NodeStatus})
    words = "subscribes to /x as NodeStatus, but 'a' publishes it as L"
    with pytest.raises(InputError, match=words):
        graph_of(*pair, Entry(name="c", kind="t.c")).wirings()


@pytest.mark.parametrize("topic", ["/truth", "/harmless"])
def test_truth_is_for_the_evaluator_alone_under_any_name(make_node, topic):
    make_node("t.a", outputs={"/truth": Truth})
    make_node("t.b", inputs={topic: Truth})
    make_node("palpate.nodes.evaluator", inputs={topic: Truth})
    outputs = Entry(name="a", kind="t.a", remap={"/truth": topic})
    graph_of(outputs, Entry(name="b", kind="evaluator")).wirings()
    with pytest.raises(InputError, match="only an evaluator, a view or a recorder may"):
        graph_of(outputs, Entry(name="b", kind="t.b")).wirings()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Width:
    width: Metres


def named(name):
    """Another message type of one's own, with this name."""

    @dataclass(frozen=True, slots=True, eq=False, kw_only=True)
    class Made:
        height: Metres

    Made.__name__ = name
    return Made


def graph(make_node, path, *outputs):
    for number, cls in enumerate(outputs):
        make_node(f"t.n{number}", outputs={f"/n{number}": cls})
    entries = [Entry(name=f"n{i}", kind=f"t.n{i}") for i in range(len(outputs))]
    keeps = Entry(name="recorder", params={"path": str(path)})
    return Graph((*entries, keeps), ends="n0").wirings()


def test_recording_has_the_schemas_of_own_types(make_node, tmp_path):
    path = tmp_path / "topics.mcap"
    wirings = with_description(graph(make_node, path, Width, World, Width), {})
    assert schemas_of(wirings[-1].params.graph) == {"Width": json.dumps(schema(Width))}


@pytest.mark.parametrize(("outputs", "words"), [
    ((named("World"),),
     "node 'n0': publishes /n0 as World of .*, but palpate.messages.types.world"),
    ((Width, named("Width")), "node 'n1': publishes /n1 as Width of .*; rename it"),
    ((int,), "node 'n0': publishes /n0: int is not a message type"),
])  # fmt: skip
def test_ambiguous_types_are_refused(make_node, tmp_path, outputs, words):
    with pytest.raises(InputError, match=words):
        graph(make_node, tmp_path / "topics.mcap", *outputs)


def test_setting_is_laid_over_parameters_of_all_fingers_or_one():
    graph = Graph((Entry(name="a", params={"name": "y"}), Entry(name="b")), "a")
    a, b = override(graph, read_settings(["a.turns=5", "a.turns=6"])).entries
    assert a.params == {"name": "y", "turns": 6}
    assert a.settings.place(("turns",)) == "--set a.turns=6"
    assert b.params == {}
    graph = Graph((Entry(name="a", params=Named(name="y")),), "a")
    (a,) = override(graph, read_settings(["a.turns=[1, 2]"])).entries
    assert a.params == {"name": "y", "turns": [1, 2]}
    graph = Graph((Entry(name="a", params={"numbers": {"count": 3, "most": 9}, "turns": 1}),), "a")
    (a,) = override(graph, read_settings(["a.numbers.count=5", "a.more.x=2"])).entries
    assert a.params == {"numbers": {"count": 5, "most": 9}, "turns": 1, "more": {"x": 2}}
    assert a.settings.place(("numbers", "count")) == "--set a.numbers.count=5"
    with pytest.raises(InputError, match="turns is 1, which has no x to set"):
        override(graph, read_settings(["a.turns.x=5"]))
    names = ("a_1", "a_2", "b_1")
    entries = tuple(Entry(name=name, kind="k", namespace=f"finger_{name[-1]}") for name in names)
    found = override(Graph(entries, "a"), read_settings(["a.turns=5", "a_2.turns=6", "a_2.name=z"]))
    params = [entry.params for entry in found.entries]
    assert params == [{"turns": 5}, {"turns": 6, "name": "z"}, {}]


@pytest.mark.parametrize(("setting", "words"), [
    ("a.turns", "--set a.turns: must look like planner.tolerance=0.2e-3"),
    ("turns=3", "--set turns=3: must look like planner.tolerance=0.2e-3"),
    ("simulater.x=3", "there is no node 'simulater'; did you mean 'simulator'?"),
    ("a.turns=[", "--set a.turns=[:1: is not YAML"),
])  # fmt: skip
def test_wrong_setting_is_refused(setting, words):
    graph = Graph((Entry(name="a"), Entry(name="simulator")), "a")
    with pytest.raises(InputError, match=re.escape(words)):
        override(graph, read_settings([setting]))


def test_arguments_are_read_as_yaml():
    found = read_arguments(["scene:=vase", "record:=false", "seed:=3"])
    values = {name: value.value for name, value in found.items()}
    assert values == {"scene": "vase", "record": False, "seed": 3}
    for text in ("scene=vase", ":=vase"):
        with pytest.raises(InputError, match="an argument must look like scene:=vase"):
            read_arguments([text])
