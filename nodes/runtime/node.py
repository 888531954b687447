"""Nodes as values: topics, parameters and pure functions, without sockets.

The same value runs in a process, composed with others in one process, and in tests by plain calls.
A wiring is the place of a node in a graph, with its publishers and subscribers.
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

MAX_FINGERS = 8  # of a graph
DEFAULT_HANDLER_TIMEOUT = 1.0  # processor time of a handler, beyond which its node hangs [s]
MAX_VALUE_CHARS = 1000  # of the JSON text of a parameter that is set while its node runs
Finger = Annotated[int, Meta(ge=1, le=MAX_FINGERS)]  # number of a finger, or of fingers


@dataclass(frozen=True, slots=True)
class Finished:
    """An output that ends the graph, if the launch file allows it for this node."""

    reason: str


@dataclass(frozen=True, slots=True)
class Deferred:
    """A message that takes long to make, and on which the node's state does not depend.

    A restarted node makes such a message again only if a subscriber lacks it.
    """

    cls: type  # of the message
    make: Callable[[Steps], object]  # makes it with named steps; its arguments must not change


class NotReadyError(ValueError):
    """A parameter cannot be set yet, since the node cannot check it."""


def resolved(message: object) -> object:
    """A message of a handler, made if it is deferred."""
    return message.make(no_steps) if isinstance(message, Deferred) else message


Outputs = list[tuple[str, object] | Finished]  # topics and messages, or `Deferred`
# ``(params, state, message) -> (state, outputs)``; it does not change its arguments.
Handler = Callable[[Any, Any, Any], tuple[Any, Outputs]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """The inputs, outputs and handlers of a node."""

    params: type  # of the parameters: a frozen ``msgspec.Struct``
    start: Callable[[Any], tuple[Any, Outputs]]  # ``params -> (state, outputs)``, before any input
    inputs: Mapping[str, tuple[type, Handler]]  # message type and handler by topic
    outputs: Mapping[str, type]  # message types by topic
    needs: tuple[str, ...] = ()  # latched inputs that are handled before all others
    fan_in: tuple[str, ...] = ()  # inputs with a publisher in each finger's namespace
    optional: tuple[str, ...] = ()  # inputs that need no publisher
    # Topics outside the fingers' namespaces: of the nodes of several fingers, only that of the
    # first finger subscribes to and publishes them.
    shared: tuple[str, ...] = ()
    handler_timeout: float = DEFAULT_HANDLER_TIMEOUT  # beyond which the node hangs [s]
    step: str = ""  # name of its work in times by step; the name of the node if empty
    # Whether it acts on the world: after a restart it has a new state, and handles no message
    # again; its published messages are kept in a file.
    has_side_effects: bool = False
    # Parameters that may be set while it runs, each with an input: it is set between two messages
    # of this input, and only its handler may use it. Published on an output of `ParameterEvent`.
    settable: Mapping[str, str] = field(default_factory=dict)
    # ``(params, state)``: raises ValueError for parameters that cannot be set, `NotReadyError` if
    # they cannot be set yet.
    check_set: Callable[[Any, Any], None] = lambda params, state: None

    def __post_init__(self) -> None:
        """Raise ValueError for settable parameters with which a run cannot be repeated."""
        for param, topic in self.settable.items():
            if param not in _fields_of(self.params) or topic not in self.inputs:
                raise ValueError(f"settable: {param!r} by {topic!r} is no parameter by an input")
        if self.settable and (self.has_side_effects or self.event_topic is None):
            raise ValueError("settable: the node must publish ParameterEvent and act on nothing")

    @property
    def event_topic(self) -> str | None:
        """The output on which it publishes changes of parameters; None if it has none."""
        return next((topic for topic, cls in self.outputs.items() if cls is ParameterEvent), None)


class Timed(NamedTuple):
    """A message of a source with its time."""

    due: float  # time after the source was opened [s]; 0: at once
    topic: str  # node's name of the topic
    message: object  # a message, or its encoded body


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """A node without inputs, which publishes messages of a file or of the outside world."""

    params: type  # of the parameters: a frozen ``msgspec.Struct``
    outputs: Callable[[Any], Mapping[str, type]]  # ``params -> {topic: message type}``
    # ``params -> messages``, one by one; None if there is no message yet. It never waits for longer
    # than 0.1 s.
    open: Callable[[Any], Iterator[Timed | Finished | None]]
    # Whether it repeats its messages when it is opened again, as a file; messages of the outside
    # world come once.
    repeats: bool = True
    # ``params ->`` whether it is paused at the beginning until a tool resumes it.
    paused: Callable[[Any], bool] = lambda params: False
    outside: bool = False  # whether tools may publish its topics
    step: str = "reading"  # as of a node
    handler_timeout: float = DEFAULT_HANDLER_TIMEOUT  # for one message [s]

    def __post_init__(self) -> None:
        """Raise ValueError for a source that cannot repeat messages of tools."""
        if self.outside and self.repeats:
            raise ValueError(
                "a source that tools may publish for cannot repeat what they published"
            )


class SinkWriter(Protocol):
    """Writes the messages of a sink."""

    def write(self, topic: str, header: Header, body: bytes) -> None:
        """Write a message, undecoded."""

    def flush(self) -> None:
        """Save the messages so far, after a while without new ones."""

    def close(self, missing: Mapping[str, int]) -> None:
        """Finish the file; `missing`: numbers of messages that never arrived, by topic."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sink:
    """A node that receives all reliable topics, undecoded, and publishes nothing: the recorder."""

    params: type  # of the parameters: a frozen ``msgspec.Struct``
    open: Callable[[Any, Mapping[str, str]], SinkWriter]  # ``(params, {topic: type}) -> writer``
    # The same after it was killed, with numbers of written messages by topic; without it the sink
    # cannot be restarted.
    resume: Callable[[Any, Mapping[str, str]], tuple[SinkWriter, Mapping[str, int]]] | None = None
    handler_timeout: float = 10 * DEFAULT_HANDLER_TIMEOUT  # for writing [s]
    step: str = "recording"  # as of a node


