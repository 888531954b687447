"""What a graph leaves for others to find.

Its card while it runs, and what a later run can go on from.
"""

from __future__ import annotations

import fcntl
import os
import re
import secrets
import shutil
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import zmq

from palpate.messages import Header, pack_frame
from palpate.messages.bus import (
    Addresses,
    Cause,
    Consumed,
    Journal,
    MessageLog,
    OutsideMessage,
    ParameterLog,
    SendTimes,
)
from palpate.messages.types import ParameterEvent
from palpate.nodes.runtime.node import RecordedNode, Wiring

FOLDER_PREFIX = "palpate-run-"
CARD_FILE, LOCK_FILE = "run.json", "lock"
RUNS_FOLDER = "runs"  # Where run directories are made, in the working directory
LONGEST_SOCKET = f"{FOLDER_PREFIX}{8 * 'x'}/control"  # In a private folder, named at random
SYSTEM_TEMPORARY = "/tmp"
MESSAGE_LOG_FOLDER = ".published"  # In the run directory, for what is published and not remembered
# What a private folder may hold: one that holds anything else is somebody's own.
OWN_FILES = re.compile(r"[jnpst]\d+|j\d+[co]|control|tools|lock|\.?run\.json")
GRAPH_VARIABLE = "PALPATE_GRAPH"  # Of the environment: which running graph the tools mean
GRACE_AGE = 60.0  # A folder without a card may just be coming up until it is so old, s
_RUN_BITS = 63


class RunCard(msgspec.Struct, frozen=True, kw_only=True):
    """What a running graph tells of itself."""

    run: str  # Number of the run, 16 hexadecimal digits
    name: str  # Name of its scene or launch file
    pid: int  # Process of its launcher
    began: str  # Local time at which it was launched
    folder: str  # Its run directory; empty if it has none
    started_in: str = ""  # Working directory in which it was launched; empty if not known
    ends: str  # The node whose Finished ends it
    nodes: tuple[RecordedNode, ...]  # Its nodes
    taps: dict[str, str]  # Name of the node to the address of its tap
    tools: str  # Address at which the launcher answers tools
    key: str = ""  # File of the key that tools need; empty within one machine
    # Parameters with which it began, of each node of which some were set since
    initial: dict[str, msgspec.Raw] = {}

    @property
    def topics(self) -> dict[str, str]:
        """Topic to the name of its message type."""
        return {topic: name for one in self.nodes for topic, name in one.types.items()}

    @property
    def schemas(self) -> dict[str, str]:
        """Name of each message type that palpate does not have, to its JSON schema."""
        return {name: text for one in self.nodes for name, text in one.schemas.items()}

    @property
    def publishers(self) -> dict[str, str]:
        """Topic to the node that publishes it."""
        return {topic: one.name for one in self.nodes for topic in one.outputs.values()}

    def is_called(self, name: str) -> bool:
        """Whether that is its name, begins its number, or is its folder or a recording there.

        Of the folder, its last part alone will do.
        """
        path = Path(name).resolve()
        home = path.parent if path.suffix == ".mcap" else path
        run_dir = Path(self.folder).resolve() if self.folder else None
        same = run_dir is not None and (run_dir == home or run_dir.name == name)
        return same or self.run.startswith(name) or self.name == name

    def belongs_to(self, folder: Path) -> bool:
        """Whether it was started in a folder, or its run directory is that, or lies in its runs."""
        if self.started_in and Path(self.started_in) == folder:
            return True
        run_dir = Path(self.folder).resolve() if self.folder else None
        homes = (folder, folder / RUNS_FOLDER)
        return run_dir is not None and (run_dir == folder or run_dir.parent in homes)

    @property
    def title(self) -> str:
        """Number, name and run directory, as a list of graphs has it."""
        where = f" in {_shown(Path(self.folder))}" if self.folder else ""
        return f"{self.run[:6]} ({self.name}{where})"

    def subscribers(self, topic: str) -> tuple[str, ...]:
        """The nodes that subscribe to a topic."""
        return tuple(one.name for one in self.nodes for x in one.inputs if x.topic == topic)


def runtime_folder(parent: Path | None = None) -> Path:
    """Where private folders are made: the user's run-time folder, or else the temporary one.

    If sockets there had too long a path, the system's temporary folder.
    """
    if parent is not None:
        return parent
    named = (os.environ.get("XDG_RUNTIME_DIR", ""), tempfile.gettempdir(), SYSTEM_TEMPORARY)
    usable = [Path(one) for one in named if one and os.access(one, os.W_OK | os.X_OK)]
    fitting = [one for one in usable if fits_socket(one / LONGEST_SOCKET)]
    return next(iter([*fitting, *usable]), Path(tempfile.gettempdir()))


def fits_socket(path: Path) -> bool:
    """Whether a socket's path is short enough for the system."""
    return len(os.fsencode(path)) <= zmq.IPC_PATH_MAX_LEN


def announce(folder: Path, card: RunCard) -> None:
    """Lay the card out, whole."""
    part = folder / f".{CARD_FILE}"
    part.write_bytes(msgspec.json.encode(card))
    part.replace(folder / CARD_FILE)


