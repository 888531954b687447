"""Files of a running graph: its card, by which tools find it, and logs to continue a run."""

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
RUNS_FOLDER = "runs"  # folder of run directories, in the working directory
LONGEST_SOCKET = f"{FOLDER_PREFIX}{8 * 'x'}/control"  # in a private folder with a random name
SYSTEM_TEMPORARY = "/tmp"
MESSAGE_LOG_FOLDER = ".published"  # in the run directory, for messages that exceed the memory
# Names of files in a private folder: a folder with other files is not one.
OWN_FILES = re.compile(r"[jnpst]\d+|j\d+[co]|control|tools|lock|\.?run\.json")
GRAPH_VARIABLE = "PALPATE_GRAPH"  # environment variable of the running graph for tools


class RunCard(msgspec.Struct, frozen=True, kw_only=True):
    """Description of a running graph for tools."""

    run: str  # number of the run, 16 hexadecimal digits
    name: str  # of its scene or launch file
    pid: int  # of the launcher's process
    began: str  # local time of the launch
    folder: str  # run directory; empty if there is none
    started_in: str = ""  # working directory of the launch; empty if unknown
    ends: str  # node whose Finished ends it
    nodes: tuple[RecordedNode, ...]
    taps: dict[str, str]  # addresses of the taps by node
    tools: str  # address at which the launcher answers tools
    key: str = ""  # file of the key that tools need; empty within one machine
    # Initial parameters of nodes with parameters that have been changed since.
    initial: dict[str, msgspec.Raw] = {}

    @property
    def topics(self) -> dict[str, str]:
        """Names of message types by topic."""
        return {topic: name for node in self.nodes for topic, name in node.types.items()}

    @property
    def schemas(self) -> dict[str, str]:
        """JSON schemas of message types that are not palpate's, by name."""
        return {name: text for node in self.nodes for name, text in node.schemas.items()}

    @property
    def publishers(self) -> dict[str, str]:
        """Publishing nodes by topic."""
        return {topic: node.name for node in self.nodes for topic in node.outputs.values()}

    def is_called(self, name: str) -> bool:
        """Whether a text is its name, the beginning of its number, or its folder or recording.

        The last part of the folder is enough.
        """
        path = Path(name).resolve()
        folder = path.parent if path.suffix == ".mcap" else path
        run_dir = Path(self.folder).resolve() if self.folder else None
        is_folder = run_dir is not None and (run_dir == folder or run_dir.name == name)
        return is_folder or self.run.startswith(name) or self.name == name

    def belongs_to(self, folder: Path) -> bool:
        """Whether it was started in a folder, or its run directory is the folder or in its runs."""
        if self.started_in and Path(self.started_in) == folder:
            return True
        run_dir = Path(self.folder).resolve() if self.folder else None
        parents = (folder, folder / RUNS_FOLDER)
        return run_dir is not None and (run_dir == folder or run_dir.parent in parents)

    @property
    def title(self) -> str:
        """Number, name and run directory, for lists of graphs."""
        where = f" in {_shown(Path(self.folder))}" if self.folder else ""
        return f"{self.run[:6]} ({self.name}{where})"

    def subscribers(self, topic: str) -> tuple[str, ...]:
        """The nodes that subscribe to a topic."""
        return tuple(node.name for node in self.nodes for x in node.inputs if x.topic == topic)


def runtime_folder(parent: Path | None = None) -> Path:
    """The parent of private folders: the user's run-time folder, else the temporary folder.

    It is the system's temporary folder if paths of sockets in the others are too long.
    """
    if parent is not None:
        return parent
    named = (os.environ.get("XDG_RUNTIME_DIR", ""), tempfile.gettempdir(), SYSTEM_TEMPORARY)
    usable = [Path(name) for name in named if name and os.access(name, os.W_OK | os.X_OK)]
    fitting = [path for path in usable if fits_socket(path / LONGEST_SOCKET)]
    return next(iter([*fitting, *usable]), Path(tempfile.gettempdir()))


def fits_socket(path: Path) -> bool:
    """Whether the path of a socket is short enough for the system."""
    return len(os.fsencode(path)) <= zmq.IPC_PATH_MAX_LEN


def announce(folder: Path, card: RunCard) -> None:
    """Write the card, whole or not at all."""
    part = folder / f".{CARD_FILE}"
    part.write_bytes(msgspec.json.encode(card))
    part.replace(folder / CARD_FILE)


class Announcement:
    """The card of a running graph, with the parameters as they were set last."""

    def __init__(self, folder: Path, card: RunCard) -> None:
        self._folder, self._card = folder, card
        announce(folder, card)

    def set(self, name: str, params: Any) -> None:
        """Write other parameters of a node."""
        raw, card = msgspec.Raw(msgspec.json.encode(params)), self._card
        nodes = {node.name: node for node in card.nodes}
        initial = {name: nodes[name].params, **card.initial}
        nodes[name] = msgspec.structs.replace(nodes[name], params=raw)
        self._card = msgspec.structs.replace(card, nodes=(*nodes.values(),), initial=initial)
        announce(self._folder, self._card)


def running_graphs(parent: Path | None = None) -> list[RunCard]:
    """The running graphs of this user, the latest last."""
    cards = (card for x in _folders(parent) if (card := _read_card(x)) and _is_held(x))
    return sorted(cards, key=lambda card: card.began)


def stale_folders(parent: Path | None = None) -> list[Path]:
    """Folders of launchers that were killed before they could remove them."""
    return [folder for folder in _folders(parent) if _is_stale(folder)]


