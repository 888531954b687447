"""Formats of exported recordings; packages register further ones as entry points."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from palpate.tools.bag.decoding import DecodedRecording


class ExportFormat(NamedTuple):
    """A format into which a recording is written."""

    write: Callable[[DecodedRecording, Path], int]  # writes a new file or folder; returns a count
    counted: str  # plural of what is counted
    types: frozenset[str] = frozenset()  # names of types that it shows; empty: all
