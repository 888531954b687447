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

from palpate.launch.processes.register import PREFIX, SAID, held, sweep, where
from palpate.messages.bus.place import Place

_RUN_BITS = 63


@contextmanager
def private_folder(parent: Path | None) -> Iterator[Path]:
    """Make a folder that only this user can enter, hold its lock, and remove it at the end.

    What launchers that were killed have left is taken away as well.

    Parameters
    ----------
    parent : Path or None
        Where to make it; None chooses the user's run-time folder, or else the temporary one.

    Raises
    ------
    ValueError
        If it cannot be made, or its path is too long for a socket.
    """
    sweep(parent)
    try:
        folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=where(parent)))
    except OSError as error:
        raise ValueError(
            f"no folder for sockets can be made in {where(parent)}: {error.strerror}"
        ) from None
    try:
        _check_length(folder / "control")
        with held(folder):
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def past_folder(run_dir: Path | None, folder: Path) -> Iterator[Path]:
    """Where nodes keep what they have said and have no memory for, removed at the end.

    Parameters
    ----------
    run_dir : Path or None
        The run directory, on a disk that has room; if there is none, the private folder must do.
    folder : Path
        The private folder, which may be held in memory.
    """
    if run_dir is None:
        yield folder
        return
    past = run_dir / SAID
    past.mkdir()
    try:
        yield past
    finally:
        shutil.rmtree(past, ignore_errors=True)


def place_of(folder: Path, names: Sequence[str], depth: int, past: Path) -> Place:
    """Addresses of a run, with short file names for nodes of any name."""
    return Place(
        run=secrets.randbits(_RUN_BITS),
        epoch=0,
        depth=depth,
        endpoints={name: f"ipc://{folder}/n{index}" for index, name in enumerate(names)},
        taps={name: f"ipc://{folder}/t{index}" for index, name in enumerate(names)},
        control=f"ipc://{folder}/control",
        tools=f"ipc://{folder}/tools",
        journals={name: str(folder / f"j{index}") for index, name in enumerate(names)},
        times={name: str(folder / f"s{index}") for index, name in enumerate(names)},
        pasts={name: str(past / f"p{index}") for index, name in enumerate(names)},
    )


def _check_length(socket: Path) -> None:
    length = len(os.fsencode(socket))
    if length > zmq.IPC_PATH_MAX_LEN:
        raise ValueError(
            f"the socket {socket} has a path of {length} bytes, at most {zmq.IPC_PATH_MAX_LEN} "
            "will do: choose a folder with a shorter path"
        )
