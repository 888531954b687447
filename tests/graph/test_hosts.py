"""Graphs on several machines, here two addresses of one."""

import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
import zmq

from palpate.launch import hosts
from palpate.launch.files.source_map import InputError
from palpate.launch.hosts import PORTS, free_endpoints, key_file, own_address, read_host
from palpate.launch.launcher import launch
from palpate.messages.bus.control import ControlClient
from palpate.messages.bus.sockets import SocketContext, bind, make_key, read_key
from tests.studies.toy_node import ToyParams, toy

pytestmark = [
    pytest.mark.graph,
    pytest.mark.skipif(sys.platform != "linux", reason="has one loopback address"),
]
AWAY = "127.0.0.2"
FRAMES = 300


@pytest.fixture(autouse=True)
def key(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    make_key(key_file())
    return key_file()


def lender(where):
    started = subprocess.Popen(
        [sys.executable, "-m", "palpate", "host", where],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert started.stdout is not None
    assert "runs nodes for whoever has" in started.stdout.readline()
    return started


@pytest.fixture
def away(key):
    """Another machine that lends itself: its address, and its process."""
    [endpoint] = free_endpoints(AWAY, ["port"]).values()
    where = endpoint.removeprefix("tcp://")
    process = lender(where)
    try:
        yield where, process
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=10)


def ring(where):
    return [
        toy("source", ToyParams(burst=FRAMES)),
        replace(toy("relay", ToyParams(relay=True), upstream="source"), host=where),
        toy("counter", ToyParams(expects=FRAMES), upstream="relay"),
    ]


def test_a_graph_on_two_machines_loses_nothing(away, watcher, tmp_path):
    ending = launch(ring(away[0]), ends="counter", watch=["/relay"], watcher=watcher)
    assert (ending.status, ending.reason) == ("finished", f"{FRAMES} received")
    assert [message.touch for _, message in watcher.messages] == list(range(FRAMES))
    assert (ending.gaps, ending.duplicates) == (0, 0)
    away[1].send_signal(signal.SIGINT)
    told, _ = away[1].communicate(timeout=10)
    assert ": relay" in told and "has ended" in told
    assert [path.name for path in tmp_path.iterdir()] == ["config"]


def test_a_node_that_dies_on_the_other_machine_goes_on(away, watcher):
    slow = ring(away[0])
    slow[1] = replace(slow[1], params=ToyParams(relay=True, work=3e-3))
    received = watcher.received

    def kill_at(topic, message):
        received(topic, message)
        if message.touch == FRAMES // 3:
            os.kill(node_of(away[1]), signal.SIGKILL)

    watcher.received = kill_at
    ending = launch(slow, ends="counter", watch=["/relay"], watcher=watcher)
    assert (ending.status, ending.reason) == ("finished", f"{FRAMES} received")
    assert ending.restarts == {"relay": 1}
    assert [message.touch for _, message in watcher.messages] == list(range(FRAMES))


def node_of(process):
    """The one process that the server of another machine has forked."""
    found = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal():
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            found[int(folder.name)] = int(fields[1]), int(fields[2])
    group = [pid for pid, (_, its_group) in found.items() if its_group == process.pid]
    [node] = [pid for pid in group if found[found[pid][0]][0] == process.pid]
    return node


def test_who_has_another_key_is_refused(away, watcher, monkeypatch):
    monkeypatch.setattr("palpate.launch.processes.process_table.HOST_PATIENCE", 1.0)
    key_file().unlink()
    make_key(key_file())
    with pytest.raises(ValueError, match="gives no answer: palpate host must run there, with the"):
        launch(ring(away[0]), ends="counter", watch=[], watcher=watcher)


def test_a_launcher_of_another_version_hurts_nobody_else(away, watcher):
    wires = SocketContext(str(key_file()))
    line = ControlClient(wires.context, f"tcp://{away[0]}", name="other")
    line.send("hello", names=["a"], modules=["m"], more=1)
    line.send("spawn", node="a", wiring=b"", place=b"")
    ending = launch(ring(away[0]), ends="counter", watch=[], watcher=watcher)
    assert ending.status == "finished"
    line.close()
    wires.close()


def test_without_a_key_nothing_is_started(away, watcher):
    key_file().unlink()
    with pytest.raises(ValueError, match=r"graph\.key cannot be used: No such file"):
        launch(ring(away[0]), ends="counter", watch=[], watcher=watcher)


def test_who_connects_without_a_key_receives_nothing(key):
    wires = SocketContext(str(key))
    publisher, open_ear = wires.context.socket(zmq.XPUB), zmq.Context.instance().socket(zmq.SUB)
    [endpoint] = free_endpoints("127.0.0.1", ["port"]).values()
    bind(publisher, endpoint)
    locked = wires.context.socket(zmq.SUB)
    for ear in (open_ear, locked):
        ear.subscribe(b"")
        ear.connect(endpoint)
    assert publisher.poll(5000)
    publisher.recv()
    publisher.send(b"secret")
    assert locked.poll(5000)
    assert not open_ear.poll(200)
    for one in (publisher, locked, open_ear):
        one.close(0)
    wires.close()


def test_nobody_listens_at_an_address_without_a_key():
    wires = SocketContext()
    socket = wires.context.socket(zmq.XPUB)
    with pytest.raises(ValueError, match="cannot be used without a key"):
        bind(socket, "tcp://127.0.0.1:7999")
    socket.close(0)
    wires.close()


@pytest.mark.slow
def test_a_launcher_that_is_gone_leaves_no_node_on_other_machines(away, tmp_path):
    command = [sys.executable, "-m", "tests.graph.toys.run_away", away[0]]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as launcher:
        assert launcher.stdout is not None
        assert launcher.stdout.readline() == b"ready\n"
        node = node_of(away[1])
        launcher.kill()
    deadline = time.monotonic() + 10.0
    while Path(f"/proc/{node}").exists():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_a_key_is_made_once_and_for_nobody_else(key):
    assert key.stat().st_mode & 0o777 == 0o600
    with pytest.raises(FileExistsError, match="exists already; it is not overwritten"):
        make_key(key)
    key.chmod(0o644)
    with pytest.raises(ValueError, match=f"can be read by others; run chmod 600 {key}"):
        read_key(key)


SHORT = 'curve\n    public-key = "short"\n    secret-key = "short"\n'


@pytest.mark.parametrize("text", ["curve\n", "", "\0", 'public-key = "short"\n', SHORT])
def test_what_is_no_key_is_refused(text, key):
    key.write_text(text)
    with pytest.raises(ValueError, match="cannot be used"):
        read_key(key)


def test_a_machine_is_named_by_address_and_port():
    assert read_host("lab2") == ("lab2", 7447)
    assert read_host("192.168.1.5:900") == ("192.168.1.5", 900)
    assert own_address(AWAY).startswith("127.")


@pytest.mark.parametrize("text", ["", "tcp://a", "a:b", "a:0", "a:70000", "-a", "a b"])
def test_what_is_no_machine_is_refused(text):
    with pytest.raises(InputError, match="must look like"):
        read_host(text)


def test_ports_of_this_machine_are_free_and_those_of_another_cannot_be_had_here():
    ports = [int(one.rpartition(":")[2]) for one in free_endpoints("127.0.0.1", "abc").values()]
    assert len(set(ports)) == 3 and all(port in PORTS for port in ports)
    with socket.socket() as taken, pytest.MonkeyPatch.context() as patch:
        taken.bind(("127.0.0.1", 0))
        patch.setattr(hosts, "PORTS", [taken.getsockname()[1]])
        patch.setattr(hosts, "TRIED_PORTS", 1)
        with pytest.raises(ValueError, match=r"127\.0\.0\.1 has no free port: 1 of"):
            free_endpoints("127.0.0.1", ["port"])
    with pytest.raises(ValueError, match=r"8\.8\.8\.8 is no address of this machine"):
        free_endpoints("8.8.8.8", ["port"])
