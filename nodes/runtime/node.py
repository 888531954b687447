"""A node as a value: ports, parameters and pure functions, with no socket in sight.

The same value runs as a process of its own, composed with others in one process, and under test
as plain calls.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, Protocol

from msgspec import Meta

from palpate.messages import Header

MAX_FINGERS = 8  # Fingers that one graph may have
HANDLER_TIMEOUT = 1.0  # A handler takes no longer than this, unless its node says otherwise, s
Finger = Annotated[int, Meta(ge=1, le=MAX_FINGERS)]  # Number of a finger, or of fingers


@dataclass(frozen=True, slots=True)
class Finished:
    """An output that ends the graph, if the launch file says that this node may."""

    reason: str


@dataclass(frozen=True, slots=True)
class Deferred:
    """A message that takes long to make, and on which the node's state does not depend.

    A node that is started again publishes once more what it had published; such a message is made
    once more only if somebody lacks it.
    """

    cls: type  # Its type
    make: Callable[[], object]  # Makes it; of what it is bound to nothing may change


def resolved(message: object) -> object:
    """A message of a handler as it is sent."""
    return message.make() if isinstance(message, Deferred) else message


# Topic and message each, or `Deferred`, in the order in which they are published.
Outputs = list[tuple[str, object] | Finished]
# ``(params, state, message) -> (state, outputs)``; changes none of its arguments.
Handler = Callable[[Any, Any, Any], tuple[Any, Outputs]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """What a node subscribes to, publishes and does."""

    params: type  # Type of the parameters: a frozen ``msgspec.Struct``
    # ``params -> (state, outputs)``, called once before any input.
    start: Callable[[Any], tuple[Any, Outputs]]
    inputs: Mapping[str, tuple[type, Handler]]  # Topic to message type and handler
    outputs: Mapping[str, type]  # Topic to message type
    needs: tuple[str, ...] = ()  # Latched inputs without which no other input is handed over
    fan_in: tuple[str, ...] = ()  # Inputs with one publisher in each finger's namespace
    # Topics that stay outside the fingers' namespaces: where there is such a node for each finger,
    # that of the first finger alone subscribes to and publishes them.
    shared: tuple[str, ...] = ()
    # Longest time that a handler may take, s: after it, a node that is at work hangs.
    handler_timeout: float = HANDLER_TIMEOUT
    # It acts on the world: when it is started again it is not handed once more what it has handled,
    # and begins with a fresh state; what it has published is kept in a file.
    has_side_effects: bool = False


class Timed(NamedTuple):
    """What a source publishes, and when."""

    due: float  # Seconds after the source was opened; 0 publishes it at once
    topic: str  # The topic as the node calls it
    message: object  # A message, or bytes: a message's encoded body


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """A node without inputs: what it publishes comes from a file, or from the world outside."""

    params: type  # Type of the parameters: a frozen ``msgspec.Struct``
    outputs: Callable[[Any], Mapping[str, type]]  # ``params -> {topic: message type}``
    # ``params -> what it publishes``, one after the other; None says that there is nothing yet
    # and wants to be asked again soon. It never waits for longer than 0.1 s.
    open: Callable[[Any], Iterator[Timed | Finished | None]]
    # Whether it publishes the same when it is opened again, as a file does, and goes on behind
    # that; what comes from the world comes once.
    repeats: bool = True
    # ``params ->`` whether it stands still at the beginning until a tool has it go on.
    paused: Callable[[Any], bool] = lambda params: False
    outside: bool = False  # Whether tools may publish its topics
    handler_timeout: float = HANDLER_TIMEOUT  # Longest time that it may take for one message, s

    def __post_init__(self) -> None:
        """Refuse a source that could not publish again what tools had it publish."""
        if self.outside and self.repeats:
            raise ValueError(
                "a source that tools may publish for cannot repeat what they published"
            )


class SinkWriter(Protocol):
    """Where a sink puts what it receives."""

    def write(self, topic: str, header: Header, body: bytes) -> None:
        """Keep one message, undecoded."""

    def flush(self) -> None:
        """Put away what was written so far: nothing more has come for a while."""

    def close(
        self,
        missing: Mapping[str, int],  # Topics to the messages that were sent and never came
    ) -> None:
        """Finish, so that all that was written can be read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sink:
    """A node that receives every reliable topic, undecoded, and publishes nothing: the recorder."""

    params: type  # Type of the parameters: a frozen ``msgspec.Struct``
    # ``(params, {topic: name of its message type}) -> writer``.
    open: Callable[[Any, Mapping[str, str]], SinkWriter]
    # The same after it was killed, with the messages of each topic that it has kept; without it the
    # sink cannot be started again.
    resume: Callable[[Any, Mapping[str, str]], tuple[SinkWriter, Mapping[str, int]]] | None = None
    handler_timeout: float = 10 * HANDLER_TIMEOUT  # Longest time that writing may take, s


AnyNode = Node | Source | Sink


def is_persistent(node: AnyNode) -> bool:
    """Whether what a node publishes comes from the world, and could not be published again."""
    if isinstance(node, Source):
        return not node.repeats
    return isinstance(node, Node) and node.has_side_effects
