"""Whether machine, installation and running graphs are well, and what to do if not."""

from __future__ import annotations

import os
import platform
import re
import resource
import shutil
import sys
from collections.abc import Iterator, Mapping
from functools import partial
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal, NamedTuple

import zmq

from palpate import __version__
from palpate.launch.printing import titled
from palpate.launch.processes.node_status import DEFAULT_SUPERVISION
from palpate.launch.processes.registry import (
    GRAPH_VARIABLE,
    LONGEST_SOCKET,
    RunCard,
    find_run,
    runtime_folder,
    stale_folders,
)
from palpate.launch.run_directory import VERSIONED_PACKAGES
from palpate.preloading import THREAD_VARIABLES
from palpate.tools.introspection.requests import StatusSample, request, sample_status
from palpate.tools.introspection.topics import is_running

LOW_SPACE, MIN_SPACE = 1 << 30, 1 << 24  # Free bytes of a disk: doubtful for long recordings, any
MIN_OPEN_FILES = 256  # Open files that a process needs, at the least
# Variables of the environment by which palpate is affected.
ENVIRONMENT_VARIABLES = ("XDG_RUNTIME_DIR", "TMPDIR", GRAPH_VARIABLE, *THREAD_VARIABLES)


class Finding(NamedTuple):
    """One thing that was looked at."""

    level: Literal["ok", "WARN", "FAIL"]  # ``WARN``: it works, but worse. ``FAIL``: it does not
    text: str  # What was found, and what to do about it, in one sentence

    def __str__(self) -> str:
        return "\n".join(titled(self.level, self.text, width=5))


fine, doubtful, failing = (partial(Finding, level) for level in ("ok", "WARN", "FAIL"))


def machine_findings() -> Iterator[Finding]:
    """What there is to say of machine and installation."""
    yield fine(
        f"palpate {__version__}, Python {platform.python_version()}, "
        f"{platform.system()} {platform.machine()}"
    )
    yield packages_finding()
    yield from zmq_findings()
    yield compiled_finding("lz4", "lz4.frame", "recordings cannot be compressed")
    yield compiled_finding("embreex", "embreex", "casts at meshes are slow")
    yield space_finding(Path())
    yield space_finding(runtime_folder())
    yield socket_finding(runtime_folder())
    yield from process_findings(Path("/proc"), stale_folders())


def packages_finding() -> Finding:
    """Whether all is there that results and recordings depend on."""
    found = {name: _version(name) for name in VERSIONED_PACKAGES}
    missing = [name for name, number in found.items() if number is None]
    if missing:
        return failing(f"packages are missing: {', '.join(missing)}; install palpate once more")
    return fine(f"packages: {', '.join(f'{name} {number}' for name, number in found.items())}")


def zmq_findings() -> Iterator[Finding]:
    """Whether ZeroMQ has what the bus uses."""
    found = f"ZeroMQ {zmq.zmq_version()}"
    if zmq.zmq_version_info() < (4, 3):
        yield failing(f"{found} is too old, the bus needs 4.3; install a newer pyzmq")
    elif not zmq.has("ipc"):
        yield failing(f"{found} has no Unix sockets, which the bus needs; install another pyzmq")
    elif not zmq.has("curve"):
        yield doubtful(f"{found} cannot encrypt (no CURVE); do not let it leave this machine")
    else:
        yield fine(f"{found} with Unix sockets and CURVE")


def compiled_finding(package: str, module: str, without: str) -> Finding:
    """Whether the compiled part of a package is there."""
    try:
        there = find_spec(module) is not None
    except ModuleNotFoundError:
        there = False
    if there:
        return fine(f"{package} is there, compiled")
    return doubtful(f"{package} is not there as compiled code, so {without}; install {package}")


def space_finding(folder: Path) -> Finding:
    """Whether a folder can be written, and has room."""
    place = folder.resolve()
    if not os.access(place, os.W_OK | os.X_OK):
        return failing(f"{place} cannot be written; choose another folder")
    free = shutil.disk_usage(place).free
    found = f"{free / 1e9:.1f} GB free in {place}"
    if free < MIN_SPACE:
        return failing(f"{found}: make room")
    return doubtful(f"{found}: a long recording may not fit") if free < LOW_SPACE else fine(found)


def socket_finding(folder: Path) -> Finding:
    """Whether the paths of sockets will be short enough."""
    length, most = len(os.fsencode(folder / LONGEST_SOCKET)), zmq.IPC_PATH_MAX_LEN
    if length > most:
        return failing(
            f"sockets in {folder} would have paths of {length} bytes, at most {most} will do; "
            "set XDG_RUNTIME_DIR or TMPDIR to a folder with a shorter path"
        )
    return fine(f"paths of sockets have {length} of at most {most} bytes, in {folder}")


