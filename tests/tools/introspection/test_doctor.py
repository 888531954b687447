import os
import resource
import shutil
from collections import namedtuple
from pathlib import Path
from typing import Any

import pytest

from palpate.messages.types.catalogue import NodeStatus
from palpate.tools.introspection import doctor as machine
from palpate.tools.introspection.doctor import graph_findings, graphs_findings, machine_findings
from palpate.tools.introspection.requests import StatusSample

Usage = namedtuple("Usage", "total used free")


def level(finding):
    assert "\n" not in finding.text
    return finding.level


def test_this_machine_can_run_a_graph(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    found = list(machine_findings())
    assert [one for one in found if one.level == "FAIL"] == []
    assert all(str(one).startswith(("ok   ", "WARN ")) for one in found)


def test_a_missing_package_fails(monkeypatch):
    monkeypatch.setattr(machine, "VERSIONED_PACKAGES", ("numpy", "palpate-no-such-package"))
    found = machine.packages_finding()
    assert level(found) == "FAIL"
    assert "palpate-no-such-package" in found.text


@pytest.mark.parametrize(
    ("version", "without", "wanted"),
    [((4, 2, 9), "", "FAIL"), ((4, 3, 5), "ipc", "FAIL"), ((4, 3, 5), "curve", "WARN")],
)
def test_a_zeromq_that_lacks_something_is_reported(monkeypatch, version, without, wanted):
    monkeypatch.setattr(machine.zmq, "zmq_version_info", lambda: version)
    monkeypatch.setattr(machine.zmq, "has", lambda name: name != without)
    assert [level(one) for one in machine.zmq_findings()] == [wanted]


@pytest.mark.parametrize("module", ["palpate_none", "palpate_none.part", "msgpack.none"])
def test_a_compiled_part_that_is_missing_is_reported(module):
    found = machine.compiled_finding("lz4", module, "recordings cannot be compressed")
    assert level(found) == "WARN"
    assert "recordings cannot be compressed; install lz4" in found.text


@pytest.mark.parametrize(("free", "wanted"), [(1 << 20, "FAIL"), (1 << 25, "WARN"), (1e12, "ok")])
def test_a_full_disk_is_reported(monkeypatch, tmp_path, free, wanted):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(0, 0, free))
    assert level(machine.space_finding(tmp_path)) == wanted


def test_a_folder_that_cannot_be_written_fails(monkeypatch, tmp_path):
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert level(machine.space_finding(tmp_path)) == "FAIL"


def test_a_path_that_is_too_long_for_a_socket_fails():
    assert level(machine.socket_finding(Path("/tmp"))) == "ok"
    found = machine.socket_finding(Path("/" + "x" * 100))
    assert level(found) == "FAIL"
    assert "at most 107 will do; set XDG_RUNTIME_DIR" in found.text


def test_a_single_core_few_files_and_no_proc_are_reported(monkeypatch, tmp_path):
    few: Any = lambda _: (64, 64)  # noqa: E731
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0}, raising=False)
    monkeypatch.setattr(resource, "getrlimit", few)
    levels = [level(one) for one in machine.process_findings(tmp_path, [])]
    assert levels == ["WARN", "ok", "WARN", "WARN", "ok"]


def test_what_killed_launchers_have_left_is_named(tmp_path):
    *_, found = machine.process_findings(tmp_path, [tmp_path / "palpate-dead"])
    assert level(found) == "WARN"
    assert "palpate-dead" in found.text


def beats(gaps=0):
    status = NodeStatus(
        node="talker",
        state="running",
        messages=5,
        sent=7,
        gaps=gaps,
        duplicates=0,
        p50=1.0,
        p99=2.0,
        cpu=0.1,
    )
    return {"talker": StatusSample(status, 0.5)}


def answer(**more):
    return {"for_s": 3.0, "nodes": {"talker": {"pid": 9, "restarts": 0, "silent_s": 0.1, **more}}}


def test_a_graph_that_is_well_takes_one_line(card):
    (found,) = graph_findings(card, answer(), beats())
    assert str(found) == (
        "ok   ab12cd (vase) runs for 3 s: 1 nodes, 5 messages handled, none missing"
    )


@pytest.mark.parametrize(
    ("more", "gaps", "level", "words"),
    [
        ({"pid": 0}, 0, "WARN", "talker does not run"),
        ({"restarts": 2}, 0, "WARN", "talker was started again 2 times"),
        ({"silent_s": 9.0}, 0, "WARN", "talker has been silent for 9 s"),
        ({}, 4, "FAIL", "talker misses 4 messages"),
    ],
)
def test_each_fault_is_reported(card, more, gaps, level, words):
    (found,) = graph_findings(card, answer(**more), beats(gaps))
    assert found.level == level
    assert words in found.text


def test_that_no_graph_runs_is_no_fault():
    assert [one.level for one in graphs_findings([])] == ["ok"]
