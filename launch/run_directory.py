"""The run directory: what a run leaves behind, its recording, the versions it depends on."""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from palpate.launch.files import InputError
from palpate.messages.recording import free_bytes

RUNS = Path("runs")  # Where run directories are made, unless the user says otherwise
LATEST = "latest"  # Link to the last of them
RECORDING = "topics.mcap"  # Name of the recording in a run directory
VERSIONED_PACKAGES = ("numpy", "scipy", "trimesh", "pyzmq", "msgpack", "msgspec", "mcap", "lz4")


@dataclass(frozen=True, slots=True)
class RunDirectory:
    """A folder of one's own, made when the run begins."""

    path: Path  # The folder
    linked: bool  # Whether ``latest`` beside it shall point to it

    def check_room(self, spare: int) -> None:
        """Refuse a disk that is too full for a recording, before anything is made.

        Parameters
        ----------
        spare : int
            Bytes that the recorder leaves free.

        Raises
        ------
        InputError
            If there are not even that many.
        """
        there = next(path for path in (self.path, *self.path.absolute().parents) if path.exists())
        left = free_bytes(there)
        if left < spare:
            raise InputError(
                f"{self.path}: only {left >> 20} MiB are free on its disk, and the recorder leaves "
                f"{spare >> 20} free; make room, or leave it out with --no-record"
            )

    def create(self) -> None:
        """Make the folder and show that it can be written.

        Raises
        ------
        InputError
            If that is not possible.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            probe = self.path / ".probe"
            probe.write_bytes(b"")
            probe.unlink()
            if self.linked:
                _link_latest(self.path.parent / LATEST, self.path.name)
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written: {error.strerror}") from None

    def write_text(self, name: str, text: str) -> None:
        """Write a file whole or not at all."""
        part = self.path / f".{name}.part"
        part.write_text(text, encoding="utf-8")
        part.replace(self.path / name)

    def write_json(self, name: str, value: Mapping[str, Any]) -> None:
        """Write a JSON file whole or not at all; infinity and NaN are refused."""
        self.write_text(name, json.dumps(value, indent=2, allow_nan=False) + "\n")

    def files(self) -> tuple[str, ...]:
        """Names of what lies in it."""
        return tuple(sorted(entry.name for entry in self.path.iterdir()))


def _link_latest(link: Path, target: str) -> None:
    part = link.with_name(f".{link.name}.{os.getpid()}")
    part.unlink(missing_ok=True)
    part.symlink_to(target)
    part.replace(link)


def choose_run_directory(name: str, out: Path | None) -> RunDirectory:
    """The folder for a run, not yet made.

    Parameters
    ----------
    name : str
        Name of the scene or launch file.
    out : Path or None
        The folder that the user asks for; None for a new one in ``runs/``.

    Raises
    ------
    InputError
        If the folder that the user asks for holds something already.
    """
    if out is None:
        stamp = time.strftime("%Y-%m-%dT%H-%M-%S")
        return RunDirectory(_free(RUNS / f"{stamp}_{name}"), linked=True)
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out}: is a file; it must be a new or an empty folder")
    if out.is_dir() and any(out.iterdir()):
        raise InputError(f"--out {out}: is not empty; choose a new or an empty folder")
    return RunDirectory(out, linked=False)


def _free(path: Path) -> Path:
    """The path, or the first one numbered after it that is free: two runs may share a second."""
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_name(f"{path.name}-{number}")
    return free


def find_bag(path: Path) -> Path:
    """The recording's first file; `path` is that, or a run directory.

    Raises
    ------
    InputError
        If there is none.
    """
    bag = path / RECORDING if path.is_dir() else path
    if bag.is_file():
        return bag
    if path.is_dir():
        raise InputError(f"{path}: holds no recording: there is no {RECORDING} in it")
    why = "is no file" if path.exists() else "does not exist"
    raise InputError(f"{path}: the recording {why}")


def versions_text() -> str:
    """The same in a line."""
    return ", ".join(f"{name} {number}" for name, number in versions().items())


def versions() -> dict[str, str]:
    """Python and the packages that results and recordings depend on, by name."""
    return {
        "python": platform.python_version(),
        **{name: version(name) for name in VERSIONED_PACKAGES},
    }
