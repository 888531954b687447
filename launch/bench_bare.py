"""Hops of a frame over bare sockets: what there is to be compared with."""

from __future__ import annotations

import multiprocessing
import time
from typing import Any

import zmq

from palpate.launch.bench_toy import frame, settle
from palpate.launch.processes.server import no_script
from palpate.messages.bus.wires import Wires, bind
from palpate.messages.codec import encode
from palpate.messages.header import Header, pack_frame

_DEADLINE_MS = 20_000


def bare_hop(there: str, back: str, laps: int, *, core: int = -1, key: str = "") -> float:
    """Time of one hop of a frame of 16 by 16 taxels between two processes, us.

    Parameters
    ----------
    there, back : str
        Endpoints of the two.
    laps : int
        How often it goes there and back.
    core : int
        Processor core on which both run; -1 leaves them free.
    key : str
        File of the key with which the sockets are locked; empty for open ones.
    """
    spawn = multiprocessing.get_context("forkserver")
    mine, yours = spawn.Pipe()
    echo = spawn.Process(target=_echo, args=(there, back, laps, core, key), daemon=True)
    ping = spawn.Process(target=_ping, args=(there, back, laps, core, key, yours), daemon=True)
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


def _echo(there: str, back: str, laps: int, core: int, key: str) -> None:
    wires = Wires(key)
    out, into = _pair(wires, back, there, key)
    settle(core)
    for _ in range(laps):
        out.send(into.recv())
    into.close(0)
    out.close(1000)  # the last answer is still to leave
    wires.close()


def _ping(there: str, back: str, laps: int, core: int, key: str, result: Any) -> None:
    wires = Wires(key)
    out, into = _pair(wires, there, back, key)
    settle(core)
    data = pack_frame("/touch/raw", Header(1, 0, 0, 0, 0.0, 0), encode(frame(0)))
    began = time.perf_counter()
    for _ in range(laps):
        out.send(data)
        into.recv()
    result.send(time.perf_counter() - began)
