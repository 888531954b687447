"""The line between a node and the launcher: who is ready, when to go, how much was heard.

Tools speak to the launcher in the same way, and the launcher to other machines. The words
themselves are in `words`.
"""

from __future__ import annotations

from typing import Any

import msgpack
import zmq

from palpate.messages.bus.wires import bind, connect
from palpate.messages.bus.words import OF_LAUNCHER, OF_NODES, Language, Word, read_word

LINGER_MS = 500
"""A last word has this long to leave."""


class NodeLine:
    """The node's end.

    Parameters
    ----------
    context : zmq.Context
        Where the socket lives.
    endpoint : str
        Address of the launcher.
    name : str
        Name of the node.
    hears : Language
        What may be said to it.
    """

    def __init__(
        self,
        context: zmq.Context[zmq.Socket[bytes]],
        endpoint: str,
        *,
        name: str,
        hears: Language = OF_LAUNCHER,
    ) -> None:
        self._hears = hears
        self.socket = context.socket(zmq.DEALER)
        self.socket.setsockopt(zmq.IDENTITY, name.encode())
        self.socket.setsockopt(zmq.LINGER, LINGER_MS)
        connect(self.socket, endpoint)

    def send(self, kind: str, **fields: Any) -> None:
        """Say a word to the launcher."""
        self.socket.send(msgpack.packb({"kind": kind, **fields}))

    def receive(self) -> Word | None:
        """Return the launcher's next word, or None if there is none.

        Raises
        ------
        ValueError
            If what arrived is no word.
        """
        try:
            return read_word(self.socket.recv(zmq.DONTWAIT), self._hears)
        except zmq.Again:
            return None

    def close(self) -> None:
        """Close, once the last word has left."""
        self.socket.close()


class LauncherLine:
    """The launcher's end, with one line to each node.

    Parameters
    ----------
    context : zmq.Context
        Where the socket lives.
    endpoint : str
        Address to bind.
    hears : Language
        What may be said to it.
    """

    def __init__(
        self,
        context: zmq.Context[zmq.Socket[bytes]],
        endpoint: str,
        *,
        hears: Language = OF_NODES,
    ) -> None:
        self._hears = hears
        self.socket = context.socket(zmq.ROUTER)
        self.socket.setsockopt(zmq.ROUTER_MANDATORY, 1)
        # A node that was started again speaks before its old line is known to be gone.
        self.socket.setsockopt(zmq.ROUTER_HANDOVER, 1)
        self.socket.setsockopt(zmq.LINGER, 0)
        bind(self.socket, endpoint)

    def send(self, name: str, kind: str, **fields: Any) -> bool:
        """Say a word to a node; False if it cannot be reached."""
        word = msgpack.packb({"kind": kind, **fields})
        try:
            self.socket.send_multipart([name.encode(), word], zmq.DONTWAIT)
        except zmq.ZMQError as error:
            if error.errno in (zmq.EHOSTUNREACH, zmq.EAGAIN):
                return False
            raise
        return True

    def receive(self) -> tuple[str, Word] | None:
        """Name of a node and its next word; None if there is none.

        Raises
        ------
        ValueError
            If what arrived is no word.
        """
        try:
            parts = self.socket.recv_multipart(zmq.DONTWAIT)
        except zmq.Again:
            return None
        if len(parts) != 2:
            raise ValueError(f"a word has one part, got {len(parts) - 1}")
        return parts[0].decode(errors="replace"), read_word(parts[1], self._hears)

    def close(self) -> None:
        """Close at once."""
        self.socket.close(0)
