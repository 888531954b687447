"""Runs nodes again on what they had received, and compares what they publish.

A node is a pure function of its parameters and of its inputs in their order. So with the same
parameters it must publish the same, and with others the difference is what these parameters do.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from palpate.launch import Entry, Graph, counted, find_bag, override, text_table
from palpate.launch.files import SourceMapped, convert
from palpate.messages.recording import RecordedMessage, Recording, open_recording
from palpate.nodes.runtime import RecordedNode, Wiring, recorded_nodes
from palpate.tools.replay.comparison import ChangeKind, TopicComparison
from palpate.tools.replay.exchange import (
    MessageExchange,
    ReplayedNode,
    ReplayNode,
    Shortage,
    choose_nodes,
    in_order_of_sending,
)

CHANGE_COLUMNS = "topic", "field", "compared", "differ", "first", "largest", "rms", "unit"
UNIT_WORDS = {"#": "count"}
KIND_WORDS: dict[ChangeKind, str] = {
    "shape": "of another shape",
    "keys": "with other keys",
    "element": "elements changed",
    "value": "changed",
    "byte": "with other bytes",
}


def replay(
    bag: Path,
    nodes: Sequence[str] = (),
    echo: Callable[[str], None] = print,
    *,
    settings: Mapping[str, SourceMapped] | None = None,
) -> int:
    """Run nodes of a recording again, in lockstep and as fast as they can.

    What one of them publishes now is what the others receive; all else of the graph comes from the
    recording. `bag`: the recording, or the folder of its run; `nodes`: names of nodes in the
    recorded graph; all that can be replayed exactly if empty; `echo`: prints a line; `settings`:
    ``node.param`` to its value, laid over the recorded parameters. Returns 1 if a node raised, or
    if none was given another parameter and one did not publish the same, byte for byte; otherwise
    0. Raises ValueError if the recording cannot be read or lacks messages, or a node is unknown,
    cannot be replayed, or was recorded with other message types; InputError if a setting cannot be
    used.
    """
    recording = open_recording(find_bag(bag))
    chosen = with_settings(choose_nodes(recording, nodes), recording.graph, settings or {})
    players = [ReplayedNode(one) for one in chosen]
    if not recording.closed:
        echo(f"{recording.path} was never closed: replaying as far as it goes")
    exchange = MessageExchange(players)
    with threadpool_limits(limits=1):  # as when it was recorded: several threads round otherwise
        _feed(recording, exchange)
    for player in players:
        player.end(closed=recording.closed)
        echo(verdict(player))
    if recording.closed:
        for shortage in exchange.shortages():
            echo(shortage_text(shortage))
    for line in change_table(players):
        echo(line)
    failed = any(player.failure for player in players)
    return int(failed or (not settings and any(player.first for player in players)))


def with_settings(
    chosen: Sequence[ReplayNode], graph: bytes, settings: Mapping[str, SourceMapped]
) -> tuple[ReplayNode, ...]:
    """The nodes with parameters set as by ``palpate run --set``.

    `chosen`: the nodes that are run again; `graph`: description of the graph in which they ran;
    `settings`: ``node.param`` to its value. Raises InputError if a setting does not look like this,
    names a node that is not run again, or a parameter that it does not have, or has a value that is
    of the wrong type or out of range.
    """
    if not settings:
        return tuple(chosen)
    entries = [_entry(one.wiring) for one in chosen]
    _refuse_others(entries, graph, settings)
    laid = override(Graph(tuple(entries), ends=""), settings).entries
    return tuple(
        one._replace(wiring=_with_params(one, after)) if after.places else one
        for one, after in zip(chosen, laid, strict=True)
    )


def _refuse_others(
    entries: Sequence[Entry], graph: bytes, settings: Mapping[str, SourceMapped]
) -> None:
    """Refuse settings for nodes that ran, but are not run again."""
    others = [_entry(one) for one in recorded_nodes(graph)]
    again = {name for entry in entries for name in (entry.name, entry.group)}
    ran = {name for entry in others for name in (entry.name, entry.group)}
    for target, value in settings.items():
        node, _, param = target.partition(".")
        if param and node in ran - again:
            names = ", ".join(entry.name for entry in entries)
            raise value.error(
                (), f"{node!r} is not among the nodes to run again: {names}; add it to --nodes"
            )


def _entry(place: Wiring | RecordedNode) -> Entry:
    """The node as a launch file would describe it, in the namespace of its finger."""
    finger = f"finger_{place.name.rpartition('_')[2]}"
    within = any(topic.startswith(f"/{finger}/") for topic in place.outputs.values())
    return Entry(
        name=place.name,
        kind=place.module,
        params=place.params,
        namespace=finger if within else "",
    )


def _with_params(one: ReplayNode, entry: Entry) -> Wiring:
    params: Any = convert(entry.settings, one.node.params, entry.name)
    return replace(one.wiring, params=params)


def _feed(recording: Recording, exchange: MessageExchange) -> None:
    exchange.begin()
    sequence: dict[str, int] = {}
    for kept in in_order_of_sending(recording):
        _check_sequence(recording, sequence, kept)
        exchange.receive(kept)
    exchange.end()


def _check_sequence(recording: Recording, sequence: dict[str, int], kept: RecordedMessage) -> None:
    wanted = sequence.get(kept.topic, 0)
    if kept.seq != wanted:
        raise ValueError(
            f"recording {recording.path} lacks {kept.topic} {wanted}: it has {kept.seq} instead"
        )
    sequence[kept.topic] = wanted + 1


def verdict(player: ReplayedNode) -> str:
    """One line on a node: identical, its first difference, or how it failed."""
    if player.failure:
        return f"{player.name}: fails, {player.failure}"
    if player.first:
        return f"{player.name}: differs, {player.first}"
    counts = ", ".join(f"{one.compared} on {topic}" for topic, one in player.publications.items())
    return f"{player.name}: identical, {counts or 'nothing published'}"


def shortage_text(shortage: Shortage) -> str:
    """One line on a topic of which another number was received than had been recorded."""
    topic, publisher, listeners, fewer, more = shortage
    if fewer:
        missed = counted(fewer, "fewer message")
        told = f"{missed} on {topic} than recorded: {publisher} publishes no more"
    else:
        beyond = counted(more, "more message")
        told = f"{beyond} on {topic}, after those recorded: {publisher} publishes more"
    return f"{', '.join(listeners)}: received {told}"


def change_table(players: Sequence[ReplayedNode]) -> list[str]:
    """Lines of what has changed, by topic and field; none if nothing has."""
    rows = [row for player in players for one in player.publications.values() for row in _rows(one)]
    return text_table([CHANGE_COLUMNS, *rows], right=range(2, 7)) if rows else []


def _rows(one: TopicComparison) -> Iterator[tuple[str, ...]]:
    compared = str(one.compared)
    for field, change in one.changes.fields.items():
        sizes = (f"{change.largest:.3g}", f"{change.rms:.3g}") if change.numbers else ("", "")
        unit = UNIT_WORDS.get(change.unit, change.unit) if change.numbers else ""
        notes = "; ".join(
            f"{note.count} {KIND_WORDS[kind]}, first {note.then} -> {note.now}"
            for kind, note in change.notes.items()
        )
        told = "  ".join(filter(None, (unit, notes)))
        yield one.topic, field, compared, str(change.differ), str(change.first), *sizes, told
    if one.fewer or one.more:
        told = f"{one.fewer} fewer" if one.fewer else f"{one.more} more"
        yield one.topic, "messages", compared, "", compared, "", "", f"{told} than recorded"