AnyNode = Node | Source | Sink


def is_persistent(node: AnyNode) -> bool:
    """Whether the messages of a node come from the world, and cannot be made again."""
    if isinstance(node, Source):
        return not node.repeats
    return isinstance(node, Node) and node.has_side_effects


# Reaction to the death of a node: restart it, stop the run, or continue without it.
OnExit = Literal["restart", "stop", "ignore"]
RECORDER = "palpate.nodes.recorder"


@dataclass(frozen=True, slots=True)
class Input:
    """An edge of the graph at its subscriber."""

    publisher: str  # name of the publishing node
    topic: str  # on the wire, with namespace and remapping
    local: str  # node's name of the topic
    type: str  # name of the message type


@dataclass(frozen=True, slots=True, kw_only=True)
class Wiring:
    """All facts that a process needs to run its node."""

    name: str  # in the graph
    module: str  # with ``NODE``, ``SOURCE`` or ``SINK``
    params: Any  # instance of the node's own parameter type
    inputs: tuple[Input, ...]  # subscriptions
    outputs: Mapping[str, str]  # topics on the wire by the node's names of topics
    subscribers: Mapping[str, tuple[str, ...]]  # names by topic on the wire
    types: Mapping[str, str] = field(default_factory=dict)  # message types by topic on the wire
    schemas: Mapping[str, str] = field(default_factory=dict)  # of types that are not palpate's
    host: str = ""  # address of its machine; empty: that of the launcher
    nice: int = 0  # of its process, 0 to 19: larger values leave the processor to others
    on_exit: OnExit = "restart"
    handler_timeout: float = DEFAULT_HANDLER_TIMEOUT  # beyond which the node hangs [s]
    persistent: bool = False  # whether its messages survive its death: it cannot make them again
    rate: float = 0.0  # robot time per wall time of its messages; 0: no delay