class Announcement:
    """The card of a graph that runs; it tells parameters as they were set last."""

    def __init__(self, folder: Path, card: RunCard) -> None:
        self._folder, self._card = folder, card
        announce(folder, card)

    def set(self, name: str, params: Any) -> None:
        """A node has other parameters."""
        raw, card = msgspec.Raw(msgspec.json.encode(params)), self._card
        nodes = {one.name: one for one in card.nodes}
        initial = {name: nodes[name].params, **card.initial}
        nodes[name] = msgspec.structs.replace(nodes[name], params=raw)
        self._card = msgspec.structs.replace(card, nodes=(*nodes.values(),), initial=initial)
        announce(self._folder, self._card)


def running_graphs(parent: Path | None = None) -> list[RunCard]:
    """The graphs of this user that run, the latest last."""
    held = (card for x in _folders(parent) if (card := _read_card(x)) and _is_held(x))
    return sorted(held, key=lambda card: card.began)


def stale_folders(parent: Path | None = None) -> list[Path]:
    """Folders whose launcher was killed before it could take them away."""
    return [folder for folder in _folders(parent) if _is_stale(folder)]


def _folders(parent: Path | None) -> list[Path]:
    try:
        found = runtime_folder(parent).glob(f"{FOLDER_PREFIX}*")
        return [path for path in found if path.is_dir() and path.stat().st_uid == os.getuid()]
    except OSError:
        return []


def _is_stale(folder: Path) -> bool:
    try:
        # Who takes a folder away may be killed, too, when the lock has gone and others are left.
        file = folder / LOCK_FILE if (folder / LOCK_FILE).exists() else folder
        old = time.time() - file.stat().st_mtime > GRACE_AGE
        ours = all(OWN_FILES.fullmatch(entry.name) for entry in folder.iterdir())
    except OSError:
        return False
    return ours and (old or (folder / CARD_FILE).exists()) and not _is_held(folder)


