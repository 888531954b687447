"""Damaged inputs by kind and number, read in a process that is watched: accepted, refused, defect.

A process may crash, hang or take memory, and the others go on; seconds are those of the
processor.
"""

from __future__ import annotations

import ctypes
import gc
import multiprocessing
import random
import resource
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from ctypes import Structure, c_double, c_long
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from multiprocessing.connection import Connection
from multiprocessing.sharedctypes import RawValue
from pathlib import Path
from typing import Any, Literal, NamedTuple

from palpate.bench.table import Row, at_most
from palpate.launch.files.source_map import InputError
from palpate.launch.processes.fork_server import without_main_module

# Inputs of each kind.
COUNTS: Mapping[str, int] = dict(
    messages=100_000, recordings=2_000, meshes=2_000, scenes=500, solids=2_000
)
QUICK: Mapping[str, int] = dict(messages=2_000, recordings=50, meshes=100, scenes=50, solids=50)
MOST_MEMORY = 64.0  # Beyond what a process has before the trials, MB
SHOWN = 5  # Most defects of a kind that are told, each with the number by which it can be repeated
HANG_SECONDS = 20.0  # A process that has not gone on for so long is killed, s
# Address space that a process may take beyond what it has before the trials, bytes.
MOST_ADDRESS_SPACE = 512 << 20
_POLL = 0.5
_SPACE = resource.RLIMIT_AS
_CONTEXT = multiprocessing.get_context("forkserver")
# Longest processor time for one reading of an input on a machine that does nothing else, s; of a
# mesh whose outside has to be found.
MOST_CPU_SECONDS, MOST_MESH_SECONDS = 1.0, 5.0
# Longest time by the clock, s: whoever waits for something uses no processor.
MOST_WAIT_SECONDS = 10.0
TRIES = 3  # Of an input that takes longer: the processor may have been shared
MOST_LETTERS = 1000  # Of the sentence by which an input is refused


def fuzz_rows(quick: bool, kinds: Sequence[str] = tuple(COUNTS)) -> Iterator[Row]:
    """Rows for some kinds of input."""
    for name in kinds:
        count = (QUICK if quick else COUNTS)[name]
        yield from tally_rows(name, count, tally(INPUT_KINDS[name], count))


def tally_rows(name: str, count: int, found: Tally) -> Iterator[Row]:
    """Rows for what came of so many inputs of a kind."""
    yield Row(f"{count:,} damaged {name}: accepted, refused", f"{found.accepted}, {found.refused}")
    defects = found.defects
    yield Row(f"damaged {name}: other errors", str(len(defects)), "0", not defects)
    for defect in defects[:SHOWN]:
        yield Row(f"  {defect}", "")
    slowest = f"{1e3 * found.slowest:.0f} ms"
    most = INPUT_KINDS[name].most_seconds
    yield Row(f"damaged {name}: slowest", slowest, f"<= {most:g} s", found.slowest <= most)
    yield at_most(f"damaged {name}: memory", found.memory, MOST_MEMORY, ".0f", " MB")


def tally(kind: InputKind, count: int) -> Tally:
    """Try inputs 0 to `count` of a kind."""
    whole, first = Tally(), 0
    while first < count:
        shared: Any = RawValue(_Shared)
        shared.number = first - 1
        defects, fault = _run(kind, first, count, shared)
        whole.defects += defects
        whole.accepted += shared.accepted
        whole.refused += shared.refused
        for most in ("slowest", "memory"):
            if getattr(shared, most) > getattr(whole, most):
                setattr(whole, most, getattr(shared, most))
                setattr(whole, f"{most}_number", getattr(shared, f"{most}_number"))
        if fault is None:
            return whole
        whole.defects.append(f"{kind.name} {max(shared.number, first)}: {fault}")
        first = max(shared.number, first) + 1
    return whole


