"""The private folder of a run: its sockets live there, and vanish with it."""

from __future__ import annotations

import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import zmq

from palpate.messages.bus.place import Place

_RUN_BITS = 63


@contextmanager
def private_folder(parent: Path | None) -> Iterator[Path]:
    """Make a folder that only this user can enter, and remove it at the end.

    Parameters
    ----------
    parent : Path or None
        Where to make it; None chooses the user's run-time folder, or else the temporary one.

    Raises
    ------
    ValueError
        If it cannot be made, or its path is too long for a socket.
    """
    where = _default_parent() if parent is None else parent
    try:
        folder = Path(tempfile.mkdtemp(prefix="palpate-", dir=where))
    except OSError as error:
        raise ValueError(
            f"no folder for sockets can be made in {where}: {error.strerror}"
        ) from None
    try:
        _check_length(folder / "control")
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def place_of(folder: Path, names: Sequence[str], depth: int) -> Place:
    """Addresses of a run, with short file names for nodes of any name."""
    return Place(
        run=secrets.randbits(_RUN_BITS),
        epoch=0,
        depth=depth,
        endpoints={name: f"ipc://{folder}/n{index}" for index, name in enumerate(names)},
        taps={name: f"ipc://{folder}/t{index}" for index, name in enumerate(names)},
        control=f"ipc://{folder}/control",
        journals={name: str(folder / f"j{index}") for index, name in enumerate(names)},
        pasts={name: str(folder / f"p{index}") for index, name in enumerate(names)},
    )


def _default_parent() -> Path:
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime and os.access(runtime, os.W_OK | os.X_OK):
        return Path(runtime)
    return Path(tempfile.gettempdir())


def _check_length(socket: Path) -> None:
    length = len(os.fsencode(socket))
    if length > zmq.IPC_PATH_MAX_LEN:
        raise ValueError(
            f"the socket {socket} has a path of {length} bytes, at most {zmq.IPC_PATH_MAX_LEN} "
            "will do: choose a folder with a shorter path"
        )
