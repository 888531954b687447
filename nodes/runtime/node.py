"""A node as a value: ports, parameters and pure functions, with no socket in sight.

The same value runs as a process of its own, composed with others in one process, and under test as
plain calls. Its wiring is its place in a graph: its publishers and subscribers, and recorded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Annotated, Any, Literal, NamedTuple, Protocol

import msgspec
from msgspec import Meta

from palpate.core.steps import Steps, no_steps
from palpate.messages import Header
from palpate.messages.types import ParameterEvent

MAX_FINGERS = 8  # Fingers that one graph may have
HANDLER_TIMEOUT = 1.0  # A handler takes no longer than this, unless its node says otherwise, s
MAX_VALUE_CHARS = 1000  # Longest value, in JSON, that a parameter is set to while its node runs
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
    make: Callable[[Steps], object]  # Makes it, naming its steps; nothing it is bound to may change


class NotReadyError(ValueError):
    """A parameter cannot be set yet: the node does not know enough to judge it."""


def resolved(message: object) -> object:
    """A message of a handler as it is sent."""
    return message.make(no_steps) if isinstance(message, Deferred) else message


Outputs = list[tuple[str, object] | Finished]  # Topic and message, or `Deferred`, in their order
# ``(params, state, message) -> (state, outputs)``; changes none of its arguments.
Handler = Callable[[Any, Any, Any], tuple[Any, Outputs]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """What a node subscribes to, publishes and does."""

    params: type  # Type of the parameters: a frozen ``msgspec.Struct``
    start: Callable[[Any], tuple[Any, Outputs]]  # ``params -> (state, outputs)``, before any input
    inputs: Mapping[str, tuple[type, Handler]]  # Topic to message type and handler
    outputs: Mapping[str, type]  # Topic to message type
    needs: tuple[str, ...] = ()  # Latched inputs without which no other input is handed over
    fan_in: tuple[str, ...] = ()  # Inputs with one publisher in each finger's namespace
    optional: tuple[str, ...] = ()  # Inputs that nobody need publish
    # Topics that stay outside the fingers' namespaces: where there is such a node for each finger,
    # that of the first finger alone subscribes to and publishes them.
    shared: tuple[str, ...] = ()
    handler_timeout: float = HANDLER_TIMEOUT  # Longest time of a handler, s: then the node hangs
    step: str = ""  # What its work is called where time is told by steps; its name if left out
    # It acts on the world: when it is started again it is not handed once more what it has handled,
    # and begins with a fresh state; what it has published is kept in a file.
    has_side_effects: bool = False
    # Parameters that may be set while it runs, each with the input between two of whose messages
    # that is done: its handler alone may look at them. Told on an output of `ParameterEvent`.
    settable: Mapping[str, str] = field(default_factory=dict)
    # ``(params, state)``: refuses parameters that are to be set by a ValueError, by a
    # `NotReadyError` until something is known.
    check_set: Callable[[Any, Any], None] = lambda params, state: None

    def __post_init__(self) -> None:
        """Refuse settable parameters that no run could be repeated with."""
        for param, topic in self.settable.items():
            if param not in _fields_of(self.params) or topic not in self.inputs:
                raise ValueError(f"settable: {param!r} by {topic!r} is no parameter by an input")
        if self.settable and (self.has_side_effects or self.event_topic is None):
            raise ValueError("settable: the node must publish ParameterEvent and act on nothing")

    @property
    def event_topic(self) -> str | None:
        """The output on which it tells that a parameter was set; None if it has none."""
        return next((topic for topic, cls in self.outputs.items() if cls is ParameterEvent), None)


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
    step: str = "reading"  # As of a node
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

    def close(self, missing: Mapping[str, int]) -> None:
        """Finish, so that all can be read; by topic, the messages that were sent and never came."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sink:
    """A node that receives every reliable topic, undecoded, and publishes nothing: the recorder."""

    params: type  # Type of the parameters: a frozen ``msgspec.Struct``
    open: Callable[[Any, Mapping[str, str]], SinkWriter]  # ``(params, {topic: type}) -> writer``
    # The same after it was killed, with the messages of each topic that it has kept; without it the
    # sink cannot be started again.
    resume: Callable[[Any, Mapping[str, str]], tuple[SinkWriter, Mapping[str, int]]] | None = None
    handler_timeout: float = 10 * HANDLER_TIMEOUT  # Longest time that writing may take, s
    step: str = "recording"  # As of a node


AnyNode = Node | Source | Sink


def is_persistent(node: AnyNode) -> bool:
    """Whether what a node publishes comes from the world, and could not be published again."""
    if isinstance(node, Source):
        return not node.repeats
    return isinstance(node, Node) and node.has_side_effects


# What is done when a node dies: it is started again, the run ends, or it goes on without.
OnExit = Literal["restart", "stop", "ignore"]
RECORDER = "palpate.nodes.recorder"


@dataclass(frozen=True, slots=True)
class Input:
    """One edge of the graph, seen from its receiving end."""

    publisher: str  # Name of the node that publishes the topic
    topic: str  # The topic on the wire, with namespace and remapping applied
    local: str  # The topic as the node calls it
    type: str  # Name of the message type


