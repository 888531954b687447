"""Sockets of one process and addresses of a run: plain in one machine, encrypted between machines.

The encryption is CURVE, with one key pair for all machines of a graph: only processes with the key
can publish, subscribe, and read messages.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import zmq

Socket = zmq.Socket[bytes]
DEFAULT_QUEUE_DEPTH = 1000  # messages in a queue between two nodes
LAUNCHER = "launcher"  # name by which the launcher subscribes; no node may have it


@dataclass(frozen=True, slots=True, kw_only=True)
class SocketSettings:
    """Times and sizes of the sockets of one process."""

    reconnect_ms: int = 5  # between attempts to reconnect to a publisher [ms]
    send_timeout: float = 10.0  # after which a sender with a full queue fails [s]
    blocked_poll_ms: int = 10  # between attempts to send with a full queue [ms]
    linger_ms: int = 1000  # that queued messages have to leave when a socket is closed [ms]
    control_linger_ms: int = 500  # the same for control messages [ms]
    zero_copy_size: int = 1 << 16  # from which on frames are sent without a copy [bytes]


DEFAULT_SOCKETS = SocketSettings()


class SocketContext:
    """The context in which sockets are made, with the key of a file if one is named.

    Raises ValueError if the file holds no usable key.
    """

    def __init__(self, key: str = "") -> None:
        self.context: zmq.Context[Socket] = zmq.Context()
        self._gate: CurveAuthenticator | None = None
        if key:
            try:
                self._gate = CurveAuthenticator(self.context, key)
            except ValueError:
                self.context.term()
                raise

    def close(self) -> None:
        """Close the context, whose sockets are closed already."""
        if self._gate is not None:
            self._gate.close()
        self.context.term()

    def destroy(self) -> None:
        """Close all sockets at once, and the context."""
        if self._gate is not None:
            self._gate.close()
        self.context.destroy(linger=0)


def received(socket: Socket) -> bytes | None:
    """The next frame at a socket; None if there is none. It never waits."""
    try:
        return socket.recv(zmq.DONTWAIT)
    except zmq.Again:
        return None


def bind(socket: Socket, endpoint: str) -> None:
    """Bind a socket; an address of the network needs a key.

    Raises ValueError if it has no key; zmq.ZMQError if the address is not free.
    """
    if endpoint.startswith("tcp:"):
        _check_locked(socket, endpoint)
        socket.setsockopt(zmq.CURVE_SERVER, 1)
    socket.bind(endpoint)


def connect(socket: Socket, endpoint: str) -> None:
    """Connect a socket; an address of the network needs a key.

    Raises ValueError if it has no key.
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

    run: int  # number of the run, 64 bits
    epoch: int  # number of earlier starts of this node
    depth: int  # maximum number of messages in a queue between two nodes
    endpoints: Mapping[str, str]  # addresses of reliable topics by node
    taps: Mapping[str, str]  # addresses of taps by node
    control: str  # address at which the launcher listens to nodes
    tools: str  # address at which the launcher answers tools
    journals: Mapping[str, str]  # files of consumed messages by node
    times: Mapping[str, str]  # files of the times of published messages by node
    pasts: Mapping[str, str]  # files of published messages that exceed the memory, by node
    key: str = ""  # file of the secret key; empty within one machine
    ahead_ns: int = 0  # by which the launcher's clock is ahead of this machine's [ns]
    going: bool = False  # whether the graph was running when this node was started


class CurveAuthenticator:
    """Gives new sockets the key of a file, and refuses connections without it.

    Raises ValueError if the file holds no usable key.
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
        """Whether a public key, in Z85, is accepted."""
        return key == self._public

    def close(self) -> None:
        """Stop authenticating."""
        self._guard.stop()


def make_key(path: Path) -> None:
    """Write a new key file that only this user can read.

    Raises FileExistsError if the file exists: owners of the old key would be locked out; OSError if
    it cannot be written.
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
        is_shared = path.stat().st_mode & 0o077
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
    if is_shared:
        raise ValueError(f"key {path} can be read by others; run chmod 600 {path}")
    return public, secret
