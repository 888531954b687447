"""Trials of damaged inputs by kind and number: each is accepted, refused or a defect.

Inputs are read in a process of their own: if it crashes, hangs or takes too much memory, another
one continues. Times are processor times.
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

# Number of inputs of each kind.
COUNTS: Mapping[str, int] = dict(
    messages=100_000, recordings=2_000, meshes=2_000, scenes=500, solids=2_000
)
QUICK: Mapping[str, int] = dict(messages=2_000, recordings=50, meshes=100, scenes=50, solids=50)
_CONTEXT = multiprocessing.get_context("forkserver")


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialSettings:
    """Limits of the reading of an input, on a machine without other load."""

    max_memory: float = 64.0  # [MB] peak minus the memory before the trials
    max_address_space: int = 512 << 20  # [bytes] added to what is used before the trials
    hang_time: float = 20.0  # [s] without progress, after which a process is killed
    poll_interval: float = 0.5  # [s] between two checks of a process
    max_wait: float = 10.0  # [s] elapsed time; beyond it that counts, not processor time
    n_tries: int = 3  # of an input that takes too long: the processor may be shared
    max_letters: int = 1000  # of the sentence of a refusal
    n_shown: int = 5  # defects of a kind that are printed


LIMITS = TrialSettings()


def fuzz_rows(quick: bool, kinds: Sequence[str] = tuple(COUNTS)) -> Iterator[Row]:
    """Rows for some kinds of input."""
    for name in kinds:
        count = (QUICK if quick else COUNTS)[name]
        yield from tally_rows(name, count, tally(INPUT_KINDS[name], count))


def tally_rows(name: str, count: int, counts: Tally) -> Iterator[Row]:
    """Rows for the results of inputs of a kind."""
    accepted_refused = f"{counts.accepted}, {counts.refused}"
    yield Row(f"{count:,} damaged {name}: accepted, refused", accepted_refused)
    defects = counts.defects
    yield Row(f"damaged {name}: other errors", str(len(defects)), "0", not defects)
    for defect in defects[: LIMITS.n_shown]:
        yield Row(f"  {defect}", "")
    slowest, most = f"{1e3 * counts.slowest:.0f} ms", INPUT_KINDS[name].max_seconds
    yield Row(f"damaged {name}: slowest", slowest, f"<= {most:g} s", counts.slowest <= most)
    yield at_most(f"damaged {name}: memory", counts.memory, LIMITS.max_memory, ".0f", " MB")


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
    """Defects that a process reports, and the fault that ends it early, or None."""
    defects: list[str] = []
    receiver, sender = _CONTEXT.Pipe(duplex=False)
    child = _CONTEXT.Process(target=_work, args=(kind, first, count, shared, sender), daemon=True)
    with without_main_module():
        child.start()
    sender.close()
    try:
        return defects, _listen(receiver, shared, defects)
    finally:
        child.kill()
        child.join()
        receiver.close()


def _work(kind: InputKind, first: int, count: int, shared: Any, sender: Connection) -> None:
    """Make all trials in turn; runs in the process."""
    warnings.simplefilter("error")  # a warning is a defect
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
                sender.send(f"{kind.name} {number}: {reason}")
            if seconds > shared.slowest:
                shared.slowest, shared.slowest_number = seconds, number
            memory = _peak() - base
            if memory > shared.memory:
                shared.memory, shared.memory_number = memory, number
    sender.send("")


def _settle() -> float:
    """Release unused memory, limit the address space, and return the memory in use [MB]."""
    gc.collect()
    with suppress(OSError, AttributeError):  # only the C library of Linux has it
        ctypes.CDLL(None).malloc_trim(0)
    with suppress(OSError):  # reset the peak, where that is possible
        Path("/proc/self/clear_refs").write_text("5")
    with suppress(OSError, ValueError):
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        limit = pages * resource.getpagesize() + LIMITS.max_address_space
        resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))
    return _peak()


def _peak() -> float:
    """Peak memory of this process [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


def _listen(receiver: Connection, shared: Any, defects: list[str]) -> str | None:
    """Collect defects until the process ends; return the fault that ends it early, or None."""
    last, idle = shared.number, 0.0
    while True:
        try:
            if receiver.poll(LIMITS.poll_interval):
                defect: str = receiver.recv()
                if not defect:
                    return None
                defects.append(defect)
                continue
        except EOFError:
            return "the process crashed"
        idle = idle + LIMITS.poll_interval if shared.number == last else 0.0
        last = shared.number
        if idle > LIMITS.hang_time:
            return f"hangs for more than {LIMITS.hang_time:g} s"


@dataclass(slots=True)
class Tally:
    """Results of many inputs."""

    accepted: int = 0
    refused: int = 0
    defects: list[str] = field(default_factory=list)  # With the numbers that repeat them
    slowest: float = 0.0  # [s] of one input
    slowest_number: int = -1
    memory: float = 0.0  # [MB] peak minus the memory before the trials
    memory_number: int = -1  # Number of the input at the peak


class _Shared(Structure):
    """Counts of a process that outlive it."""

    _fields_ = (
        *((name, c_long) for name in ("number", "accepted", "refused")),
        *(("slowest", c_double), ("slowest_number", c_long)),
        *(("memory", c_double), ("memory_number", c_long)),
    )


class TrialOutcome(NamedTuple):
    """Result of one input."""

    verdict: Literal["accepted", "refused", "defect"]
    reason: str  # Sentence of the refusal or the defect
    seconds: float  # Processor time of one reading, in the fastest try


def reproduce(name: str, number: int) -> TrialOutcome:
    """Damage and read a single input, as `try_input`; `name` is one of `INPUT_KINDS`."""
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        INPUT_KINDS[name].prepare(Path(folder))
        return try_input(INPUT_KINDS[name], number, Path(folder))


def try_input(kind: InputKind, number: int, folder: Path) -> TrialOutcome:
    """Damage and read the input with a number as its seed; the folder is prepared."""
    outcome = _once(kind, number, folder)
    for _ in range(LIMITS.n_tries - 1):
        if outcome.seconds <= kind.max_seconds:
            return outcome
        outcome = min(outcome, _once(kind, number, folder), key=lambda trial: trial.seconds)
    if outcome.seconds <= kind.max_seconds:
        return outcome
    return TrialOutcome("defect", f"takes {outcome.seconds:.1f} s", outcome.seconds)


def _once(kind: InputKind, number: int, folder: Path) -> TrialOutcome:
    rng = random.Random(f"{kind.name} {number}")
    cpu_start, start = time.process_time(), time.monotonic()
    verdict: Literal["accepted", "refused", "defect"] = "accepted"
    reason = ""
    try:
        kind.attempt(rng, number, folder)
    except Exception as error:
        fault = _fault(error, kind.refusal)
        verdict = "refused" if fault is None else "defect"
        reason = str(error) if fault is None else f"{fault}: {error!s:.300}"
    return TrialOutcome(verdict, reason, _duration(cpu_start, start) / kind.n_reads)


def _fault(error: Exception, refusal: type[Exception]) -> str | None:
    """Why an error is not a valid refusal; None if it is one."""
    kind, text = type(error), str(error)
    is_own = kind is refusal or kind.__module__.startswith("palpate.")
    if not (is_own and isinstance(error, refusal)):
        return kind.__name__
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, MemoryError):
            return "refused because of a lack of memory"
        cause = cause.__cause__ or cause.__context__
    if not text or "\n" in text or len(text) > LIMITS.max_letters:
        return f"refused without a sentence, in {len(text)} letters"
    return None


