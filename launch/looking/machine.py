"""Whether this machine and this installation can run a graph."""

from __future__ import annotations

import os
import platform
import resource
import shutil
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

import zmq

from palpate import __version__
from palpate.launch.looking.findings import Finding, fail, ok, warn
from palpate.launch.processes.register import PREFIX, stale, where
from palpate.launch.versions import MATTERS

LITTLE, LEAST = 1 << 30, 1 << 24
"""Free space on a disk that makes a long recording doubtful, and any, bytes."""
FEW_FILES = 256
"""Open files that a process needs, at the least."""
_RANDOM = 8
"""Letters that the name of a private folder has after its beginning."""
_LONGEST_NAME = "control"


def machine_findings() -> Iterator[Finding]:
    """What there is to say of machine and installation."""
    yield ok(
        f"palpate {__version__}, Python {platform.python_version()}, "
        f"{platform.system()} {platform.machine()}"
    )
    yield packages_finding()
    yield from zmq_findings()
    yield compiled_finding("msgpack", "msgpack._cmsgpack", "messages are packed slowly")
    yield compiled_finding("lz4", "lz4.frame", "recordings cannot be compressed")
    yield compiled_finding("embreex", "embreex", "casts at meshes are slow")
    yield space_finding(Path())
    yield space_finding(where())
    yield socket_finding(where())
    yield cores_finding()
    yield threads_finding()
    yield files_finding()
    yield proc_finding(Path("/proc"))
    yield stale_finding(stale())


def packages_finding() -> Finding:
    """Whether all is there that results and recordings depend on."""
    found, missing = [], []
    for name in MATTERS:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            missing.append(name)
    if missing:
        return fail(f"packages are missing: {', '.join(missing)}; install palpate once more")
    return ok(f"packages: {', '.join(found)}")


def zmq_findings() -> Iterator[Finding]:
    """Whether ZeroMQ has what the bus uses."""
    said = f"ZeroMQ {zmq.zmq_version()}"
    if zmq.zmq_version_info() < (4, 3):
        yield fail(f"{said} is too old, the bus needs 4.3; install a newer pyzmq")
    elif not zmq.has("ipc"):
        yield fail(f"{said} has no Unix sockets, which the bus needs; install another pyzmq")
    elif not zmq.has("curve"):
        yield warn(f"{said} cannot encrypt (no CURVE); do not let it leave this machine")
    else:
        yield ok(f"{said} with Unix sockets and CURVE")


def compiled_finding(package: str, module: str, without: str) -> Finding:
    """Whether the compiled part of a package is there."""
    try:
        there = find_spec(module) is not None
    except ModuleNotFoundError:
        there = False
    if there:
        return ok(f"{package} is there, compiled")
    return warn(f"{package} is not there as compiled code, so {without}; install {package}")


def space_finding(folder: Path) -> Finding:
    """Whether a folder can be written, and has room."""
    place = folder.resolve()
    if not os.access(place, os.W_OK | os.X_OK):
        return fail(f"{place} cannot be written; choose another folder")
    free = shutil.disk_usage(place).free
    said = f"{free / 1e9:.1f} GB free in {place}"
    if free < LEAST:
        return fail(f"{said}: make room")
    return warn(f"{said}: a long recording may not fit") if free < LITTLE else ok(said)


def socket_finding(folder: Path) -> Finding:
    """Whether the paths of sockets will be short enough."""
    path = folder / f"{PREFIX}{'x' * _RANDOM}" / _LONGEST_NAME
    length, most = len(os.fsencode(path)), zmq.IPC_PATH_MAX_LEN
    if length > most:
        return fail(
            f"sockets in {folder} would have paths of {length} bytes, at most {most} will do; "
            "set XDG_RUNTIME_DIR or TMPDIR to a folder with a shorter path"
        )
    return ok(f"paths of sockets have {length} of at most {most} bytes, in {folder}")


def cores_finding() -> Finding:
    """How many processor cores there are for the nodes."""
    affinity = getattr(os, "sched_getaffinity", None)
    cores = len(affinity(0)) if affinity is not None else os.cpu_count() or 1
    said = f"{cores} processor cores, load {os.getloadavg()[0]:.1f}"
    if cores < 2:
        return warn(f"{said}: nodes take turns; --composed is faster here")
    return ok(said)


def threads_finding() -> Finding:
    """Whether linear algebra outside nodes keeps to one thread."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    limits = [f"{name}={os.environ[name]}" for name in names if name in os.environ]
    said = ", ".join(limits) if limits else "this shell sets no limit for others"
    return ok(f"linear algebra of nodes runs on one thread; {said}")


def files_finding() -> Finding:
    """How many files a process may have open."""
    most, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    said = f"at most {most} open files a process"
    if 0 <= most < FEW_FILES:
        return warn(f"{said}, a large graph needs {FEW_FILES}; raise it with ulimit -n")
    return ok(said)


def proc_finding(proc: Path) -> Finding:
    """Whether the system says what a process does."""
    if (proc / "self" / "stat").exists():
        return ok(f"{proc} says what processes do")
    return warn(f"there is no {proc}: a busy node cannot be told from one that hangs")


def stale_finding(folders: list[Path]) -> Finding:
    """What killed launchers have left."""
    if not folders:
        return ok("nothing is left of killed launchers")
    names = ", ".join(path.name for path in folders)
    return warn(f"killed launchers have left {names}; the next run takes them away")
