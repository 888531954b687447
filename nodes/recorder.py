"""Recorder: keeps every reliable message in one MCAP file, undecoded."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import msgspec

from palpate import __version__
from palpate.messages.recording.writer import RecordingWriter
from palpate.nodes.node import Sink
from palpate.nodes.recording import publishers_of


class Params(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    path: str
    """File to write; it must not exist."""
    graph: bytes = b""
    """Description of the graph, by `describe_wirings`; the launcher fills it in."""

    def __post_init__(self) -> None:
        """Refuse a path that names no file."""
        if not self.path or self.path.endswith("/"):
            raise ValueError(f"path must name a file, got {self.path!r}")


def start_recording(params: Params, types: Mapping[str, str]) -> RecordingWriter:
    """Create the file.

    Raises
    ------
    ValueError
        If a topic's type is unknown.
    OSError
        If the file exists or cannot be written.
    """
    about = {"version": __version__, "graph": params.graph.decode()}
    return RecordingWriter(Path(params.path), types, publishers_of(params.graph), about)


SINK = Sink(params=Params, open=start_recording)
