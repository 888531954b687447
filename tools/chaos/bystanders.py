"""Beside a graph that is tried: a node that floods it, and a program that looks on.

The source publishes as fast as it can what nobody needs. The tool subscribes to everything by the
taps, until it is stopped or killed.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import zmq
from msgspec import Struct

from palpate.messages.bus import TapReader
from palpate.messages.types import Clock
from palpate.nodes.runtime import Source, Timed


class FloodParams(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    messages: int = 100_000  # How much it says


def _flood(params: FloodParams) -> Iterator[Timed]:
    return (Timed(0.0, "/flood", Clock(time=1e-3 * number)) for number in range(params.messages))


def listen_to_taps(taps: list[str], topics: list[str]) -> None:
    """Receive all that is published; print one line as soon as something has come."""
    with zmq.Context() as context:
        reader = TapReader(context, taps, topics)
        told = False
        while reader.socket.poll():
            if reader.receive() is not None and not told:
                print("heard", flush=True)
                told = True


SOURCE = Source(params=FloodParams, outputs=lambda params: {"/flood": Clock}, open=_flood)


if __name__ == "__main__":
    between = sys.argv.index("--")
    listen_to_taps(sys.argv[1:between], sys.argv[between + 1 :])
