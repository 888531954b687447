"""Nodes of a running graph, their parameters, requests to its launcher, and what is well."""

import hashlib
import json
import os
import resource
import shutil
import sys
from collections import namedtuple
from importlib import metadata
from pathlib import Path

import pytest
import zmq
from ruamel.yaml import YAML

from palpate.launch.node_kinds import list_kinds
from palpate.launch.processes.registry import running_graphs
from palpate.messages import decode
from palpate.messages.types import TYPES, TactileFrame
from palpate.tools.introspection.doctor import graphs_findings, machine_findings
from palpate.tools.introspection.requests import RequestTimeouts, request
from tests.tools.toy_graph import PARAMS

Usage = namedtuple("Usage", "total used free")


def yaml(text):
    return YAML(typ="safe", pure=True).load(text)


def test_nodes_are_listed_while_they_run(graph, call):
    graph.nodes["hearer"]["pid"] = 0
    graph.start()
    assert call("node list").out.split() == ["cleaner", "player", "talker"]
    assert call("node list -a").out.split() == ["cleaner", "hearer", "player", "talker"]


def test_node_info_shows_health_topics_and_parameters(graph, call, refusal):
    graph.status |= {"gaps": 2, "duplicates": 1, "p50": 3.0, "p99": 4.0}
    graph.nodes["cleaner"] |= {"pid": 0, "restarts": 2}
    graph.start()
    about = json.loads(call("node info /talker --json").out)
    assert (about["kind"], about["pid"], about["restarts"]) == ("my_lab.talker", 9, 0)
    assert about["status"]["messages"] == 5 and about["load"] > 0.0
    published = {"topic": "/t", "type": "TactileFrame", "subscribers": ["hearer"]}
    assert about["publishes"][0] == published
    lines = call("node info talker").out.splitlines()
    for line in (
        "  pid       9",
        "  state     running",
        "  messages  5 handled, 7 sent",
        "  gaps      2, duplicates 1",
        "  handler   p50 3 us, p99 4 us",
        "    /odd  NoSuchType  to no node",
        "    size: 3",
    ):
        assert line in lines
    assert any("% of a core now" in line for line in lines)
    cleaner = call("node info cleaner").out
    assert "kind      filter" in cleaner and "pid       none: it does not run" in cleaner
    hearer = call("node info hearer").out
    assert "  state     silent for 0.1 s: it works, or hangs\n" in hearer
    assert "    /t  TactileFrame  from talker\n" in hearer
    assert "no node 'talkr'; did you mean 'talker'?" in refusal("node info talkr")


def test_parameters_are_dumped_with_long_values_as_hashes(graph, call, refusal):
    dumped = yaml(call("param dump").out)
    assert list(dumped) == ["talker", "hearer", "cleaner", "player"]
    assert dumped["hearer"]["params"] == {}
    params = dumped["talker"]["params"]
    assert (params["size"], params["deep"]) == (3, {"pose": [1.5]})
    text = PARAMS["text"].encode()
    assert params["mesh"] == f"300 bytes, sha256 {hashlib.sha256(bytes(300)).hexdigest()}"
    assert params["text"] == f"440 bytes of text, sha256 {hashlib.sha256(text).hexdigest()}"
    assert json.loads(call("param dump talker --json").out) == {"talker": dumped["talker"]}
    assert call("param list talker").out.split() == ["size", "mesh", "text", "deep"]
    assert call("param list").out.splitlines()[:2] == ["talker:", "  size"]
    message = refusal("param dump cleanr")
    assert "the graph has no node 'cleanr'; did you mean 'cleaner'?" in message


def test_parameter_is_shown_with_type_default_and_comment(graph, call, refusal):
    lines = call("param get cleaner contact").out.splitlines()
    assert (lines[0], lines[-1]) == ("value: 0.0001", "default: 5.0e-05")
    about = json.loads(call("param get cleaner contact --json").out)
    assert about["type"] == "number > 0 and <= 0.001" and about["unit"] == "m"
    assert about["help"].startswith("Minimum compression that counts as contact")
    order = json.loads(call("param get cleaner order --json").out)
    assert order["type"] == "auto | median | median-first | none | wiener | wiener-first"
    # The modules of a user are not imported, so that only the value is known.
    assert yaml(call("param get talker deep.pose").out) == {"value": [1.5]}
    message = refusal("param get talker sise")
    assert "talker has no parameter 'sise'; did you mean 'size'?" in message
    assert "talker has no parameter 'size.x'" in refusal("param get talker size.x")