def _run(kind: InputKind, first: int, count: int, shared: Any) -> tuple[list[str], str | None]:
    """Defects that a process told, and what ended it before it was done."""
    defects: list[str] = []
    mine, yours = _CONTEXT.Pipe(duplex=False)
    child = _CONTEXT.Process(target=_work, args=(kind, first, count, shared, yours), daemon=True)
    with without_main_module():
        child.start()
    yours.close()
    try:
        return defects, _listen(mine, shared, defects)
    finally:
        child.kill()
        child.join()
        mine.close()


def _work(kind: InputKind, first: int, count: int, shared: Any, yours: Connection) -> None:
    """In the process: all trials, one after the other."""
    warnings.simplefilter("error")  # a warning is no sentence for a user
    with tempfile.TemporaryDirectory(prefix="palpate-") as name:
        folder = Path(name)
        kind.prepare(folder)
        base = _settle()
        for number in range(first, count):
            shared.number = number
            verdict, reason, seconds = try_input(kind, number, folder)
            shared.accepted += verdict == "accepted"
            shared.refused += verdict == "refused"
            if verdict == "defect":
                yours.send(f"{kind.name} {number}: {reason}")
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
        pages, (_, hard) = (
            Path("/proc/self/statm").read_text().split()[0],
            resource.getrlimit(_SPACE),
        )
        limit = int(pages) * resource.getpagesize() + MOST_ADDRESS_SPACE
        resource.setrlimit(_SPACE, (limit, hard))
    return _peak()


