"""Control messages between nodes, launcher, tools and other machines.

Who is ready, when to go, how much was consumed. A control message is a msgpack map with a kind;
what may be sent by whom, with which fields, stands in a table each.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import msgpack
import zmq

from palpate.messages.bus.sockets import Socket, bind, connect, received
from palpate.messages.codec import nesting_limit

LINGER_MS = 500  # A last message has this long to leave
MAX_CONTROL_BYTES = 1 << 20  # Longest control message
MAX_CONTROL_ITEMS = 4096  # Most entries of a list or map, and most of them in all
ControlMessage = dict[str, Any]
FieldCheck = Callable[[Any], bool]


class ControlProtocol(NamedTuple):
    """What somebody may send."""

    kinds: Mapping[str, Mapping[str, FieldCheck]]  # Kind of message to its fields and their checks
    max_bytes: int = MAX_CONTROL_BYTES


def _is_count(value: Any) -> bool:
    return type(value) is int and value >= 0


def _is(kind: type) -> FieldCheck:
    return lambda value: type(value) is kind


_is_text, _is_bytes, _is_truth = _is(str), _is(bytes), _is(bool)
_is_integer, _is_number, _is_map = _is(int), _is(float), _is(dict)
# What the launcher sends to nodes; what carries a ticket, a tool has asked for.
TO_NODES = ControlProtocol(
    {
        "go": {},
        "count": {"round": _is_count},
        "stop": {},
        "pause": {"ticket": _is_count},
        "resume": {"ticket": _is_count},
        "step": {"number": _is_count, "ticket": _is_count},
        "publish": {"topic": _is_text, "body": _is_bytes, "ticket": _is_count},
    }
)


class ControlClient:
    """The node's end."""

    def __init__(
        self,
        context: zmq.Context[Socket],
        endpoint: str,
        *,
        name: str,
        accepts: ControlProtocol = TO_NODES,  # What may be sent to it
    ) -> None:
        self._accepts = accepts
        self.socket = context.socket(zmq.DEALER)
        self.socket.setsockopt(zmq.IDENTITY, name.encode())
        self.socket.setsockopt(zmq.LINGER, LINGER_MS)
        connect(self.socket, endpoint)

    def send(self, kind: str, **fields: Any) -> None:
        """Send a message to the launcher."""
        self.socket.send(msgpack.packb({"kind": kind, **fields}))

    def receive(self) -> ControlMessage | None:
        """Return the launcher's next message, or None if there is none.

        Raises ValueError if what arrived is none of those.
        """
        data = received(self.socket)
        return None if data is None else read_control(data, self._accepts)

    def close(self) -> None:
        """Close, once the last message has left."""
        self.socket.close()


def _are_sent(value: Any) -> bool:
    """Topics, and how many messages were sent on each."""
    return type(value) is dict and all(_is_text(k) and _is_count(v) for k, v in value.items())


def _are_consumed(value: Any) -> bool:
    """Publishers, topics, and how many messages were consumed."""
    return type(value) is list and all(
        type(one) is list and len(one) == 3 and _are_texts(one[:2]) and _is_count(one[2])
        for one in value
    )


def _are_texts(value: Any) -> bool:
    return type(value) is list and all(map(_is_text, value))


# What nodes send to the launcher.
FROM_NODES = ControlProtocol(
    {
        "ready": {},
        "alive": {},
        "finished": {"reason": _is_text},
        "count": {
            "round": _is_count,
            "sent": _are_sent,
            "consumed": _are_consumed,
            "waits": _are_texts,
            "can_publish": _is_truth,
        },
        "acknowledged": {"ticket": _is_count},
        "exiting": {"status": _is_bytes},
        "failed": {"text": _is_text, "trace": _is_text},
    }
)


