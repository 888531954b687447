"""Checks of machine, installation and running graphs, with advice."""

from __future__ import annotations

import os
import platform
import re
import resource
import shutil
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
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

# Variables of the environment that affect palpate.
ENVIRONMENT_VARIABLES = ("XDG_RUNTIME_DIR", "TMPDIR", GRAPH_VARIABLE, *THREAD_VARIABLES)


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineNeeds:
    """What palpate needs of a machine."""

    min_disk: int = 1 << 24  # [bytes] free, for any run
    ample_disk: int = 1 << 30  # [bytes] free, for long recordings
    min_open_files: int = 256  # of a process


NEEDS = MachineNeeds()


class Finding(NamedTuple):
    """Result of one check."""

    level: Literal["ok", "WARN", "FAIL"]  # ``WARN``: it works, but worse; ``FAIL``: it does not
    text: str  # the result and advice, in one sentence

    def __str__(self) -> str:
        return "\n".join(titled(self.level, self.text, width=5))


fine, doubtful, failing = (partial(Finding, level) for level in ("ok", "WARN", "FAIL"))


def machine_findings(needs: MachineNeeds = NEEDS) -> Iterator[Finding]:
    """Findings about machine and installation."""
    yield fine(
        f"palpate {__version__}, Python {platform.python_version()}, "
        f"{platform.system()} {platform.machine()}"
    )
    yield packages_finding()
    yield from zmq_findings()
    yield compiled_finding("lz4", "lz4.frame", "recordings cannot be compressed")
    yield compiled_finding("embreex", "embreex", "casts at meshes are slow")
    yield space_finding(Path(), needs)
    yield space_finding(runtime_folder(), needs)
    yield socket_finding(runtime_folder())
    yield from process_findings(Path("/proc"), stale_folders(), needs)


def packages_finding() -> Finding:
    """Whether the packages are installed that results and recordings depend on."""
    versions = {name: _version(name) for name in VERSIONED_PACKAGES}
    missing = [name for name, number in versions.items() if number is None]
    if missing:
        return failing(f"packages are missing: {', '.join(missing)}; install palpate again")
    return fine(f"packages: {', '.join(f'{name} {number}' for name, number in versions.items())}")


def zmq_findings() -> Iterator[Finding]:
    """Whether ZeroMQ has the features that the bus needs."""
    name = f"ZeroMQ {zmq.zmq_version()}"
    if zmq.zmq_version_info() < (4, 3):
        yield failing(f"{name} is too old, the bus needs 4.3; install a newer pyzmq")
    elif not zmq.has("ipc"):
        yield failing(f"{name} has no Unix sockets, which the bus needs; install another pyzmq")
    elif not zmq.has("curve"):
        yield doubtful(f"{name} cannot encrypt (no CURVE); do not let it leave this machine")
    else:
        yield fine(f"{name} with Unix sockets and CURVE")


def compiled_finding(package: str, module: str, without: str) -> Finding:
    """Whether the compiled part of a package is installed."""
    try:
        is_installed = find_spec(module) is not None
    except ModuleNotFoundError:
        is_installed = False
    if is_installed:
        return fine(f"{package} is installed, compiled")
    return doubtful(f"{package} is not installed as compiled code, so {without}; install {package}")


def space_finding(folder: Path, needs: MachineNeeds) -> Finding:
    """Whether a folder can be written, and its disk has room."""
    place = folder.resolve()
    if not os.access(place, os.W_OK | os.X_OK):
        return failing(f"{place} cannot be written; choose another folder")
    free = shutil.disk_usage(place).free
    text = f"{free / 1e9:.1f} GB free in {place}"
    if free < needs.min_disk:
        return failing(f"{text}: make room")
    if free < needs.ample_disk:
        return doubtful(f"{text}: a long recording may not fit")
    return fine(text)


def socket_finding(folder: Path) -> Finding:
    """Whether the paths of sockets are short enough."""
    length, limit = len(os.fsencode(folder / LONGEST_SOCKET)), zmq.IPC_PATH_MAX_LEN
    if length > limit:
        return failing(
            f"sockets in {folder} would have paths of {length} bytes, at most {limit} are allowed; "
            "set XDG_RUNTIME_DIR or TMPDIR to a folder with a shorter path"
        )
    return fine(f"paths of sockets have {length} of at most {limit} bytes, in {folder}")


def process_findings(proc: Path, stale: list[Path], needs: MachineNeeds) -> Iterator[Finding]:
    """Findings about cores, threads, open files, `proc` and `stale` folders of launchers."""
    affinity = getattr(os, "sched_getaffinity", None)
    cores = len(affinity(0)) if affinity is not None else os.cpu_count() or 1
    text = f"{cores} processor cores, load {os.getloadavg()[0]:.1f}"
    slow = f"{text}: nodes take turns; --composed is faster here"
    yield doubtful(slow) if cores < 2 else fine(text)
    threads = (f"{name} {os.environ.get(name, 'is not set')}" for name in THREAD_VARIABLES)
    yield fine(f"linear algebra of nodes runs on one thread; elsewhere {', '.join(threads)}")
    limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    text = f"at most {limit} open files a process"
    few = f"{text}, a large graph needs {needs.min_open_files}; raise it with ulimit -n"
    yield doubtful(few) if 0 <= limit < needs.min_open_files else fine(text)
    if (proc / "self" / "stat").exists():
        yield fine(f"{proc} shows what processes do")
    else:
        yield doubtful(f"there is no {proc}: busy nodes and hanging ones cannot be distinguished")
    names = ", ".join(path.name for path in stale)
    left = f"killed launchers have left {names}; the next run removes them"
    yield doubtful(left) if stale else fine("nothing is left of killed launchers")


def graphs_findings(cards: list[RunCard]) -> Iterator[Finding]:
    """Findings about all running graphs."""
    if not cards:
        yield fine("no graph of yours is running")
    elif len(cards) > 1 or os.environ.get(GRAPH_VARIABLE):
        yield choice_finding()
    for card in cards:
        try:
            answer = request(card, "status")
            running = [name for name, about in answer["nodes"].items() if about["pid"]]
            beats = sample_status(card, running)
        except ValueError as error:
            if is_running(card):
                yield failing(f"{error}; if it stays so, kill {card.pid}")
            continue
        yield from graph_findings(card, answer, beats)


def choice_finding() -> Finding:
    """Which graph the commands act on here."""
    try:
        return fine(f"here the commands act on the graph {find_run(None).title}")
    except ValueError as error:
        return doubtful(str(error))


def graph_findings(
    card: RunCard, answer: Mapping[str, Any], beats: Mapping[str, StatusSample]
) -> Iterator[Finding]:
    """Findings about one running graph."""
    nodes, title = answer["nodes"], f"{card.run[:6]} ({card.name})"
    faults = list(_faults(title, nodes, beats))
    if faults:
        yield from faults
        return
    handled = sum(sample.status.messages for sample in beats.values())
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
            yield failing(f"{who} misses {beats[name].status.gaps} messages: start the run again")


def report_lines(cards: list[RunCard]) -> Iterator[str]:
    """Lines for a report: system, packages, environment, running graphs."""
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
            f"in {card.folder or 'no run directory'}: {', '.join(node.name for node in card.nodes)}"
        )


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
