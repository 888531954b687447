"""A tool that looks on: it hears everything by the taps, until it is stopped or killed."""

from __future__ import annotations

import sys

import zmq

from palpate.messages.bus.tap import TapReader


def look_on(taps: list[str], topics: list[str]) -> None:
    """Hear all that is said; print one line as soon as there is something to hear."""
    with zmq.Context() as context:
        reader = TapReader(context, taps, topics)
        told = False
        while reader.socket.poll():
            if reader.receive() is not None and not told:
                print("heard", flush=True)
                told = True


if __name__ == "__main__":
    between = sys.argv.index("--")
    look_on(sys.argv[1:between], sys.argv[between + 1 :])