def _is_held(folder: Path) -> bool:
    try:
        file = os.open(folder / LOCK_FILE, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(file)
    return False


def remove_stale_folders(parent: Path | None = None) -> None:
    """Take away what killed launchers have left."""
    for folder in stale_folders(parent):
        card = _read_card(folder)
        if card is not None and card.folder:
            shutil.rmtree(Path(card.folder) / MESSAGE_LOG_FOLDER, ignore_errors=True)
        shutil.rmtree(folder, ignore_errors=True)


def _read_card(folder: Path) -> RunCard | None:
    try:
        return msgspec.json.decode((folder / CARD_FILE).read_bytes(), type=RunCard)
    except (OSError, msgspec.DecodeError):
        return None


def find_run(wanted: str | None, parent: Path | None = None) -> RunCard:
    """The running graph that is meant.

    That is the one that is called `wanted`, as `RunCard.is_called` says; else the one that the
    environment variable PALPATE_GRAPH calls so; else the one that belongs to the working directory;
    else the only one. Raises ValueError if there is none, or several may be meant.
    """
    cards = running_graphs(parent)
    if not cards:
        raise ValueError("no graph of yours is running; start one with palpate run or launch")
    chosen = os.environ.get(GRAPH_VARIABLE, "")
    if wanted is None and chosen:
        return _called(chosen, cards, f"{GRAPH_VARIABLE}={chosen}: ")
    if wanted is not None:
        return _called(wanted, cards, "")
    here = [card for card in cards if card.belongs_to(Path.cwd())]
    if len(here or cards) == 1:
        return (here or cards)[0]
    whose = "of this folder" if here else "and none is of this folder"
    raise ValueError(
        f"{len(here or cards)} graphs run {whose}; choose one by its number, with --run or "
        f"{GRAPH_VARIABLE}: {_listed(here or cards)}"
    )


def _called(name: str, cards: Sequence[RunCard], source: str) -> RunCard:
    """The graph of a name; `source` says where the name comes from."""
    found = [card for card in cards if card.is_called(name)]
    if len(found) == 1:
        return found[0]
    how = "several running graphs are" if found else "no running graph is"
    raise ValueError(f"{source}{how} called {name!r}; there are {_listed(found or cards)}")


def _listed(cards: Sequence[RunCard]) -> str:
    return ", ".join(f"--run {card.title}" for card in cards)


def _shown(path: Path) -> str:
    """A path from the working directory, if it lies there."""
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except (ValueError, OSError):
        return str(path)


@contextmanager
def private_folder(parent: Path | None) -> Iterator[Path]:
    """Make a folder that only this user can enter, hold its lock, and remove it at the end.

    It lies in `parent`, or else in the user's run-time or temporary folder. What launchers that
    were killed have left is taken away as well. Raises ValueError if it cannot be made, or its path
    is too long for a socket.
    """
    remove_stale_folders(parent)
    try:
        folder = Path(tempfile.mkdtemp(prefix=FOLDER_PREFIX, dir=runtime_folder(parent)))
    except OSError as error:
        raise ValueError(
            f"no folder for sockets can be made in {runtime_folder(parent)}: {error.strerror}"
        ) from None
    try:
        socket = folder / "control"
        if (length := len(os.fsencode(socket))) > zmq.IPC_PATH_MAX_LEN:
            raise ValueError(
                f"the socket {socket} has a path of {length} bytes, at most {zmq.IPC_PATH_MAX_LEN} "
                "will do: choose a folder with a shorter path"
            )
        with folder_lock(folder):
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder; the kernel lets go of it when the process dies."""
    file = os.open(folder / LOCK_FILE, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(file)


@contextmanager
def message_log_folder(run_dir: Path | None, folder: Path) -> Iterator[Path]:
    """Where nodes keep what they published and have no memory for, removed at the end.

    It lies in the run directory, on a disk that has room; without one, the private folder must do,
    which may be held in memory.
    """
    if run_dir is None:
        yield folder
        return
    past = run_dir / MESSAGE_LOG_FOLDER
    past.mkdir()
    try:
        yield past
    finally:
        shutil.rmtree(past, ignore_errors=True)


def addresses_of(folder: Path, names: Sequence[str], depth: int, past: Path) -> Addresses:
    """Addresses of a run, with short file names for nodes of any name."""

    def numbered(path: str) -> dict[str, str]:
        return {name: f"{path}{index}" for index, name in enumerate(names)}

    return Addresses(
        run=secrets.randbits(_RUN_BITS),
        epoch=0,
        depth=depth,
        endpoints=numbered(f"ipc://{folder}/n"),
        taps=numbered(f"ipc://{folder}/t"),
        control=f"ipc://{folder}/control",
        tools=f"ipc://{folder}/tools",
        journals=numbered(f"{folder}/j"),
        times=numbered(f"{folder}/s"),
        pasts=numbered(f"{past}/p"),
    )


class SentMessage(NamedTuple):
    """One message that a node had sent."""

    topic: str  # On the wire
    sent_ns: int  # The node's clock, ns
    schema: int  # Hash of the type's schema
    body: bytes  # Encoded
    outside: bool = False  # Whether a tool had the node send it


@dataclass(frozen=True, slots=True)
class EarlierRun:
    """An earlier run, as far as it shall not be done again.

    Its times are shifted, so that the latest of them is now: it may have run before the machine was
    started anew, and what comes is to follow it without a gap.
    """

    # What each node had handled, in its order: it goes through it once more, unheard. Those that
    # act on the world do not.
    consumed: Mapping[str, Sequence[Consumed]]
    published: Mapping[str, Sequence[SentMessage]]  # What those had published that act on the world
    # Topics and times, ns, of what the others had published: they do so again with these.
    times: Mapping[str, Sequence[tuple[str, int]]]
    # Parameters that were set while a node ran
    changes: Mapping[str, Sequence[ParameterEvent]] = field(default_factory=dict)
    # What tools had the others publish
    outside: Mapping[str, Sequence[OutsideMessage]] = field(default_factory=dict)

    def lay(self, wirings: Sequence[Wiring], place: Addresses) -> None:
        """Write the journals and message logs that the nodes, with their subscribers, will find."""
        sent_ns = [one.sent_ns for messages in self.published.values() for one in messages]
        sent_ns += [when for times in self.times.values() for _, when in times]
        later_ns = time.monotonic_ns() - max(sent_ns, default=0)
        for wiring in wirings:
            if wiring.persistent:
                self._remember(wiring, place, later_ns)
            else:
                self._put_down(wiring, place, later_ns)

    def _put_down(self, wiring: Wiring, place: Addresses, later_ns: int) -> None:
        """What a node goes through once more, and when it had published what."""
        edges = [(one.publisher, one.topic) for one in wiring.inputs]
        with closing(Journal(Path(place.journals[wiring.name]), edges)) as journal:
            for one in self.consumed.get(wiring.name, ()):
                journal.note(*one)
        if changes := self.changes.get(wiring.name):
            with closing(ParameterLog(Path(place.journals[wiring.name]))) as log:
                for change in changes:
                    log.note(msgspec.json.encode(change))
        if outside := self.outside.get(wiring.name):
            with closing(ParameterLog(Path(place.journals[wiring.name]), "o")) as log:
                for message in outside:
                    log.note(msgspec.json.encode(message))
        topics = [topic for topic in wiring.outputs.values() if wiring.subscribers.get(topic)]
        with closing(SendTimes(Path(place.times[wiring.name]), wiring.name, topics)) as times:
            for topic, sent_ns in self.times.get(wiring.name, ()):
                times.note(topic, sent_ns + later_ns)

    def _remember(self, wiring: Wiring, place: Addresses, later_ns: int) -> None:
        """What a node has answered, and how."""
        topics = tuple(wiring.outputs.values())
        with closing(MessageLog(Path(place.pasts[wiring.name]), topics, persistent=True)) as past:
            for topic, sent_ns, schema, body, outside in self.published.get(wiring.name, ()):
                seq, when = past.count(topic), sent_ns + later_ns
                header = Header(place.run, 0, seq, when, 0.0, schema, outside)
                past.add(topic, pack_frame(topic, header, body))
            for publisher, topic, seq in self.consumed.get(wiring.name, ()):
                past.answer((), Cause(publisher, topic, seq))
