"""The graph as it is described: which nodes, with which parameters, and who ends it.

A launch file gives one, in YAML or in Python. It is checked whole before any process starts.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from palpate.launch.entry import Entry
from palpate.launch.located import InputError
from palpate.launch.nearest import hint
from palpate.launch.own_types import check_own_types, own_schema
from palpate.launch.placing import Placed, Publisher, is_left_out, place, publishers
from palpate.messages.types import Truth
from palpate.nodes.node import Node, Sink, Source, keeps
from palpate.nodes.wiring import Input, Wiring

__all__ = ["Entry", "Graph"]

MAY_HEAR_TRUTH = frozenset({f"palpate.nodes.{kind}" for kind in ("evaluator", "view", "recorder")})
"""Modules of the nodes that may know the true shape."""


@dataclass(frozen=True, slots=True)
class Graph:
    """Nodes, and the name of the one whose Finished ends them all."""

    entries: tuple[Entry, ...]
    """The nodes."""
    ends: str
    """Name of the node that ends the graph."""
    source: str = ""
    """``file:line`` at which `ends` is given."""

    def check(self) -> None:
        """Refuse a graph that could not run.

        Raises
        ------
        InputError
            With file and line where known: a name given twice, an unknown kind or parameter, a
            parameter of the wrong type or out of range, an input that nobody publishes, a topic
            with two publishers, types that differ, a node that may not hear the truth, an
            unknown `ends`.
        """
        self.wirings()

    def wirings(self) -> tuple[Wiring, ...]:
        """What each process must know; see `check` for what is refused."""
        placed = place(self.entries)
        said = publishers(placed)
        check_own_types(said)
        inputs = {one.entry.name: _inputs(one, said, placed) for one in placed}
        self._check_ends(placed)
        return tuple(
            Wiring(
                name=one.entry.name,
                module=one.entry.module,
                params=one.params,
                inputs=inputs[one.entry.name],
                outputs=dict(one.outputs),
                types={wire: one.types[local].__name__ for local, wire in one.outputs.items()},
                host=one.entry.host,
                nice=one.entry.nice,
                on_exit=one.entry.on_exit,
                longest=one.node.longest,
                keeps=keeps(one.node),
                listeners={topic: _listeners(topic, inputs) for topic in one.outputs.values()},
            )
            for one in placed
        )

    def topics(self) -> dict[str, type]:
        """Topic on the wire to the type of its messages."""
        return {topic: said.type for topic, said in publishers(place(self.entries)).items()}

    def table(self) -> str:
        """The resolved wiring, one topic a line."""
        wirings = self.wirings()
        types = self.topics()
        rows = [("topic", "type", "from", "to")]
        for wiring in wirings:
            for topic, listeners in wiring.listeners.items():
                rows.append((topic, types[topic].__name__, wiring.name, ", ".join(listeners)))
        widths = [max(len(row[i]) for row in rows) for i in range(3)]
        lines = ["  ".join((*map(str.ljust, row[:3], widths), row[3])).rstrip() for row in rows]
        return "\n".join((*lines, f"ends with the Finished of {self.ends}"))

    def _check_ends(self, placed: Iterable[Placed]) -> None:
        nodes = [one.entry.name for one in placed if not isinstance(one.node, Sink)]
        if self.ends not in nodes:
            where = f"{self.source}: " if self.source else ""
            raise InputError(
                f"{where}ends names {self.ends!r}, which is no node of the graph that could "
                f"finish; {hint(self.ends, nodes)}"
            )


def _listeners(topic: str, inputs: Mapping[str, tuple[Input, ...]]) -> tuple[str, ...]:
    return tuple(name for name, heard in inputs.items() if any(one.topic == topic for one in heard))


def _inputs(
    one: Placed, said: Mapping[str, Publisher], placed: Iterable[Placed]
) -> tuple[Input, ...]:
    if isinstance(one.node, Sink):
        found = [_input(one, topic, topic, said) for topic in said]
    elif isinstance(one.node, Source):
        found = []
    else:
        found = []
        for local, (wanted, _) in one.node.inputs.items():
            if is_left_out(one.entry, one.node, local):
                continue
            for topic in _sources(one.entry, one.node, local, said, placed):
                _check_type(one.entry, topic, wanted, said[topic])
                found.append(_input(one, topic, local, said))
    return tuple(found)


def _input(one: Placed, topic: str, local: str, said: Mapping[str, Publisher]) -> Input:
    heard = said[topic]
    # Judged by its type, so that no remapping smuggles the truth into the loop.
    if heard.type is Truth and one.entry.module not in MAY_HEAR_TRUTH:
        raise one.entry.error(
            f"hears {topic}, the true shape, which only an evaluator, a view or a recorder may; "
            "take this input away"
        )
    return Input(heard.placed.entry.name, topic, local, heard.type.__name__, own_schema(heard.type))


def _sources(
    entry: Entry,
    node: Node,
    local: str,
    said: Mapping[str, Publisher],
    placed: Iterable[Placed],
) -> list[str]:
    """Topics on the wire that an input hears: in the node's own namespace first, then outside.

    An input that is `many` hears the topic in every namespace.
    """
    if local in entry.remap:
        candidates = [entry.remap[local]]
    elif local in node.many:
        spaces = dict.fromkeys(other.entry.namespace for other in placed)
        candidates = [f"/{space}{local}" if space else local for space in spaces]
    else:
        candidates = [f"/{entry.namespace}{local}"] if entry.namespace else []
        candidates.append(local)
    found = [topic for topic in candidates if topic in said]
    if not found:
        near = hint(candidates[-1], said)
        raise entry.error(f"hears {candidates[-1]}, which nobody publishes; {near}")
    return found if local in node.many else found[:1]


def _check_type(entry: Entry, topic: str, wanted: type, heard: Publisher) -> None:
    if wanted is not heard.type:
        raise entry.error(
            f"hears {topic} as {wanted.__name__}, but {heard.placed.entry.name!r} publishes it "
            f"as {heard.type.__name__}"
        )
