"""What the lock between machines costs: bare hops over tcp, with and without CURVE."""

from __future__ import annotations

import multiprocessing
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import zmq

from palpate.launch.bench_row import Row
from palpate.launch.bench_toy import frame
from palpate.launch.hosts.addresses import free_endpoints
from palpate.launch.processes.server import no_script
from palpate.messages.bus.curve import make_key
from palpate.messages.bus.wires import Wires, bind
from palpate.messages.codec import encode
from palpate.messages.header import Header, pack_frame

LIMIT = 1.3
_DEADLINE_MS = 20_000


def curve_rows(laps: int = 2000, turns: int = 5) -> Iterator[Row]:
    """Rows of the table; the two are measured in turn, so that both meet the same load."""
    plain, locked = [], []
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        key = Path(folder) / "graph.key"
        make_key(key)
        for _ in range(turns):
            plain.append(_hop(laps, ""))
            locked.append(_hop(laps, str(key)))
    ratio = min(locked) / min(plain)
    yield Row("one hop over tcp, bare sockets", f"{min(plain):.1f} us", "", True)
    yield Row("the same, locked", f"{min(locked):.1f} us", "", True)
    yield Row("locked over plain", f"{ratio:.2f}", f"<= {LIMIT:g}", ratio <= LIMIT)


def _hop(laps: int, key: str) -> float:
    """Time of one hop of a frame of 16 by 16 taxels, us."""
    spawn = multiprocessing.get_context("forkserver")
    endpoints = free_endpoints("127.0.0.1", ("there", "back"))
    mine, yours = spawn.Pipe()
    there, back = endpoints["there"], endpoints["back"]
    echo = spawn.Process(target=_echo, args=(there, back, laps, key), daemon=True)
    ping = spawn.Process(target=_ping, args=(there, back, laps, key, yours), daemon=True)
    try:
        with no_script():
            echo.start()
            ping.start()
        if not mine.poll(_DEADLINE_MS / 1000):
            raise RuntimeError("the bare sockets did not answer")
        seconds: float = mine.recv()
    finally:
        for process in (echo, ping):
            if process.pid is not None:
                process.kill()
                process.join()
        mine.close()
        yours.close()
    return seconds / (2 * laps) * 1e6


def _pair(wires: Wires, endpoint: str, other: str, key: str) -> tuple[Any, Any]:
    out, into = wires.context.socket(zmq.XPUB), wires.context.socket(zmq.SUB)
    if key:
        bind(out, endpoint)
    else:
        out.bind(endpoint)
    into.subscribe(b"")
    into.connect(other)
    out.recv()  # The other's subscription: from here on nothing is lost.
    return out, into


def _echo(there: str, back: str, laps: int, key: str) -> None:
    wires = Wires(key)
    out, into = _pair(wires, back, there, key)
    for _ in range(laps):
        out.send(into.recv())
    into.close(0)
    out.close(1000)  # the last answer is still to leave
    wires.close()


def _ping(there: str, back: str, laps: int, key: str, result: Any) -> None:
    wires = Wires(key)
    out, into = _pair(wires, there, back, key)
    data = pack_frame("/touch/raw", Header(1, 0, 0, 0, 0.0, 0), encode(frame(0)))
    began = time.perf_counter()
    for _ in range(laps):
        out.send(data)
        into.recv()
    result.send(time.perf_counter() - began)
