"""Sockets of one process and addresses of a run: plain in one machine, locked between machines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import zmq

Socket = zmq.Socket[bytes]
QUEUE_DEPTH = 1000  # Most messages in a queue between two nodes, unless the launch says otherwise
LAUNCHER = "launcher"  # Name under which the launcher subscribes; no node may bear it


class SocketContext:
    """Where sockets are made, closed in the end.

    Raises ValueError if the file holds no key that could be used.
    """

    def __init__(
        self,
        key: str = "",  # File of the secret key; empty within one machine
    ) -> None:
        # Where sockets are made; those that connect have the key already
        self.context: zmq.Context[Socket] = zmq.Context()
        self._gate: CurveAuthenticator | None = None
        if key:
            from palpate.messages.bus.curve import CurveAuthenticator

            try:
                self._gate = CurveAuthenticator(self.context, key)
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

    Raises ValueError if others could reach it without a key; zmq.ZMQError if the address is taken
    or cannot be had.
    """
    if endpoint.startswith("tcp:"):
        _check_locked(socket, endpoint)
        socket.setsockopt(zmq.CURVE_SERVER, 1)
    socket.bind(endpoint)


def connect(socket: Socket, endpoint: str) -> None:
    """Connect a socket; beyond the files of this machine only with a key.

    Raises ValueError if others could read what is published.
    """
    if endpoint.startswith("tcp:"):
        _check_locked(socket, endpoint)
    socket.connect(endpoint)


def _check_locked(socket: Socket, endpoint: str) -> None:
    if socket.getsockopt(zmq.MECHANISM) != zmq.CURVE:
        raise ValueError(f"{endpoint} cannot be used without a key")


@dataclass(frozen=True, slots=True, kw_only=True)
class Addresses:
    """The addresses of one run, the same for all its nodes."""

    run: int  # Number of the run, 64 bits
    epoch: int  # Counts the starts of this node
    depth: int  # Most messages in a queue between two nodes
    endpoints: Mapping[str, str]  # Name of the node to the address of its reliable topics
    taps: Mapping[str, str]  # Name of the node to the address of its tap
    control: str  # Address at which the launcher listens to the nodes
    tools: str  # Address at which the launcher answers tools
    # Name of the node to the file in which it puts down what it consumes.
    journals: Mapping[str, str]
    times: Mapping[str, str]  # Name of the node to the file of the times at which it published
    # Name of the node to the file in which it keeps what it published and has no memory for.
    pasts: Mapping[str, str]
    # File of the secret key with which all sockets are locked; empty within one machine.
    key: str = ""
    ahead_ns: int = 0  # How far the launcher's clock is ahead of this machine's, ns
    going: bool = False  # Whether the graph had been started when this node was started again
