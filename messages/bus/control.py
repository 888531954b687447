"""Control messages between nodes, launcher, tools and other machines.

They say which nodes are ready, when to start, and how much was consumed. A control message is a
msgpack map with a kind. For each kind of sender a table has the kinds of messages with their
fields.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Union

import msgspec
import zmq
from msgspec import Meta

from palpate.messages.bus.sockets import (
    DEFAULT_SOCKETS,
    Socket,
    SocketSettings,
    bind,
    connect,
    received,
)
from palpate.messages.codec import printable

MAX_CONTROL_BYTES = 1 << 20  # of a control message
MAX_CONTROL_ITEMS = 4096  # of a list or table
ControlMessage = dict[str, Any]
_write = msgspec.msgpack.Encoder().encode
_Count = Annotated[int, Meta(ge=0)]
_Few = Meta(max_length=MAX_CONTROL_ITEMS)
_Texts = Annotated[list[str], _Few]
_Addresses = Annotated[dict[str, str], _Few]  # of sockets by name


class ControlProtocol:
    """Kinds of messages that a sender may send, and the types of their fields."""

    def __init__(
        self, kinds: Mapping[str, Mapping[str, Any]], max_bytes: int = MAX_CONTROL_BYTES
    ) -> None:
        self._kinds, self.max_bytes = tuple(kinds), max_bytes
        options = {"tag_field": "kind", "forbid_unknown_fields": True}
        words = [
            msgspec.defstruct(kind, [*fields.items()], tag=kind, **options)  # type: ignore[arg-type]
            for kind, fields in kinds.items()
        ]
        self._read = msgspec.msgpack.Decoder(Union[tuple(words)]).decode  # noqa: UP007

    def read(self, data: bytes) -> ControlMessage:
        """The message in a frame.

        Raises ValueError if the frame holds no allowed message, or a message that lacks a field.
        """
        if len(data) > self.max_bytes:
            raise ValueError(f"a word has at most {self.max_bytes} bytes, got {len(data)}")
        try:
            word: Any = self._read(data)
        except (msgspec.MsgspecError, ValueError, RecursionError) as error:
            known = ", ".join(self._kinds)
            raise ValueError(f"not a word of {known}: {printable(str(error))}") from None
        return {"kind": word.__struct_config__.tag, **msgspec.structs.asdict(word)}


# Messages of the launcher to nodes; those with a ticket are requests of tools.
TO_NODES = ControlProtocol(
    {
        "go": {},
        "count": {"round": _Count},
        "stop": {},
        "pause": {"ticket": _Count},
        "resume": {"ticket": _Count},
        "step": {"number": _Count, "ticket": _Count},
        "publish": {"topic": str, "body": bytes, "ticket": _Count},
        "set": {"param": str, "value": str, "ticket": _Count},
    }
)


class ControlClient:
    """The end of a node, a tool or the launcher that connects to a server."""

    def __init__(
        self,
        context: zmq.Context[Socket],
        endpoint: str,
        *,
        name: str,
        accepts: ControlProtocol = TO_NODES,  # messages that it receives
        settings: SocketSettings = DEFAULT_SOCKETS,
    ) -> None:
        self._accepts = accepts
        self.socket = context.socket(zmq.DEALER)
        self.socket.setsockopt(zmq.IDENTITY, name.encode())
        self.socket.setsockopt(zmq.LINGER, settings.control_linger_ms)
        connect(self.socket, endpoint)

    def send(self, kind: str, **fields: Any) -> None:
        """Send a message to the launcher."""
        self.socket.send(_write({"kind": kind, **fields}))

    def receive(self) -> ControlMessage | None:
        """The next message of the launcher; None if there is none.

        Raises ValueError if it is no allowed message.
        """
        data = received(self.socket)
        return None if data is None else self._accepts.read(data)

    def close(self) -> None:
        """Close, once the last message has left."""
        self.socket.close()


# Messages of nodes to the launcher.
FROM_NODES = ControlProtocol(
    {
        "ready": {},
        "alive": {},
        "finished": {"reason": str},
        "count": {
            "round": _Count,
            "sent": Annotated[dict[str, _Count], _Few],
            "consumed": Annotated[list[tuple[str, str, _Count]], _Few],
            "waits": _Texts,
            "can_publish": bool,
        },
        "acknowledged": {"ticket": _Count},
        # Of a tool's request; `again`: it may be repeated soon.
        "refused": {"ticket": _Count, "text": str, "again": bool},
        "exiting": {"status": bytes},
        "failed": {"text": str, "trace": str},
    }
)


class ControlServer:
    """The end that binds, with one connection to each client."""

    def __init__(
        self,
        context: zmq.Context[Socket],
        endpoint: str,  # address to bind
        *,
        accepts: ControlProtocol = FROM_NODES,  # messages that it receives
    ) -> None:
        self._accepts = accepts
        self.socket = context.socket(zmq.ROUTER)
        self.socket.setsockopt(zmq.ROUTER_MANDATORY, 1)
        # A restarted node may connect before the end of its old connection is known.
        self.socket.setsockopt(zmq.ROUTER_HANDOVER, 1)
        self.socket.setsockopt(zmq.LINGER, 0)
        bind(self.socket, endpoint)

    def send(self, name: str, kind: str, **fields: Any) -> bool:
        """Send a message to a node; False if it cannot be reached."""
        data = _write({"kind": kind, **fields})
        try:
            self.socket.send_multipart([name.encode(), data], zmq.DONTWAIT)
        except zmq.ZMQError as error:
            if error.errno in (zmq.EHOSTUNREACH, zmq.EAGAIN):
                return False
            raise
        return True

    def receive(self) -> tuple[str, ControlMessage] | None:
        """The next message, with the name of its node; None if there is none.

        Raises ValueError if it is no allowed message.
        """
        try:
            parts = self.socket.recv_multipart(zmq.DONTWAIT)
        except zmq.Again:
            return None
        if len(parts) != 2:
            raise ValueError(f"a word has one part, got {len(parts) - 1}")
        return parts[0].decode(errors="replace"), self._accepts.read(parts[1])

    def close(self) -> None:
        """Close at once."""
        self.socket.close(0)


# Messages of tools to the launcher.
FROM_TOOLS = ControlProtocol(
    {
        "status": {},
        "pause": {"node": str},
        "resume": {"node": str},
        "step": {"node": str, "number": _Count},
        "publish": {"node": str, "topic": str, "body": bytes},
        "set": {"node": str, "param": str, "value": str},
    }
)
# Answers of the launcher.
TO_TOOLS = ControlProtocol(
    {
        "status": {"launcher": _Count, "for_s": float, "nodes": dict[str, Any]},
        "done": {},
        "not_ready": {"text": str},
        "refused": {"text": str},
    }
)
# Messages of the launcher to other machines; a node may have a large object in its parameters.
TO_HOSTS = ControlProtocol(
    {
        "hello": {"names": _Texts, "modules": _Texts},
        "spawn": {"node": str, "wiring": bytes, "place": bytes},
        "kill": {"node": str},
        "alive": {},
        "end": {},
    },
    max_bytes=256 << 20,
)
# Messages of other machines to the launcher.
FROM_HOSTS = ControlProtocol(
    {
        "hello": {"ns": _Count, "endpoints": _Addresses, "taps": _Addresses},
        "spawn_failed": {"node": str, "text": str},
        "ended": {"node": str, "code": int},
        "alive": {},
        "closed": {},
    }
)
