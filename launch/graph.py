"""Description of a graph: its nodes, their parameters and topics, and the node that ends it.

A launch file gives one, in YAML or Python. Its parameters may be changed by settings. It is checked
whole before any process starts, and written to the run directory as it was resolved.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from msgspec import to_builtins

from palpate.core.plugins import entry_points_of
from palpate.launch.files.source_map import InputError, SourceMapped, hint, key_path, set_within
from palpate.launch.files.yaml_file import convert, parse_yaml, yaml_text
from palpate.launch.node_kinds import Entry, load_entry, search_current_folder
from palpate.launch.printing import text_table
from palpate.messages import CodecError, schema, schema_hash
from palpate.messages.bus import LAUNCHER
from palpate.messages.types import TYPES, GraspContacts, TactileFrame, Truth
from palpate.nodes.runtime.node import AnyNode, Input, Node, Sink, Source, Wiring, is_persistent

# Modules of the nodes that may subscribe to the true shape.
MAY_KNOW_TRUTH = frozenset({f"palpate.nodes.{kind}" for kind in ("evaluator", "view", "recorder")})
ROBOT_TYPES = {TactileFrame, GraspContacts}  # messages that a robot's motion makes
HOSTS = "palpate.hosts"  # entry points for other machines: `address` and `machines`
_NAME = re.compile(r"[a-z][a-z0-9_]{0,31}")
_TOPIC = re.compile(r"(/[a-z][a-z0-9_]*)+")


@dataclass(frozen=True, slots=True)
class Graph:
    """Nodes, and the name of the node whose Finished ends them all."""

    entries: tuple[Entry, ...]  # of the nodes
    ends: str  # name of the node that ends the graph
    source: str = ""  # ``file:line`` of `ends`
    rate: float = 0.0  # robot time per wall time; 0: as fast as it is computed

    def wirings(self) -> tuple[Wiring, ...]:
        """The wiring of each node.

        Raises InputError, with file and line where known, for a graph that cannot run: a repeated
        name, an unknown kind or parameter, a parameter of the wrong type or range, an input that no
        node publishes, a topic with two publishers or two types, a node that may not know the
        truth, an unknown `ends`.
        """
        placed = resolve_nodes(self.entries)
        published = publishers(placed)
        check_custom_types(published)
        inputs = {resolved.entry.name: _inputs(resolved, published, placed) for resolved in placed}
        self._check_ends(placed)
        return tuple(
            Wiring(
                name=resolved.entry.name,
                module=resolved.entry.module,
                host=resolved.entry.host,
                nice=resolved.entry.nice,
                on_exit=resolved.entry.on_exit,
                handler_timeout=resolved.node.handler_timeout,
                params=resolved.params,
                inputs=inputs[resolved.entry.name],
                outputs=dict(resolved.outputs),
                types={
                    wire: resolved.types[local].__name__ for local, wire in resolved.outputs.items()
                },
                schemas={
                    cls.__name__: json.dumps(schema(cls))
                    for local, cls in resolved.types.items()
                    if TYPES.get(cls.__name__) is not cls
                },
                persistent=is_persistent(resolved.node),
                rate=self.rate if ROBOT_TYPES.intersection(resolved.types.values()) else 0.0,
                subscribers={
                    topic: tuple(
                        name for name, its in inputs.items() if any(x.topic == topic for x in its)
                    )
                    for topic in resolved.outputs.values()
                },
            )
            for resolved in placed
        )

    def topics(self) -> dict[str, type]:
        """Types of the messages by topic on the wire."""
        return {
            topic: resolved.type
            for topic, resolved in publishers(resolve_nodes(self.entries)).items()
        }

    def links(self) -> list[dict[str, Any]]:
        """The resolved wiring: each topic with type, publisher and subscribers."""
        return [
            {
                "topic": topic,
                "type": resolved.types[topic],
                "from": resolved.name,
                "to": subscribers,
            }
            for resolved in self.wirings()
            for topic, subscribers in resolved.subscribers.items()
        ]

    def table(self) -> str:
        """The resolved wiring as lines of text, one for each topic."""
        rows = [
            (link["topic"], link["type"], link["from"], ", ".join(link["to"]))
            for link in self.links()
        ]
        lines = text_table([("topic", "type", "from", "to"), *rows])
        return "\n".join((*lines, f"ends with the Finished of {self.ends}"))

    def _check_ends(self, placed: Iterable[ResolvedNode]) -> None:
        nodes = [resolved.entry.name for resolved in placed if not isinstance(resolved.node, Sink)]
        if self.ends not in nodes:
            where = f"{self.source}: " if self.source else ""
            raise InputError(
                f"{where}ends names {self.ends!r}, which is no node of the graph that can finish; "
                f"{hint(self.ends, nodes)}"
            )


def publishers(placed: Iterable[ResolvedNode]) -> dict[str, Publisher]:
    """Publishers by topic on the wire; InputError if two nodes publish one topic."""
    publisher_of: dict[str, Publisher] = {}
    for resolved in placed:
        for local, topic in resolved.outputs.items():
            if topic in publisher_of:
                other = publisher_of[topic].resolved.entry.name
                raise resolved.entry.error(
                    f"publishes {topic}, which {other!r} publishes already; "
                    "put one into a namespace or remap the topic"
                )
            publisher_of[topic] = Publisher(resolved, resolved.types[local])
    return publisher_of


def check_custom_types(published: Mapping[str, Publisher]) -> None:
    """Refuse types that cannot be sent, or that have the name of another type in recordings."""
    named = dict(TYPES)
    for topic, publisher in published.items():
        cls = publisher.type
        try:
            schema(cls)
        except CodecError as error:
            raise publisher.resolved.entry.error(f"publishes {topic}: {error}") from None
        if not _is_same(named.setdefault(cls.__name__, cls), cls):
            other = named[cls.__name__]
            raise publisher.resolved.entry.error(
                f"publishes {topic} as {cls.__name__} of {cls.__module__}, but {other.__module__} "
                "has a type of that name; rename it"
            )


def _is_same(first: type, second: type) -> bool:
    """Whether two types are the same, or have the same name and schema as in a recording."""
    is_alike = first.__name__ == second.__name__ and TYPES.get(first.__name__) is None
    return first is second or (is_alike and schema_hash(first) == schema_hash(second))


def _inputs(
    resolved: ResolvedNode, published: Mapping[str, Publisher], placed: Iterable[ResolvedNode]
) -> tuple[Input, ...]:
    if isinstance(resolved.node, Sink):
        return tuple(_input(resolved, topic, topic, published[topic]) for topic in published)
    if isinstance(resolved.node, Source):
        return ()
    inputs = []
    for local, (wanted, _) in resolved.node.inputs.items():
        if is_left_out(resolved.entry, resolved.node, local):
            continue
        for topic in _sources(resolved.entry, resolved.node, local, published, placed):
            source = published[topic]
            if not _is_same(wanted, source.type):
                raise resolved.entry.error(
                    f"subscribes to {topic} as {wanted.__name__}, but "
                    f"{source.resolved.entry.name!r} publishes it as {source.type.__name__}"
                )
            inputs.append(_input(resolved, topic, local, source))
    return tuple(inputs)


def _input(resolved: ResolvedNode, topic: str, local: str, source: Publisher) -> Input:
    # The type is checked, not the topic, which may be remapped.
    if source.type is Truth and resolved.entry.module not in MAY_KNOW_TRUTH:
        raise resolved.entry.error(
            f"subscribes to {topic}, the true shape, which only an evaluator, a view or a recorder "
            "may; take this input away"
        )
    return Input(source.resolved.entry.name, topic, local, source.type.__name__)


def _sources(
    entry: Entry,
    node: Node,
    local: str,
    published: Mapping[str, Publisher],
    placed: Iterable[ResolvedNode],
) -> list[str]:
    """Topics on the wire of an input: of the node's own namespace, else outside.

    An input in `fan_in` subscribes to the topic in every namespace; one in `optional` may have no
    topic.
    """
    if local in entry.remap:
        candidates = [entry.remap[local]]
    elif local in node.fan_in:
        spaces = dict.fromkeys(other.entry.namespace for other in placed)
        candidates = [f"/{space}{local}" if space else local for space in spaces]
    else:
        candidates = [f"/{entry.namespace}{local}"] if entry.namespace else []
        candidates.append(local)
    topics = [topic for topic in candidates if topic in published]
    if not topics and (local in entry.remap or local not in node.optional):
        near = hint(candidates[-1], published)
        raise entry.error(f"subscribes to {candidates[-1]}, which no node publishes; {near}")
    return topics if local in node.fan_in else topics[:1]


@dataclass(frozen=True, slots=True)
class ResolvedNode:
    """An entry with its node."""

    entry: Entry
    node: AnyNode
    params: Any  # instance of the node's own parameter type
    types: Mapping[str, type]  # message types by the node's names of topics
    outputs: Mapping[str, str]  # topics on the wire by the node's names of topics


class Publisher(NamedTuple):
    """The node that publishes a topic, and the type of its messages."""

    resolved: ResolvedNode
    type: type


def resolve_nodes(entries: Iterable[Entry]) -> tuple[ResolvedNode, ...]:
    """The entries with their nodes; names, parameters and remappings are checked.

    Raises InputError if a name is taken or malformed, a kind or parameter is unknown, a parameter
    is of the wrong type or out of range, or the node does not have a remapped topic.
    """
    placed: dict[str, ResolvedNode] = {}
    for entry in entries:
        _check_name(entry, placed)
        if entry.host:
            _check_host(entry)
        node = load_entry(entry)
        params = _params(entry, node.params)
        types = _published_types(entry, node, params)
        _check_remap(entry, node, types)
        outputs = {topic: _resolved_topic(entry, node, topic) for topic in types}
        placed[entry.name] = ResolvedNode(entry, node, params, types, outputs)
    return tuple(placed.values())


def _check_host(entry: Entry) -> None:
    hosts = entry_points_of(HOSTS)
    if not hosts:
        raise entry.error("host needs palpate.launch.hosts, which is not installed")
    try:
        hosts["address"].load()(entry.host)
    except InputError as error:
        raise entry.error(str(error)) from None


def _check_name(entry: Entry, placed: Mapping[str, ResolvedNode]) -> None:
    rule = "a letter, then letters, digits and _, in lower case, at most 32"
    if not _NAME.fullmatch(entry.name):
        raise entry.error(f"the name must be {rule}")
    if entry.namespace and not _NAME.fullmatch(entry.namespace):
        raise entry.error(f"the namespace {entry.namespace!r} must be {rule}")
    if entry.name == LAUNCHER:
        raise entry.error("that is the name of the launcher; choose another")
    if entry.name in placed:
        first = placed[entry.name].entry.source
        raise entry.error(f"the name is taken{f' by {first}' if first else ''}; choose another")


def _params(entry: Entry, kind: type) -> Any:
    if isinstance(entry.params, kind):
        return entry.params
    if not isinstance(entry.params, Mapping):
        raise entry.error(f"params must be a map, got {entry.params!r:.60}")
    return convert(entry.settings, kind, entry.name)


def _published_types(entry: Entry, node: AnyNode, params: Any) -> Mapping[str, type]:
    if isinstance(node, Sink):
        return {}
    if isinstance(node, Node):
        outputs = node.outputs.items()
        return {topic: kind for topic, kind in outputs if not is_left_out(entry, node, topic)}
    try:
        return node.outputs(params)
    except ValueError as error:
        raise entry.error(str(error)) from None


def is_left_out(entry: Entry, node: Node, topic: str) -> bool:
    """Whether the node of the first finger uses this topic on behalf of all fingers."""
    return entry.finger > 1 and topic in node.shared


def _check_remap(entry: Entry, node: AnyNode, publications: Iterable[str]) -> None:
    # A topic that is left to the node of the first finger may be remapped for all fingers.
    known = (*node.inputs, *node.outputs) if isinstance(node, Node) else tuple(publications)
    for local, topic in entry.remap.items():
        if local not in known:
            raise entry.error(f"has no topic {local!r} to remap; {hint(local, known)}")
        if not _TOPIC.fullmatch(topic):
            raise entry.error(f"{local} cannot become {topic!r}; a topic looks like /touch/raw")


def _resolved_topic(entry: Entry, node: AnyNode, topic: str) -> str:
    if topic in entry.remap:
        return entry.remap[topic]
    shared = isinstance(node, Node) and topic in node.shared
    outside = not entry.namespace or (entry.finger and shared)
    return topic if outside else f"/{entry.namespace}{topic}"


def override(graph: Graph, settings: Mapping[str, SourceMapped]) -> Graph:
    """The graph with other values of parameters, by ``node.param``.

    Where each finger has such a node, the name without the number means all of them. Raises
    InputError if a setting has another form or names no node; the parameter itself is checked with
    the graph.
    """
    entries = {entry.name: entry for entry in graph.entries}
    groups: dict[str, list[str]] = {name: [name] for name in entries}
    for name, entry in entries.items():
        if entry.finger:
            groups.setdefault(entry.group, []).append(name)
    for target, value in settings.items():
        node, _, param = target.partition(".")
        if not param:
            raise value.error((), "must look like planner.tolerance=0.2e-3")
        if node not in groups:
            raise value.error((), f"there is no node {node!r}; {hint(node, groups)}")
        for name in groups[node]:
            entries[name] = _with_parameter(entries[name], param, value)
    return replace(graph, entries=tuple(entries.values()))


def _with_parameter(entry: Entry, param: str, value: SourceMapped) -> Entry:
    if isinstance(value.value, str):
        search_current_folder(value.value)  # a planner of one's own
    keys = key_path(f".{param}")
    params = set_within(to_builtins(entry.params, builtin_types=(bytes,)), keys, value)
    return replace(entry, params=params, places={**entry.places, keys: value.source})


def read_settings(texts: Iterable[str]) -> dict[str, SourceMapped]:
    """Settings of the command line, ``node.param=value`` each; the last of equal ones counts.

    Raises InputError if one has no ``=``, or a value that is not YAML.
    """
    settings = {}
    for text in texts:
        target, equals, value = text.partition("=")
        if not equals:
            raise InputError(f"--set {text}: must look like planner.tolerance=0.2e-3")
        settings[target] = _parsed(value, f"--set {text}")
    return settings


def read_arguments(texts: Iterable[str]) -> dict[str, SourceMapped]:
    """Arguments of a launch file from the command line, ``name:=value`` each.

    Raises InputError if one has no ``:=``, or a value that is not YAML.
    """
    arguments = {}
    for text in texts:
        name, sign, value = text.partition(":=")
        if not (sign and name):
            raise InputError(f"{text!r}: an argument must look like scene:=vase")
        arguments[name] = _parsed(value, text)
    return arguments


def _parsed(text: str, source: str) -> SourceMapped:
    return SourceMapped(parse_yaml(text, source).value, source)


def resolved_text(
    graph: Graph, wirings: Sequence[Wiring], out: Path, args: Mapping[str, Any] = {}
) -> str:
    """The graph as a launch file, with references replaced and defaults filled in.

    Paths in the run directory `out` begin with ``$(out)``, and a parameter with a mesh is the key
    of the scene, ``$(scene.object)``. `args`: the arguments of the file.
    """
    entries = {entry.name: entry for entry in graph.entries}
    nodes = {}
    for wiring in wirings:
        entry = entries[wiring.name]
        options = {key: getattr(entry, key) for key in ("remap", "namespace", "host", "nice")}
        options |= {"remap": dict(entry.remap), "on_exit": entry.on_exit.removeprefix("restart")}
        nodes[wiring.name] = {
            "kind": entry.kind or entry.name,
            "params": _portable_params(wiring.params, out),
            **{key: value for key, value in options.items() if value},
        }
    document = {"args": dict(args), "nodes": nodes, "ends": graph.ends, "rate": graph.rate}
    return yaml_text({key: value for key, value in document.items() if value})


def _portable_params(params: Any, out: Path) -> dict[str, Any]:
    """Parameters without the path of the run directory."""
    plain: dict[str, Any] = to_builtins(params, builtin_types=(bytes,))
    return {
        key: f"$(scene.{key})" if _holds_bytes(value) else _portable(value, str(out))
        for key, value in plain.items()
        if value != b""
    }


def _holds_bytes(value: Any) -> bool:
    if isinstance(value, dict):
        return any(map(_holds_bytes, value.values()))
    return isinstance(value, bytes)


def _portable(value: Any, out: str) -> Any:
    if isinstance(value, str) and value.startswith(f"{out}/"):
        return f"$(out){value.removeprefix(out)}"
    return list(value) if isinstance(value, tuple) else value


def plain_params(params: Any) -> Any:
    """The parameters of a node as plain values; bytes are shown as their number and SHA-256."""
    return _plain(to_builtins(params, builtin_types=(bytes,)))


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return f"{len(value)} bytes, sha256 {hashlib.sha256(value).hexdigest()}"
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, (list, tuple)) else value
