"""Sockets of one process and addresses of a run: plain in one machine, locked between machines.

The lock is CURVE, with one key pair for all that may take part: who has the key may publish and
subscribe, nobody else; and nobody else can read what is published.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import zmq

Socket = zmq.Socket[bytes]
QUEUE_DEPTH = 1000  # Most messages in a queue between two nodes, unless the launch says otherwise
LAUNCHER = "launcher"  # Name under which the launcher subscribes; no node may bear it


class SocketContext:
    """Where sockets are made, closed in the end; with the key of a file, if one is named.

    Raises ValueError if the file holds no key that could be used.
    """

    def __init__(self, key: str = "") -> None:
        # Where sockets are made; those that connect have the key already
        self.context: zmq.Context[Socket] = zmq.Context()
        self._gate: CurveAuthenticator | None = None
        if key:
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


def received(socket: Socket) -> bytes | None:
    """What has arrived at a socket, or None; never waits."""
    try:
        return socket.recv(zmq.DONTWAIT)
    except zmq.Again:
        return None


def bind(socket: Socket, endpoint: str) -> None:
    """Bind a socket; beyond the files of this machine only with a key.

    ValueError if others could reach it without a key; zmq.ZMQError if the address is not free.
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
    """Close the socket and raise ValueError if it has no key."""
    if socket.getsockopt(zmq.MECHANISM) != zmq.CURVE:
        socket.close(linger=0)
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
    journals: Mapping[str, str]  # Node to the file in which it puts down what it consumes
    times: Mapping[str, str]  # Name of the node to the file of the times at which it published
    pasts: Mapping[str, str]  # Node to the file of what it published and does not remember
    key: str = ""  # File of the secret key that locks all sockets; empty within one machine
    ahead_ns: int = 0  # How far the launcher's clock is ahead of this machine's, ns
    going: bool = False  # Whether the graph had been started when this node was started again


class CurveAuthenticator:
    """Gives sockets that are made from now on the key of a file, and lets nobody in without it.

    Raises ValueError if the file holds no key that could be used.
    """

    def __init__(self, context: zmq.Context[Socket], key: str) -> None:
        from zmq.auth.thread import ThreadAuthenticator

        public, secret = read_key(Path(key))
        self._public = public
        self._guard = ThreadAuthenticator(context)
        self._guard.start()
        self._guard.configure_curve_callback("*", self)
        context.setsockopt(zmq.CURVE_PUBLICKEY, public)
        context.setsockopt(zmq.CURVE_SECRETKEY, secret)
        context.setsockopt(zmq.CURVE_SERVERKEY, public)

    def callback(self, domain: str, key: bytes) -> bool:
        """Whether a public key, in Z85, is let in."""
        return key == self._public

    def close(self) -> None:
        """Let nobody in any more."""
        self._guard.stop()


def make_key(path: Path) -> None:
    """Make a key file that only this user can read.

    Raises FileExistsError if there is one already: those who have it would be locked out; OSError
    if it cannot be written.
    """
    if path.exists():
        raise FileExistsError(f"key {path} exists already; it is not overwritten")
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    public, secret = (part.decode() for part in zmq.curve_keypair())
    path.touch(mode=0o600)
    path.write_text(f'curve\n    public-key = "{public}"\n    secret-key = "{secret}"\n')


def read_key(path: Path) -> tuple[bytes, bytes]:
    """Public and secret key of a file.

    Raises ValueError if it cannot be read or holds no key pair, or others may read it.
    """
    from zmq.auth import load_certificate

    try:
        shared = path.stat().st_mode & 0o077
        public, secret = load_certificate(path)
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise ValueError(f"key {path} cannot be used: {why}") from None
    try:
        is_pair = secret is not None and zmq.curve_public(secret) == public
    except (ValueError, zmq.ZMQError):
        is_pair = False
    if secret is None or not is_pair:
        raise ValueError(f"key {path} cannot be used: it holds no key pair")
    if shared:
        raise ValueError(f"key {path} can be read by others; run chmod 600 {path}")
    return public, secret
