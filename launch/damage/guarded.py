"""Many trials in a process that is watched: it may crash, hang or take memory, and others go on."""

from __future__ import annotations

import ctypes
import gc
import multiprocessing
import resource
import tempfile
import warnings
from contextlib import suppress
from ctypes import Structure, c_double, c_long
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.sharedctypes import RawValue
from pathlib import Path
from typing import Any

from palpate.launch.damage.kinds import Kind
from palpate.launch.damage.trial import repeat
from palpate.launch.processes.server import no_script

HANGS = 20.0
"""A process that has not gone on for so long is killed, s."""
ROOM = 512 << 20
"""Address space that a process may take beyond what it has before the trials, bytes."""
_POLL = 0.5
_CONTEXT = multiprocessing.get_context("forkserver")


@dataclass(slots=True)
class Tally:
    """What came of many inputs."""

    accepted: int = 0
    refused: int = 0
    defects: list[str] = field(default_factory=list)
    """Each with the number by which it can be repeated."""
    slowest: float = 0.0
    """Of one input, s."""
    slowest_number: int = -1
    memory: float = 0.0
    """The most that a process took beyond what it had before the trials, MB."""
    memory_number: int = -1
    """The input at which that was so."""


class _Shared(Structure):
    """What a process leaves even if it is killed."""

    _fields_ = (
        ("number", c_long),
        ("accepted", c_long),
        ("refused", c_long),
        ("slowest", c_double),
        ("slowest_number", c_long),
        ("memory", c_double),
        ("memory_number", c_long),
    )


def tally(kind: Kind, count: int) -> Tally:
    """Try inputs 0 to `count` of a kind.

    Parameters
    ----------
    kind : Kind
        What is read.
    count : int
        How many.
    """
    whole, first = Tally(), 0
    while first < count:
        shared: Any = RawValue(_Shared)
        shared.number = first - 1
        defects, fault = _run(kind, first, count, shared)
        whole.defects += defects
        _add(whole, shared)
        if fault is None:
            return whole
        whole.defects.append(f"{kind.name} {max(shared.number, first)}: {fault}")
        first = max(shared.number, first) + 1
    return whole


def _run(kind: Kind, first: int, count: int, shared: Any) -> tuple[list[str], str | None]:
    """Defects that a process told, and what ended it before it was done."""
    defects: list[str] = []
    mine, yours = _CONTEXT.Pipe(duplex=False)
    child = _CONTEXT.Process(target=_work, args=(kind, first, count, shared, yours), daemon=True)
    with no_script():
        child.start()
    yours.close()
    try:
        return defects, _listen(mine, shared, defects)
    finally:
        child.kill()
        child.join()
        mine.close()


def _listen(mine: Connection, shared: Any, defects: list[str]) -> str | None:
    last, still = shared.number, 0.0
    while True:
        try:
            if mine.poll(_POLL):
                said: str = mine.recv()
                if not said:
                    return None
                defects.append(said)
                continue
        except EOFError:
            return "the process crashed"
        still = still + _POLL if shared.number == last else 0.0
        last = shared.number
        if still > HANGS:
            return f"hangs for more than {HANGS:g} s"


def _add(whole: Tally, shared: Any) -> None:
    whole.accepted += shared.accepted
    whole.refused += shared.refused
    if shared.slowest > whole.slowest:
        whole.slowest, whole.slowest_number = shared.slowest, shared.slowest_number
    if shared.memory > whole.memory:
        whole.memory, whole.memory_number = shared.memory, shared.memory_number


def _work(kind: Kind, first: int, count: int, shared: Any, yours: Connection) -> None:
    """In the process: all trials, one after the other."""
    warnings.simplefilter("error")  # a warning is no sentence for a user
    with tempfile.TemporaryDirectory(prefix="palpate-") as name:
        folder = Path(name)
        kind.prepare(folder)
        base = _settle()
        for number in range(first, count):
            shared.number = number
            verdict, said, seconds = repeat(kind, number, folder)
            shared.accepted += verdict == "accepted"
            shared.refused += verdict == "refused"
            if verdict == "defect":
                yours.send(f"{kind.name} {number}: {said}")
            if seconds > shared.slowest:
                shared.slowest, shared.slowest_number = seconds, number
            memory = _peak() - base
            if memory > shared.memory:
                shared.memory, shared.memory_number = memory, number
    yours.send("")


def _settle() -> float:
    """Give back what is not needed, limit what may be taken, and say what is held, MB."""
    gc.collect()
    with suppress(OSError, AttributeError):  # only the C library of Linux has it
        ctypes.CDLL(None).malloc_trim(0)
    with suppress(OSError):  # begin the count of the peak anew, where that can be done
        Path("/proc/self/clear_refs").write_text("5")
    with suppress(OSError, ValueError):
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        limit = pages * resource.getpagesize() + ROOM
        resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))
    return _peak()


def _peak() -> float:
    """The most memory that this process has held, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6
