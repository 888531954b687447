"""What a format of exported recordings is; others are registered as entry points."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from palpate.tools.bag.decoding import DecodedRecording


class ExportFormat(NamedTuple):
    """A format into which a recording is written."""

    write: Callable[[DecodedRecording, Path], int]  # Writes a new file or folder; returns a count
    counted: str  # What is counted, in the plural
    types: frozenset[str] = frozenset()  # Names of the types that it shows; empty for all