class ControlServer:
    """The launcher's end, with one line to each node."""

    def __init__(
        self,
        context: zmq.Context[Socket],
        endpoint: str,  # Address to bind
        *,
        accepts: ControlProtocol = FROM_NODES,  # What may be sent to it
    ) -> None:
        self._accepts = accepts
        self.socket = context.socket(zmq.ROUTER)
        self.socket.setsockopt(zmq.ROUTER_MANDATORY, 1)
        # A node that was started again speaks before its old line is known to be gone.
        self.socket.setsockopt(zmq.ROUTER_HANDOVER, 1)
        self.socket.setsockopt(zmq.LINGER, 0)
        bind(self.socket, endpoint)

    def send(self, name: str, kind: str, **fields: Any) -> bool:
        """Send a message to a node; False if it cannot be reached."""
        data = msgpack.packb({"kind": kind, **fields})
        try:
            self.socket.send_multipart([name.encode(), data], zmq.DONTWAIT)
        except zmq.ZMQError as error:
            if error.errno in (zmq.EHOSTUNREACH, zmq.EAGAIN):
                return False
            raise
        return True

    def receive(self) -> tuple[str, ControlMessage] | None:
        """Name of a node and its next message; None if there is none.

        Raises ValueError if what arrived is none of those.
        """
        try:
            parts = self.socket.recv_multipart(zmq.DONTWAIT)
        except zmq.Again:
            return None
        if len(parts) != 2:
            raise ValueError(f"a word has one part, got {len(parts) - 1}")
        return parts[0].decode(errors="replace"), read_control(parts[1], self._accepts)

    def close(self) -> None:
        """Close at once."""
        self.socket.close(0)


def read_control(data: bytes, language: ControlProtocol) -> ControlMessage:
    """Message in a frame.

    Raises ValueError if the frame holds none that may be sent, or one that lacks a field.
    """
    if len(data) > language.max_bytes:
        raise ValueError(f"a word has at most {language.max_bytes} bytes, got {len(data)}")
    count = nesting_limit(MAX_CONTROL_ITEMS)
    try:
        word = msgpack.unpackb(
            data,
            list_hook=count,
            object_hook=count,
            max_array_len=MAX_CONTROL_ITEMS,
            max_map_len=MAX_CONTROL_ITEMS,
            max_ext_len=0,
        )
    except (ValueError, RecursionError) as error:
        reason = f"{type(error).__name__}: {error!s:.100}"
        raise ValueError(f"a word is a map with a kind, got no msgpack: {reason}") from None
    if not isinstance(word, dict) or not isinstance(word.get("kind"), str):
        raise ValueError(f"a word is a map with a kind, got {len(data)} bytes of something else")
    fields = language.kinds.get(word["kind"])
    if fields is None:
        raise ValueError(f"a word is one of {', '.join(language.kinds)}, got {word['kind'][:40]!r}")
    if word.keys() != {"kind", *fields}:
        raise ValueError(f"the word {word['kind']} has the fields {', '.join(fields) or 'none'}")
    for name, check in fields.items():
        if not check(word[name]):
            raise ValueError(f"the word {word['kind']} has a {name} that cannot be one")
    return word


def _are_addresses(value: Any) -> bool:
    """Names, and the addresses of their sockets."""
    return type(value) is dict and all(map(_is_text, (*value, *value.values())))


# What tools send to the launcher.
FROM_TOOLS = ControlProtocol(
    {
        "status": {},
        "pause": {"node": _is_text},
        "resume": {"node": _is_text},
        "step": {"node": _is_text, "number": _is_count},
        "publish": {"node": _is_text, "topic": _is_text, "body": _is_bytes},
    }
)
# What the launcher answers.
TO_TOOLS = ControlProtocol(
    {
        "status": {"launcher": _is_count, "for_s": _is_number, "nodes": _is_map},
        "done": {},
        "not_ready": {"text": _is_text},
        "refused": {"text": _is_text},
    }
)
# What the launcher sends to other machines; a node may have a large object among its parameters.
TO_HOSTS = ControlProtocol(
    {
        "hello": {"names": _are_texts, "modules": _are_texts},
        "spawn": {"node": _is_text, "wiring": _is_bytes, "place": _is_bytes},
        "kill": {"node": _is_text},
        "alive": {},
        "end": {},
    },
    max_bytes=256 << 20,
)
# What other machines send to the launcher.
FROM_HOSTS = ControlProtocol(
    {
        "hello": {"ns": _is_count, "endpoints": _are_addresses, "taps": _are_addresses},
        "spawn_failed": {"node": _is_text, "text": _is_text},
        "ended": {"node": _is_text, "code": _is_integer},
        "alive": {},
        "closed": {},
    }
)