@dataclass(frozen=True, slots=True, kw_only=True)
class Wiring:
    """Everything that a process must know to run its node."""

    name: str  # Name of the node in the graph
    module: str  # Module that holds ``NODE``, ``SOURCE`` or ``SINK``
    params: Any  # Parameters: an instance of the node's own type
    inputs: tuple[Input, ...]  # What it subscribes to
    outputs: Mapping[str, str]  # The topic as the node calls it, to the topic on the wire
    subscribers: Mapping[str, tuple[str, ...]]  # Topic on the wire to the names of its subscribers
    types: Mapping[str, str] = field(default_factory=dict)  # Topic on the wire to its message type
    # Name of each of these types that palpate does not have, to its JSON schema
    schemas: Mapping[str, str] = field(default_factory=dict)
    host: str = ""  # Address of the machine on which it runs; empty for the launcher's
    nice: int = 0  # How far its process stands back when the processor is busy, from 0 to 19
    on_exit: OnExit = "restart"  # What is done when it dies
    handler_timeout: float = HANDLER_TIMEOUT  # Longest time without a sign of life at work, s
    persistent: bool = False  # Whether what it publishes is kept beyond its death: it cannot again
    # Robot time that passes in a second where it tells what a robot has done; 0: it does not wait
    rate: float = 0.0


def with_parameter(params: Any, name: str, value: str) -> Any:
    """A node's parameters, one of them set to a value in JSON.

    Raises ValueError if there is no such parameter, or the value is none for it.
    """
    if len(value) > MAX_VALUE_CHARS:
        raise ValueError(f"{name}: {len(value)} characters are too many to be set while it runs")
    field = _fields_of(params)[name]
    try:
        made: Any = msgspec.json.decode(value, type=field.type)
        return msgspec.structs.replace(params, **{field.name: made})
    except (msgspec.MsgspecError, ValueError) as error:
        raise ValueError(f"{name} cannot be {value:.60}: {error}") from None


def _fields_of(params: Any) -> Mapping[str, msgspec.structs.FieldInfo]:
    return {one.encode_name: one for one in msgspec.structs.fields(params)}


def lone_wiring(
    params: Any, inputs: Iterable[Input], topics: Iterable[str], name: str = "node"
) -> Wiring:
    """The wiring of a node by itself, whose topics on the wire are called as it calls them."""
    outputs = {topic: topic for topic in topics}
    return Wiring(
        name=name, module="", params=params, inputs=tuple(inputs), outputs=outputs, subscribers={}
    )


def load_node(module: str) -> AnyNode:
    """The node that a module holds; ValueError if there is no such module or node."""
    if not all(part.isidentifier() for part in module.split(".")):
        raise ValueError(f"{module!r} is no name of a module")
    try:
        found = import_module(module)
    except ModuleNotFoundError as error:
        raise ValueError(f"no module {module!r}: {error}") from None
    for name in ("NODE", "SOURCE", "SINK"):
        value = getattr(found, name, None)
        if isinstance(value, (Node, Source, Sink)):
            return value
    raise ValueError(f"module {module!r} holds no NODE, no SOURCE and no SINK")


class RecordedNode(msgspec.Struct, frozen=True, kw_only=True):
    """One node's place in a graph that was recorded."""

    name: str
    module: str
    params: msgspec.Raw  # JSON of the node's own parameters
    inputs: tuple[Input, ...]
    outputs: dict[str, str]  # The topic as the node calls it, to the topic on the wire
    types: dict[str, str] = {}  # The topic on the wire to the name of its message type
    schemas: dict[str, str] = {}  # Of these types that palpate does not have, the JSON schema
    nice: int = 0
    on_exit: OnExit = "restart"

    def wiring(self, params: type) -> Wiring:
        """The node's wiring, given the type of its parameters.

        Raises ValueError if the recorded parameters are not of that type.
        """
        try:
            value: Any = msgspec.json.decode(self.params, type=params)
        except msgspec.DecodeError as error:
            text = f"the recorded parameters of {self.name} do not fit: {error}"
            raise ValueError(text) from None
        return Wiring(
            name=self.name,
            module=self.module,
            params=value,
            inputs=self.inputs,
            outputs=self.outputs,
            subscribers={},
            types=self.types,
            schemas=self.schemas,
            nice=self.nice,
            on_exit=self.on_exit,
        )


RECORDED = RecordedNode.__struct_fields__


def describe_wirings(wirings: Sequence[Wiring]) -> bytes:
    """Describe a graph in JSON, parameters included, for a recorder to keep."""
    return msgspec.json.encode([{name: getattr(one, name) for name in RECORDED} for one in wirings])


def recorded_nodes(graph: bytes) -> tuple[RecordedNode, ...]:
    """Read what `describe_wirings` wrote. Raises ValueError if it is no such description."""
    try:
        return msgspec.json.decode(graph, type=tuple[RecordedNode, ...])
    except msgspec.DecodeError as error:
        raise ValueError(f"this is no description of a graph: {error}") from None


def publishers_of(graph: bytes) -> Mapping[str, str]:
    """Topic on the wire to the node that publishes it; nothing of an empty description."""
    nodes = recorded_nodes(graph) if graph else ()
    return {topic: one.name for one in nodes for topic in one.outputs.values()}


def schemas_of(graph: bytes) -> Mapping[str, str]:
    """Name of each message type that palpate does not have, to its JSON schema."""
    nodes = recorded_nodes(graph) if graph else ()
    return {name: text for one in nodes for name, text in one.schemas.items()}


def with_description(wirings: Sequence[Wiring], about: Mapping[str, str]) -> tuple[Wiring, ...]:
    """The same graph, whose recorders have been given its description and other texts about it."""
    graph = describe_wirings(wirings)
    return tuple(
        replace(one, params=msgspec.structs.replace(one.params, graph=graph, about=dict(about)))
        if one.module == RECORDER
        else one
        for one in wirings
    )