def _folders(parent: Path | None) -> list[Path]:
    try:
        folders = runtime_folder(parent).glob(f"{FOLDER_PREFIX}*")
        return [path for path in folders if path.is_dir() and path.stat().st_uid == os.getuid()]
    except OSError:
        return []


def _is_stale(folder: Path, min_age: float = 60.0) -> bool:
    """Whether a folder is left behind; without a card it may be new until `min_age` [s]."""
    try:
        # A launcher may be killed while it removes a folder, whose lock is removed first.
        file = folder / LOCK_FILE if (folder / LOCK_FILE).exists() else folder
        is_old = time.time() - file.stat().st_mtime > min_age
        is_own = all(OWN_FILES.fullmatch(entry.name) for entry in folder.iterdir())
    except OSError:
        return False
    return is_own and (is_old or (folder / CARD_FILE).exists()) and not _is_held(folder)


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
    """Remove the folders of killed launchers."""
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
    """The running graph with name `wanted`, as of `RunCard.is_called`.

    Without a name it is the graph named by the environment variable PALPATE_GRAPH, else the one
    that belongs to the working directory, else the only one. Raises ValueError if there is no such
    graph, or several.
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
    """The graph of a name; `source`: prefix of errors with the source of the name."""
    called = [card for card in cards if card.is_called(name)]
    if len(called) == 1:
        return called[0]
    fault = "several running graphs are" if called else "no running graph is"
    raise ValueError(f"{source}{fault} called {name!r}; there are {_listed(called or cards)}")


def _listed(cards: Sequence[RunCard]) -> str:
    return ", ".join(f"--run {card.title}" for card in cards)


def _shown(path: Path) -> str:
    """A path relative to the working directory, if it is below it."""
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except (ValueError, OSError):
        return str(path)


@contextmanager
def private_folder(parent: Path | None) -> Iterator[Path]:
    """Make a folder that only this user can enter, hold its lock, and remove it at the end.

    It is in `parent`, or else in the user's run-time or temporary folder. Folders of killed
    launchers are removed as well. Raises ValueError if it cannot be made, or its path is too long
    for a socket.
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
    """Hold the lock of a folder; the kernel releases it when the process dies."""
    file = os.open(folder / LOCK_FILE, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(file)


@contextmanager
def message_log_folder(run_dir: Path | None, folder: Path) -> Iterator[Path]:
    """The folder for published messages that exceed the memory of nodes; removed at the end.

    It is in the run directory, on a disk; without a run directory it is the private folder, which
    may be in memory.
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
        run=secrets.randbits(63),  # fits a signed word
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
    """A message that a node sent in an earlier run."""

    topic: str  # on the wire
    sent_ns: int  # time of the node's clock [ns]
    schema: int  # hash of the type's schema
    body: bytes  # encoded
    outside: bool = False  # whether a tool requested it


@dataclass(frozen=True, slots=True)
class EarlierRun:
    """An earlier run that a run continues.

    Persistent nodes, which act on the world, remember what they published. All other nodes handle
    their messages once more, without sending. Times are shifted so that the latest one is now.
    """

    # Messages that each node handled, in their order.
    consumed: Mapping[str, Sequence[Consumed]]
    published: Mapping[str, Sequence[SentMessage]]  # messages of persistent nodes
    # Topics and times [ns] of the messages of other nodes, which these use again.
    times: Mapping[str, Sequence[tuple[str, int]]]
    # Parameters that were set while a node ran.
    changes: Mapping[str, Sequence[ParameterEvent]] = field(default_factory=dict)
    # Messages that tools requested of other nodes.
    outside: Mapping[str, Sequence[OutsideMessage]] = field(default_factory=dict)

    def write(self, wirings: Sequence[Wiring], place: Addresses) -> None:
        """Write the journals and message logs of the nodes; wirings have all subscribers."""
        sent_ns = [sent.sent_ns for messages in self.published.values() for sent in messages]
        sent_ns += [when for times in self.times.values() for _, when in times]
        shift_ns = time.monotonic_ns() - max(sent_ns, default=0)
        for wiring in wirings:
            if wiring.persistent:
                self._write_message_log(wiring, place, shift_ns)
            else:
                self._write_journal(wiring, place, shift_ns)

    def _write_journal(self, wiring: Wiring, place: Addresses, shift_ns: int) -> None:
        """Write the messages that a node handles once more, and the times of those it published."""
        edges = [(edge.publisher, edge.topic) for edge in wiring.inputs]
        with closing(Journal(Path(place.journals[wiring.name]), edges)) as journal:
            for consumed in self.consumed.get(wiring.name, ()):
                journal.note(*consumed)
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
                times.note(topic, sent_ns + shift_ns)

    def _write_message_log(self, wiring: Wiring, place: Addresses, shift_ns: int) -> None:
        """Write the messages that a persistent node handled and published."""
        topics = tuple(wiring.outputs.values())
        with closing(MessageLog(Path(place.pasts[wiring.name]), topics, persistent=True)) as past:
            for topic, sent_ns, schema, body, outside in self.published.get(wiring.name, ()):
                seq, when = past.count(topic), sent_ns + shift_ns
                header = Header(place.run, 0, seq, when, 0.0, schema, outside)
                past.add(topic, pack_frame(topic, header, body))
            for publisher, topic, seq in self.consumed.get(wiring.name, ()):
                past.answer((), Cause(publisher, topic, seq))