def process_findings(proc: Path, stale: list[Path]) -> Iterator[Finding]:
    """Cores for nodes, their threads and files, what `proc` says of them, what killed ones left."""
    affinity = getattr(os, "sched_getaffinity", None)
    cores = len(affinity(0)) if affinity is not None else os.cpu_count() or 1
    found = f"{cores} processor cores, load {os.getloadavg()[0]:.1f}"
    slow = f"{found}: nodes take turns; --composed is faster here"
    yield doubtful(slow) if cores < 2 else fine(found)
    told = ", ".join(f"{one} {os.environ.get(one, 'is not set')}" for one in THREAD_VARIABLES)
    yield fine(f"linear algebra of nodes runs on one thread; elsewhere {told}")
    most, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    found = f"at most {most} open files a process"
    few = f"{found}, a large graph needs {MIN_OPEN_FILES}; raise it with ulimit -n"
    yield doubtful(few) if 0 <= most < MIN_OPEN_FILES else fine(found)
    if (proc / "self" / "stat").exists():
        yield fine(f"{proc} says what processes do")
    else:
        yield doubtful(f"there is no {proc}: a busy node cannot be told from one that hangs")
    names = ", ".join(path.name for path in stale)
    left = f"killed launchers have left {names}; the next run takes them away"
    yield doubtful(left) if stale else fine("nothing is left of killed launchers")


def graphs_findings(cards: list[RunCard]) -> Iterator[Finding]:
    """What there is to say of each running graph."""
    if not cards:
        yield fine("no graph of yours is running")
    elif len(cards) > 1 or os.environ.get(GRAPH_VARIABLE):
        yield choice_finding()
    for card in cards:
        try:
            answer = request(card, "status")
            beats = sample_status(card, [n for n, one in answer["nodes"].items() if one["pid"]])
        except ValueError as error:
            if is_running(card):
                yield failing(f"{error}; if it stays so, kill {card.pid}")
            continue
        yield from graph_findings(card, answer, beats)


def choice_finding() -> Finding:
    """Which graph the verbs mean here."""
    try:
        return fine(f"here the verbs mean the graph {find_run(None).title}")
    except ValueError as error:
        return doubtful(str(error))


def graph_findings(
    card: RunCard, answer: Mapping[str, Any], beats: Mapping[str, StatusSample]
) -> Iterator[Finding]:
    """What there is to say of one graph."""
    nodes, title = answer["nodes"], f"{card.run[:6]} ({card.name})"
    faults = list(_faults(title, nodes, beats))
    if faults:
        yield from faults
        return
    handled = sum(one.status.messages for one in beats.values())
    yield fine(
        f"{title} runs for {answer['for_s']:.0f} s: {len(nodes)} nodes, "
        f"{handled} messages handled, none missing"
    )


def _faults(
    title: str, nodes: Mapping[str, Mapping[str, Any]], beats: Mapping[str, StatusSample]
) -> Iterator[Finding]:
    for name, about in nodes.items():
        who = f"{title}: {name}"
        if not about["pid"]:
            yield doubtful(f"{who} does not run; if it should, see log.jsonl for why it ended")
            continue
        if about["restarts"]:
            yield doubtful(f"{who} was started again {about['restarts']} times; see log.jsonl")
        if about["silent_s"] > DEFAULT_SUPERVISION.silence_limit:
            silent = f"{about['silent_s']:.0f} s"
            yield doubtful(f"{who} has been silent for {silent}: it works, or hangs")
        if name in beats and beats[name].status.gaps:
            yield failing(f"{who} misses {beats[name].status.gaps} messages: start the run anew")


def report_lines(cards: list[RunCard]) -> Iterator[str]:
    """Lines for whoever helps: system, packages, environment, running graphs."""
    yield f"system    {platform.platform()}"
    yield f"python    {sys.executable}, {platform.python_version()}"
    for line in requires("palpate") or () if _version("palpate") else ():
        match = re.match(r"[A-Za-z0-9._-]+", line)
        if match and "extra ==" not in line:
            yield f"package   {match[0]} {_version(match[0]) or 'is not installed'}"
    for name in ENVIRONMENT_VARIABLES:
        yield f"variable  {name}={os.environ.get(name, '')}"
    for card in cards:
        yield (
            f"graph     {card.run} ({card.name}), launcher {card.pid}, since {card.began}, "
            f"in {card.folder or 'no run directory'}: {', '.join(one.name for one in card.nodes)}"
        )


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
