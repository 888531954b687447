"""A sink that writes one line a message, and a last one when it is closed."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

import msgspec

from palpate.messages import Header
from palpate.nodes.runtime.node import Sink


class Params(msgspec.Struct, frozen=True, kw_only=True):
    path: str
    work: float = 0.0
    spoilt: bool = False


class Lines:
    def __init__(self, params: Params, topics: Mapping[str, str]) -> None:
        self._params = params
        self._file = Path(params.path).open("w", encoding="utf-8")  # noqa: SIM115
        self._file.write(f"open {sorted(topics.items())}\n")

    def write(self, topic: str, header: Header, body: bytes) -> None:
        if self._params.work:
            time.sleep(self._params.work)
        self._file.write(f"{topic} {header.seq} {len(body)}\n")

    def flush(self) -> None:
        self._file.flush()

    def close(self, missing: Mapping[str, int]) -> None:
        if self._params.spoilt:
            raise OSError("no space left on device")
        self._file.write("closed\n")
        self._file.close()


SINK = Sink(params=Params, open=Lines)
