"""Graphs on several machines, here two addresses of one."""

from __future__ import annotations

import os
import signal
import socket
import sys
from dataclasses import replace
from pathlib import Path

import psutil
import pytest
from palpate_toy import toy

from palpate.launch.files.source_map import InputError
from palpate.launch.hosts.addresses import free_endpoints, key_file, read_host
from palpate.launch.processes.process_table import HostSettings
from palpate.messages.bus import ControlClient, SocketContext, make_key
from tests.graph.conftest import started, wait_for

pytestmark = [
    pytest.mark.graph,
    pytest.mark.skipif(sys.platform != "linux", reason="has one loopback address"),
]
AWAY = "127.0.0.2"
FRAMES = 150


@pytest.fixture(scope="module", autouse=True)
def key(tmp_path_factory) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("config")))
        make_key(key_file())
        yield key_file()


@pytest.fixture(scope="module")
def away(key):
    """Another machine that lends itself: its address, and its process."""
    [endpoint] = free_endpoints(AWAY, ["port"]).values()
    where = endpoint.removeprefix("tcp://")
    env = {**os.environ, "PYTHONUNBUFFERED": "1"}
    process = started("host", where, start_new_session=True, env=env)
    assert process.stdout is not None
    assert "runs nodes for whoever has" in process.stdout.readline()
    with process:
        yield where, process
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=10)


def ring(where, work=0.0):
    return [
        toy("source", burst=FRAMES),
        replace(toy("relay", upstream="source", relay=True, work=work), host=where),
        toy("counter", upstream="relay", expects=FRAMES),
    ]


def lent_nodes(lender) -> list[int]:
    """Processes that the fork server of the other machine has started."""
    return [node.pid for one in psutil.Process(lender).children() for node in one.children()]


def test_node_killed_on_another_machine_loses_nothing(away, run, watcher):
    received = watcher.received

    def kill_at(topic, message):
        received(topic, message)
        if message.touch == FRAMES // 3:
            [node] = lent_nodes(away[1].pid)
            os.kill(node, signal.SIGKILL)

    watcher.received = kill_at
    # What is refused of a launcher of another version hurts no other.
    wires = SocketContext(str(key_file()))
    odd = ControlClient(wires.context, f"tcp://{away[0]}", name="other")
    odd.send("hello", names=["a"], modules=["m"], more=1)
    odd.send("spawn", node="a", wiring=b"", place=b"")
    ending = run(ring(away[0], work=3e-3), watch=["/relay"])
    odd.close()
    wires.close()
    assert (ending.status, ending.reason) == ("finished", f"{FRAMES} received")
    assert (ending.gaps, ending.duplicates, ending.restarts) == (0, 0, {"relay": 1})
    assert watcher.touches() == list(range(FRAMES))
    lines = [""]
    while "has ended" not in lines[-1]:
        lines.append(away[1].stdout.readline())
    assert any(": relay" in line for line in lines)


def test_another_key_or_none_is_refused(away, run, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "other.json"))
    with pytest.raises(ValueError, match=r"graph\.key cannot be used: No such file"):
        run(ring(away[0]))
    make_key(key_file())
    with pytest.raises(ValueError, match="gives no answer: palpate host must run there, with the"):
        run(ring(away[0]), host_settings=HostSettings(answer_time=0.5))


@pytest.mark.slow
def test_killed_launcher_leaves_no_node_on_other_machines(away):
    with started("run_graph.py", "away", away[0]) as launcher:
        assert launcher.stdout is not None
        assert [launcher.stdout.readline() for _ in range(2)] == ["launching\n", "ready\n"]
        assert len(lent_nodes(away[1].pid)) == 1
        launcher.kill()
    wait_for(lambda: not lent_nodes(away[1].pid))


def test_machine_is_named_by_address_and_port_and_has_free_ones():
    assert read_host("lab2") == ("lab2", 7447)
    assert read_host("192.168.1.5:900") == ("192.168.1.5", 900)
    for text in ("", "tcp://a", "a:b", "a:0", "a:70000", "-a", "a b"):
        with pytest.raises(InputError, match="must look like"):
            read_host(text)
    ports = [int(one.rpartition(":")[2]) for one in free_endpoints("127.0.0.1", "abc").values()]
    assert len(set(ports)) == 3
    with pytest.raises(ValueError, match=r"8\.8\.8\.8 is no address of this machine"):
        free_endpoints("8.8.8.8", ["port"])
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        with pytest.raises(ValueError, match=r"127\.0\.0\.1 has no free port: 1 of"):
            free_endpoints("127.0.0.1", ["port"], [taken.getsockname()[1]], max_tries=1)