def _duration(cpu_start: float, start: float) -> float:
    """Processor time [s]; elapsed time if that exceeds `max_wait`, since waiting takes no CPU."""
    elapsed = time.monotonic() - start
    return elapsed if elapsed > LIMITS.max_wait else time.process_time() - cpu_start


class InputKind(NamedTuple):
    """A kind of input."""

    name: str
    # Fills a folder, and reads the valid inputs, which must be accepted.
    prepare: Callable[[Path], None]
    # Reads the damaged input of a number; raises the error of the reader, or AssertionError if that
    # accepts an invalid input.
    attempt: Callable[[random.Random, int, Path], None]
    refusal: type[Exception]  # Error of a refusal; subclasses of palpate's own are refusals as well
    n_reads: int = 1  # How often an attempt reads its input
    max_seconds: float = 1.0  # Processor time of one reading


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
    hostile = getattr(module, f"hostile_{kind}")()
    index, is_odd = divmod(number, 2)  # every second input is hand-made while there are any
    if not is_odd and index < len(hostile):
        name, data = hostile[index]
    else:
        name, data = getattr(module, f"mutated_{kind}")(rng)
    (folder / name).write_bytes(data)
    getattr(module, f"read_{kind}")(folder / name)


def _files(kind: str, chapter: str, refusal: type[Exception], n_reads: int = 1) -> InputKind:
    """Files; module `chapter` has their ``valid_``, ``hostile_``, ``mutated_`` and ``read_``."""
    names = kind, chapter
    steps = partial(_prepare_files, *names), partial(_attempt_file, *names)
    return InputKind(kind, *steps, refusal, n_reads)


_ROOM = __name__.rpartition(".")[0]
INPUT_KINDS: Mapping[str, InputKind] = {
    "messages": InputKind("messages", _prepare_messages, _attempt_message, ValueError),
    "recordings": _files("recordings", f"{_ROOM}.messages", ValueError),
    # Read as points, as a surface and as a solid, whose outside takes time to find.
    "meshes": _files("meshes", f"{_ROOM}.files", InputError, n_reads=3)._replace(max_seconds=5.0),
    "scenes": _files("scenes", f"{_ROOM}.files", InputError),
    "solids": _files("solids", f"{_ROOM}.files", InputError),
}