def with_parameter(params: Any, name: str, value: str) -> Any:
    """A node's parameters with one of them set to a value in JSON.

    Raises ValueError if the value does not suit the parameter.
    """
    if len(value) > MAX_VALUE_CHARS:
        raise ValueError(f"{name}: {len(value)} characters are too many to be set while it runs")
    field = _fields_of(params)[name]
    try:
        decoded: Any = msgspec.json.decode(value, type=field.type)
        return msgspec.structs.replace(params, **{field.name: decoded})
    except (msgspec.MsgspecError, ValueError) as error:
        raise ValueError(f"{name} cannot be {value:.60}: {error}") from None


def _fields_of(params: Any) -> Mapping[str, msgspec.structs.FieldInfo]:
    return {item.encode_name: item for item in msgspec.structs.fields(params)}


def lone_wiring(
    params: Any, inputs: Iterable[Input], topics: Iterable[str], name: str = "node"
) -> Wiring:
    """The wiring of a single node, with its own names of topics."""
    outputs = {topic: topic for topic in topics}
    return Wiring(
        name=name, module="", params=params, inputs=tuple(inputs), outputs=outputs, subscribers={}
    )


def load_node(module: str) -> AnyNode:
    """The node in a module; ValueError if there is no such module or node."""
    if not all(part.isidentifier() for part in module.split(".")):
        raise ValueError(f"{module!r} is no name of a module")
    try:
        loaded = import_module(module)
    except ModuleNotFoundError as error:
        raise ValueError(f"no module {module!r}: {error}") from None
    for name in ("NODE", "SOURCE", "SINK"):
        value = getattr(loaded, name, None)
        if isinstance(value, (Node, Source, Sink)):
            return value
    raise ValueError(f"module {module!r} holds no NODE, no SOURCE and no SINK")


class RecordedNode(msgspec.Struct, frozen=True, kw_only=True):
    """Place of a node in a recorded graph."""

    name: str
    module: str
    params: msgspec.Raw  # parameters in JSON
    inputs: tuple[Input, ...]
    outputs: dict[str, str]  # topics on the wire by the node's names of topics
    types: dict[str, str] = {}  # names of message types by topic on the wire
    schemas: dict[str, str] = {}  # JSON schemas of types that are not palpate's
    nice: int = 0
    on_exit: OnExit = "restart"

    def wiring(self, params: type) -> Wiring:
        """The node's wiring, with the type of its parameters.

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
    """Description of a graph in JSON, with parameters, for recordings."""
    return msgspec.json.encode([{name: getattr(w, name) for name in RECORDED} for w in wirings])


def recorded_nodes(graph: bytes) -> tuple[RecordedNode, ...]:
    """The nodes in a description of `describe_wirings`; ValueError if it is none."""
    try:
        return msgspec.json.decode(graph, type=tuple[RecordedNode, ...])
    except msgspec.DecodeError as error:
        raise ValueError(f"this is no description of a graph: {error}") from None


def publishers_of(graph: bytes) -> Mapping[str, str]:
    """Publishing nodes by topic on the wire; empty for an empty description."""
    nodes = recorded_nodes(graph) if graph else ()
    return {topic: node.name for node in nodes for topic in node.outputs.values()}


def schemas_of(graph: bytes) -> Mapping[str, str]:
    """JSON schemas of message types that are not palpate's, by name."""
    nodes = recorded_nodes(graph) if graph else ()
    return {name: text for node in nodes for name, text in node.schemas.items()}


def with_description(wirings: Sequence[Wiring], about: Mapping[str, str]) -> tuple[Wiring, ...]:
    """The same graph with its description, and texts about it, in the parameters of recorders."""
    graph = describe_wirings(wirings)
    return tuple(
        replace(w, params=msgspec.structs.replace(w.params, graph=graph, about=dict(about)))
        if w.module == RECORDER
        else w
        for w in wirings
    )