def test_parameter_is_set_in_base_units_and_a_player_stepped(graph, call, refusal):
    graph.start()
    for verb in ("bag pause", "bag resume", "bag step -n 3"):
        assert call(verb).code == 0
    step = {"kind": "step", "number": 3}
    wanted = [{"node": "player", **one} for one in ({"kind": "pause"}, {"kind": "resume"}, step)]
    assert graph.requests == wanted
    graph.requests.clear()
    for value, sent in (("0.2mm", 0.0002), ("3.0e-4", 0.0003)):
        text = call("param set cleaner contact", value).out
        assert text == f"cleaner.contact: 0.0001 -> {sent}\n"
        asked = graph.requests.pop()
        assert json.loads(asked.pop("value")) == pytest.approx(sent)
        assert asked == {"kind": "set", "node": "cleaner", "param": "contact"}
    assert "contact 2kg: " in refusal("param set cleaner contact 2kg")
    assert graph.requests == []
    graph.refusing = "contact cannot be so large"
    assert refusal("param set cleaner contact 1") == "palpate: contact cannot be so large\n"


def test_message_is_published_by_its_node(graph, call, refusal):
    graph.start()
    fields = "goal: 1, touch: 2, finger: 1, placement: 0, direction: [0, 0, 1]"
    fields += ", pose: [0, 0, 0, 0, 0, 0, 1], move: [0, 0, 0, 0, 0], robot_time: 3"
    body = f"{{{fields}, outcome: hit, array: [[1, 2], [3, 4]]}}"
    text = "published TactileFrame on /t\n"
    assert call("topic pub t", body, "-t", 2, "-r", 1000).out == 2 * text
    asked = graph.requests[0]
    assert (asked["kind"], asked["node"], asked["topic"]) == ("publish", "talker", "/t")
    message = decode(TactileFrame, asked["body"])
    assert message.array.tolist() == [[1.0, 2.0], [3.0, 4.0]] and message.robot_time == 3.0
    for wrong, words in (
        ("[1]", "BODY must be a map of fields in YAML, got '[1]'"),
        ("{goal: 1}", "a TactileFrame lacks touch, finger"),
        (body.replace("goal: 1", "goal: 1, gaol: 1"), "a TactileFrame has no gaol; its fields are"),
        (body.replace("[[1, 2], [3, 4]]", "nothing"), "array must be an array of float64, got "),
    ):
        assert words in refusal("topic pub /t", wrong, "--once")
    assert "--rate must be positive, got 0" in refusal("topic pub /t", body, "-r", 0)
    assert "/log is what nodes report of themselves" in refusal("topic pub /log", body)


def test_every_kind_of_node_explains_its_parameters(call, refusal):
    kinds = call("node kinds").out.split()
    assert kinds == list(list_kinds())
    for name in kinds:
        first, about, *lines = call("node kinds", name).out.splitlines()
        assert first == name and (about.endswith((".", ",", ":")) or len(about) > 20)
        for place, line in enumerate(lines):
            assert not line.startswith("  takes ") or lines[place + 1].startswith(" " * 8), line
    planner = call("node kinds planner").out
    assert "  subscribes /world  World" in planner
    assert "  publishes  /contour/goal  ContourGoal" in planner
    assert "  takes planner  string  default predicted" in planner
    assert "  takes object  ObjectSpec  required" in call("node kinds simulator").out
    assert "  subscribes to everything" in call("node kinds recorder").out
    message = refusal("node kinds plannet")
    assert "there is no kind of node 'plannet'; did you mean 'planner'" in message


def test_every_message_type_is_shown_with_its_fields(graph, call, refusal):
    assert call("interface list").out.split() == sorted({*TYPES, "Bends"})
    for name, kind in TYPES.items():
        first, *lines = call("interface show", name).out.splitlines()
        shown = {line.split()[0] for line in lines if line.split()}
        assert first == name and shown >= {*kind.__dataclass_fields__}
        assert not any("<f8" in line for line in lines)
    own = call("interface show Bends").out
    assert "goal       integer  #" in own and "curvature  number  1/m" in own
    message = refusal("interface show Bend")
    assert "there is no type 'Bend'; did you mean 'Bends'?" in message