def _peak() -> float:
    """The most memory that this process has held, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


def _listen(mine: Connection, shared: Any, defects: list[str]) -> str | None:
    last, still = shared.number, 0.0
    while True:
        try:
            if mine.poll(_POLL):
                defect: str = mine.recv()
                if not defect:
                    return None
                defects.append(defect)
                continue
        except EOFError:
            return "the process crashed"
        still = still + _POLL if shared.number == last else 0.0
        last = shared.number
        if still > HANG_SECONDS:
            return f"hangs for more than {HANG_SECONDS:g} s"


@dataclass(slots=True)
class Tally:
    """What came of many inputs."""

    accepted: int = 0
    refused: int = 0
    # Each with the number by which it can be repeated.
    defects: list[str] = field(default_factory=list)
    slowest: float = 0.0  # Of one input, s
    slowest_number: int = -1
    memory: float = 0.0  # The most that a process took beyond what it had before the trials, MB
    memory_number: int = -1  # The input at which that was so


class _Shared(Structure):
    """What a process leaves even if it is killed."""

    _fields_ = (
        *((name, c_long) for name in ("number", "accepted", "refused")),
        *(("slowest", c_double), ("slowest_number", c_long)),
        *(("memory", c_double), ("memory_number", c_long)),
    )


class TrialOutcome(NamedTuple):
    """What came of one input."""

    verdict: Literal["accepted", "refused", "defect"]
    reason: str  # The sentence of a refusal, or what the defect is
    seconds: float  # Processor time of one reading, in the fastest try


def reproduce(name: str, number: int) -> TrialOutcome:
    """Damage and read one input by itself, as `try_input` does; `name` is one of `INPUT_KINDS`."""
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        INPUT_KINDS[name].prepare(Path(folder))
        return try_input(INPUT_KINDS[name], number, Path(folder))


def try_input(kind: InputKind, number: int, folder: Path) -> TrialOutcome:
    """Damage and read the input of a number, its seed; the folder is prepared."""
    outcome = _once(kind, number, folder)
    for _ in range(TRIES - 1):
        if outcome.seconds <= kind.most_seconds:
            return outcome
        outcome = min(outcome, _once(kind, number, folder), key=lambda one: one.seconds)
    if outcome.seconds <= kind.most_seconds:
        return outcome
    return TrialOutcome("defect", f"takes {outcome.seconds:.1f} s", outcome.seconds)


def _once(kind: InputKind, number: int, folder: Path) -> TrialOutcome:
    rng = random.Random(f"{kind.name} {number}")
    began, then = time.process_time(), time.monotonic()
    verdict: Literal["accepted", "refused", "defect"] = "accepted"
    reason = ""
    try:
        kind.attempt(rng, number, folder)
    except Exception as error:
        fault = _fault(error, kind.refusal)
        verdict = "refused" if fault is None else "defect"
        reason = str(error) if fault is None else f"{fault}: {error!s:.300}"
    return TrialOutcome(verdict, reason, _took(began, then) / kind.reads)


def _fault(error: Exception, refusal: type[Exception]) -> str | None:
    """What is wrong with an error as a refusal; None if it is one."""
    kind, text = type(error), str(error)
    own = kind is refusal or kind.__module__.startswith("palpate.")
    if not (own and isinstance(error, refusal)):
        return kind.__name__
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, MemoryError):
            return "refused for want of memory"
        cause = cause.__cause__ or cause.__context__
    if not text or "\n" in text or len(text) > MOST_LETTERS:
        return f"refused in no sentence, but {len(text)} letters"
    return None


def _took(began: float, then: float) -> float:
    """Processor time, or that of the clock if something was waited for."""
    waited = time.monotonic() - then
    return waited if waited > MOST_WAIT_SECONDS else time.process_time() - began


class InputKind(NamedTuple):
    """One kind of input."""

    name: str
    # Make what is needed, in a folder, and read what is sound, which must be accepted.
    prepare: Callable[[Path], None]
    # Read the damaged input of a number; raises what the reader does, or AssertionError if it
    # accepts what is not valid.
    attempt: Callable[[random.Random, int, Path], None]
    # The error by which an input may be refused, or a child of it that is palpate's own.
    refusal: type[Exception]
    reads: int = 1  # How often an attempt reads its input
    most_seconds: float = MOST_CPU_SECONDS  # Processor time of one reading


def _prepare_messages(_: Path) -> None:
    messages = import_module(f"{_ROOM}.messages")
    for packet in messages.valid_packets():
        messages.read_packet(packet)


def _attempt_message(rng: random.Random, _: int, __: Path) -> None:
    messages = import_module(f"{_ROOM}.messages")
    messages.read_packet(messages.mutated_packet(rng))


def _prepare_files(kind: str, chapter: str, folder: Path) -> None:
    module = import_module(chapter)
    getattr(module, f"hostile_{kind}")()
    if kind == "scenes":
        module.fill_folder(folder)
    for name, data in getattr(module, f"valid_{kind}")():
        (folder / name).write_bytes(data)
        getattr(module, f"read_{kind}")(folder / name)


def _attempt_file(kind: str, chapter: str, rng: random.Random, number: int, folder: Path) -> None:
    module = import_module(chapter)
    bombs = getattr(module, f"hostile_{kind}")()
    turn, odd = divmod(number, 2)  # every second input is a bomb while there are any
    if not odd and turn < len(bombs):
        name, data = bombs[turn]
    else:
        name, data = getattr(module, f"mutated_{kind}")(rng)
    (folder / name).write_bytes(data)
    getattr(module, f"read_{kind}")(folder / name)


def _files(kind: str, chapter: str, refusal: type[Exception], reads: int = 1) -> InputKind:
    """Files: `chapter` has their ``valid_``, ``hostile_``, ``mutated_`` and ``read_``."""
    names = kind, chapter
    steps = partial(_prepare_files, *names), partial(_attempt_file, *names)
    return InputKind(kind, *steps, refusal, reads)


_ROOM = __name__.rpartition(".")[0]
# By name.
INPUT_KINDS: Mapping[str, InputKind] = {
    "messages": InputKind("messages", _prepare_messages, _attempt_message, ValueError),
    "recordings": _files("recordings", f"{_ROOM}.messages", ValueError),
    # As points, as a surface and as a solid.
    "meshes": _files("meshes", f"{_ROOM}.files", InputError, reads=3)._replace(
        most_seconds=MOST_MESH_SECONDS
    ),
    "scenes": _files("scenes", f"{_ROOM}.files", InputError),
    "solids": _files("solids", f"{_ROOM}.files", InputError),
}
