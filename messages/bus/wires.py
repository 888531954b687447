"""The sockets of one process: within one machine as they are, between machines locked."""

from __future__ import annotations

from typing import TYPE_CHECKING

import zmq

if TYPE_CHECKING:
    from palpate.messages.bus.curve import Gate

Socket = zmq.Socket[bytes]


class Wires:
    """Where sockets are made, closed in the end.

    Parameters
    ----------
    key : str
        File of the secret key; empty within one machine.

    Raises
    ------
    ValueError
        If the file holds no key that could be used.
    """

    def __init__(self, key: str = "") -> None:
        self.context: zmq.Context[Socket] = zmq.Context()
        """Where sockets are made; those that connect have the key already."""
        self._gate: Gate | None = None
        if key:
            from palpate.messages.bus.curve import Gate

            try:
                self._gate = Gate(self.context, key)
            except ValueError:
                self.context.term()
                raise

    def close(self) -> None:
        """Close the context; its sockets must have been closed."""
        if self._gate is not None:
            self._gate.close()
        self.context.term()

    def destroy(self) -> None:
        """Close whatever sockets are left at once, and the context."""
        if self._gate is not None:
            self._gate.close()
        self.context.destroy(linger=0)


def bind(socket: Socket, endpoint: str) -> None:
    """Bind a socket; beyond the files of this machine only with a key.

    Raises
    ------
    ValueError
        If others could reach it without a key.
    zmq.ZMQError
        If the address is taken or cannot be had.
    """
    if endpoint.startswith("tcp:"):
        _check_locked(socket, endpoint)
        socket.setsockopt(zmq.CURVE_SERVER, 1)
    socket.bind(endpoint)


def connect(socket: Socket, endpoint: str) -> None:
    """Connect a socket; beyond the files of this machine only with a key.

    Raises
    ------
    ValueError
        If others could read what is said.
    """
    if endpoint.startswith("tcp:"):
        _check_locked(socket, endpoint)
    socket.connect(endpoint)


def _check_locked(socket: Socket, endpoint: str) -> None:
    if socket.getsockopt(zmq.MECHANISM) != zmq.CURVE:
        raise ValueError(f"{endpoint} cannot be used without a key")
