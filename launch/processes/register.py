"""The graphs of this user that run: each has a card in its private folder, and holds its lock.

There is no daemon and no list that could be stale: a graph runs as long as the kernel says that
its launcher holds the lock.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from palpate.nodes.recording import Recorded

PREFIX = "palpate-run-"
CARD, LOCK = "run.json", "lock"
SAID = ".said"
"""Folder in the run directory for what nodes have said and have no memory for."""
OURS = re.compile(r"[jnpst]\d+|control|tools|lock|\.?run\.json")
"""What a private folder may hold: one that holds anything else is somebody's own."""
YOUNG = 60.0
"""A folder without a card may just be coming up until it is so old, s."""


class Card(msgspec.Struct, frozen=True, kw_only=True):
    """What a running graph says of itself."""

    run: str
    """Number of the run, 16 hexadecimal digits."""
    name: str
    """Name of its scene or launch file."""
    pid: int
    """Process of its launcher."""
    began: str
    """Local time at which it was launched."""
    folder: str
    """Its run directory; empty if it has none."""
    ends: str
    """The node whose Finished ends it."""
    nodes: tuple[Recorded, ...]
    """Its nodes."""
    taps: dict[str, str]
    """Name of the node to the address of its tap."""
    tools: str
    """Address at which the launcher answers tools."""
    key: str = ""
    """File of the key that tools need; empty within one machine."""

    @property
    def topics(self) -> dict[str, str]:
        """Topic to the name of its message type."""
        return {topic: name for one in self.nodes for topic, name in one.types.items()}

    @property
    def publishers(self) -> dict[str, str]:
        """Topic to the node that publishes it."""
        return {topic: one.name for one in self.nodes for topic in one.outputs.values()}

    def listeners(self, topic: str) -> tuple[str, ...]:
        """The nodes that hear a topic."""
        hears = [(one.name, heard.topic) for one in self.nodes for heard in one.inputs]
        return tuple(name for name, heard in hears if heard == topic)


def where(parent: Path | None = None) -> Path:
    """Where private folders are made: the user's run-time folder, or else the temporary one."""
    if parent is not None:
        return parent
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime and os.access(runtime, os.W_OK | os.X_OK):
        return Path(runtime)
    return Path(tempfile.gettempdir())


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder; the kernel lets go of it when the process dies."""
    file = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(file)


def announce(folder: Path, card: Card) -> None:
    """Lay the card out, whole."""
    part = folder / f".{CARD}"
    part.write_bytes(msgspec.json.encode(card))
    part.replace(folder / CARD)


def running(parent: Path | None = None) -> list[Card]:
    """The graphs of this user that run, the latest last."""
    cards = [card for folder in _folders(parent) if (card := _card(folder)) and _is_held(folder)]
    return sorted(cards, key=lambda card: card.began)


def stale(parent: Path | None = None) -> list[Path]:
    """Folders whose launcher was killed before it could take them away."""
    return [folder for folder in _folders(parent) if _is_stale(folder)]


def sweep(parent: Path | None = None) -> None:
    """Take away what killed launchers have left."""
    for folder in stale(parent):
        card = _card(folder)
        if card is not None and card.folder:
            shutil.rmtree(Path(card.folder) / SAID, ignore_errors=True)
        shutil.rmtree(folder, ignore_errors=True)


def find_run(wanted: str | None, parent: Path | None = None) -> Card:
    """The running graph that is meant: by the beginning of its number, by name, or the latest.

    Raises
    ------
    ValueError
        If there is none, or several are meant.
    """
    cards = running(parent)
    if not cards:
        raise ValueError("no graph of yours is running; start one with palpate run or launch")
    if wanted is None:
        return cards[-1]
    found = [card for card in cards if card.run.startswith(wanted) or card.name == wanted]
    if len(found) == 1:
        return found[0]
    known = ", ".join(f"{card.run[:6]} ({card.name})" for card in cards)
    how = "several running graphs are" if found else "no running graph is"
    raise ValueError(f"{how} called {wanted!r}; there are {known}")


def _folders(parent: Path | None) -> list[Path]:
    try:
        found = [path for path in where(parent).iterdir() if path.name.startswith(PREFIX)]
        return [path for path in found if path.is_dir() and path.stat().st_uid == os.getuid()]
    except OSError:
        return []


def _is_held(folder: Path) -> bool:
    try:
        file = os.open(folder / LOCK, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(file)
    return False


def _is_stale(folder: Path) -> bool:
    try:
        # Who takes a folder away may be killed, too, when the lock has gone and others are left.
        file = folder / LOCK if (folder / LOCK).exists() else folder
        old = time.time() - file.stat().st_mtime > YOUNG
        ours = all(OURS.fullmatch(entry.name) for entry in folder.iterdir())
    except OSError:
        return False
    return ours and (old or (folder / CARD).exists()) and not _is_held(folder)


def _card(folder: Path) -> Card | None:
    try:
        return msgspec.json.decode((folder / CARD).read_bytes(), type=Card)
    except (OSError, msgspec.DecodeError):
        return None
