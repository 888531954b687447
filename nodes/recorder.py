"""Recorder node: writes all reliable messages into one MCAP file, undecoded."""

from __future__ import annotations

import errno
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from palpate import __version__
from palpate.messages.recording import RecordingWriter, counts_of, part_path, parts_of
from palpate.nodes.runtime.node import Sink, publishers_of, schemas_of


class Params(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    path: str  # of the new file
    graph: bytes = b""  # description of the graph by `describe_wirings`, set by the launcher
    # Texts in the file by name; the launcher adds scene, launch file, seed and versions.
    about: dict[str, str] = {}
    # Free space on the disk below which the recording is closed [bytes].
    spare: Annotated[int, Meta(ge=0)] = 64 << 20

    def __post_init__(self) -> None:
        if not self.path or self.path.endswith("/"):
            raise ValueError(f"path must name a file, got {self.path!r}")


def start_recording(params: Params, types: Mapping[str, str]) -> RecordingWriter:
    """Create the file.

    Raises ValueError if a topic's type is unknown; OSError if the file exists or cannot be written.
    """
    further = part_path(Path(params.path), 1)
    if further.exists():
        raise FileExistsError(
            errno.EEXIST, f"recording {further} of another run exists already; remove it"
        )
    return _recording(params, types, Path(params.path))


def resume_recording(
    params: Params, types: Mapping[str, str]
) -> tuple[RecordingWriter, Mapping[str, int]]:
    """Continue in a further file; returns numbers of earlier messages by topic, too.

    Raises ValueError if a topic's type is unknown; OSError if the file cannot be written.
    """
    path = Path(params.path)
    had = counts_of(path)
    number = len(parts_of(path)) if path.exists() else 0
    return _recording(params, types, part_path(path, number)), had


def _recording(params: Params, types: Mapping[str, str], path: Path) -> RecordingWriter:
    graph = params.graph
    about = {**params.about, "version": __version__, "graph": graph.decode()}
    publishers, schemas = publishers_of(graph), schemas_of(graph)
    return RecordingWriter(path, types, publishers, about, params.spare, schemas)


SINK = Sink(params=Params, open=start_recording, resume=resume_recording)