def levels(findings):
    found = [*findings]
    assert all("\n" not in one.text for one in found)
    return {one.text: one.level for one in found if one.level != "ok"}


def test_this_machine_can_run_a_graph(runtime, call, monkeypatch):
    monkeypatch.chdir(runtime)
    code, out, _ = call("doctor --report")
    assert code == 0 and "FAIL" not in out and "ok   no graph of yours is running\n" in out
    assert "package   numpy " in out and f"variable  XDG_RUNTIME_DIR={runtime}\n" in out
    findings = json.loads(call("doctor --json").out)["findings"]
    assert {one["level"] for one in findings} <= {"ok", "WARN"}
    # Unless parts are missing, or folders were left behind.
    monkeypatch.setitem(sys.modules, "lz4.frame", None)
    (runtime / "palpate-run-dead").mkdir()
    (runtime / "palpate-run-dead" / "run.json").touch()
    found = levels(machine_findings())
    for words in ("recordings cannot be compressed; install lz4", "have left palpate-run-dead"):
        assert [level for text, level in found.items() if words in text] == ["WARN"]


def missing_package(name):
    if name == "numpy":
        raise metadata.PackageNotFoundError(name)
    return metadata.Distribution.from_name(name)


def missing(path):
    return str(path) != "/proc/self/stat" and os.path.lexists(path)


# What is replaced, by what, the level of the finding, and its words.
FAULTS = [
    (metadata, "distribution", missing_package, "FAIL", "packages are missing: numpy"),
    (zmq, "zmq_version_info", lambda: (4, 2, 9), "FAIL", "is too old, the bus needs 4.3"),
    (zmq, "has", lambda name: name != "ipc", "FAIL", "has no Unix sockets"),
    (zmq, "has", lambda name: name != "curve", "WARN", "cannot encrypt"),
    (zmq, "IPC_PATH_MAX_LEN", 10, "FAIL", "at most 10 are allowed; set XDG_RUNTIME_DIR"),
    (shutil, "disk_usage", lambda _: Usage(0, 0, 1 << 20), "FAIL", "make room"),
    (shutil, "disk_usage", lambda _: Usage(0, 0, 1 << 25), "WARN", "recording may not fit"),
    (os, "access", lambda *_: False, "FAIL", "cannot be written; choose another folder"),
    (os, "sched_getaffinity", lambda _: {0}, "WARN", "--composed is faster here"),
    (resource, "getrlimit", lambda _: (64, 64), "WARN", "at most 64 open files a process"),
    (Path, "exists", missing, "WARN", "there is no /proc"),
]


@pytest.mark.parametrize(("place", "name", "value", "level", "words"), FAULTS)
def test_doctor_finds_faults_of_the_machine(runtime, monkeypatch, place, name, value, level, words):
    monkeypatch.chdir(runtime)
    before = levels(machine_findings())
    monkeypatch.setattr(place, name, value)
    found = levels(machine_findings())
    new = {level for text, level in found.items() if words in text and text not in before}
    assert new == {level}


@pytest.mark.parametrize(
    ("answer", "gaps", "level", "words"),
    [
        ({}, 0, "ok", "runs for 3 s: 1 nodes, 5 messages handled, none missing"),
        ({"pid": 0}, 0, "WARN", "talker does not run"),
        ({"restarts": 2}, 0, "WARN", "talker was started again 2 times"),
        ({"silent_s": 9.0}, 0, "WARN", "talker has been silent for 9 s"),
        ({}, 4, "FAIL", "talker misses 4 messages"),
    ],
)
def test_doctor_finds_faults_of_a_graph(graph, answer, gaps, level, words):
    graph.nodes = {"talker": graph.nodes["talker"] | answer}
    graph.status["gaps"] = gaps
    graph.start()
    (finding,) = graphs_findings(running_graphs())
    assert finding.level == level
    assert finding.text.startswith(f"{graph.card.run[:6]} (vase)")
    assert words in finding.text


def test_doctor_fails_for_a_graph_that_does_not_answer(graph, monkeypatch):
    monkeypatch.setitem(request.__kwdefaults__, "timeouts", RequestTimeouts(answer=0.05))
    (finding,) = graphs_findings(running_graphs())
    assert finding.level == "FAIL" and "gives no answer within 0.05 s" in finding.text
