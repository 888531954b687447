"""Runs nodes again on the messages that they received, and compares what they publish.

A node is a pure function of its parameters and of its inputs in their order. So it publishes the
same with the same parameters, and the differences with other parameters are their effect. An
exploration is resumed from its recording: each node processes its received messages in the order of
sending, and publishes the same messages, which are not delivered. From there the graph continues,
and rebuilds the same solid.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
from threadpoolctl import threadpool_limits

from palpate.launch.demand import demanded_of
from palpate.launch.files.source_map import SourceMapped
from palpate.launch.files.yaml_file import convert
from palpate.launch.graph import Graph, override
from palpate.launch.node_kinds import Entry, search_current_folder
from palpate.launch.printing import counted, text_table, titled
from palpate.launch.processes.registry import EarlierRun, SentMessage
from palpate.launch.run import Plan
from palpate.launch.run_directory import RECORDING, choose_run_directory, find_bag, versions_text
from palpate.messages import decode, schema_hash
from palpate.messages.bus import Consumed, OutsideMessage
from palpate.messages.recording import RecordedMessage, Recording, open_recording
from palpate.messages.types import TYPES, Contour, ParameterEvent
from palpate.nodes.runtime.node import (
    RECORDER,
    Node,
    RecordedNode,
    Wiring,
    is_persistent,
    load_node,
    recorded_nodes,
    with_description,
)
from palpate.nodes.runtime.work import recorded_changes
from palpate.tools.bag.contents import compare_recordings
from palpate.tools.replay import exchange
from palpate.tools.replay.comparison import ChangeKind, TopicComparison

CONTOUR = Contour.__name__
ConsumedAt = tuple[Consumed, int]  # a message of a node, and its time of sending [ns]
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
    as_json: bool = False,
) -> int:
    """Run nodes of a recording again, or all that can be replayed exactly if none is named.

    The nodes receive what they publish to each other now, and other messages from the recording.
    `settings` override the recorded parameters. `echo` receives lines about the differences, or
    `as_json` one text. Returns 1 if a node raised, or, without settings, if one published other
    bytes; else 0. Raises ValueError if the recording cannot be read or lacks messages, or a node is
    unknown, cannot be replayed, or was recorded with other message types; InputError for a bad
    setting.
    """
    recording = open_recording(find_bag(bag))
    chosen = with_settings(exchange.choose_nodes(recording, nodes), recording.graph, settings or {})
    events = [kept for kept in recording.messages() if kept.type == ParameterEvent.__name__]
    players = [exchange.ReplayedNode(node, recorded_changes(events, *node)) for node in chosen]
    if not (recording.closed or as_json):
        echo(f"{recording.path} was never closed: replayed up to its end")
    shortages = _play(recording, players)
    if as_json:
        echo(json.dumps(replay_figures(recording, players, shortages), indent=2))
    else:
        for line in (
            *map(verdict, players),
            *map(shortage_text, shortages),
            *change_table(players),
        ):
            echo(line)
    failed = any(player.failure for player in players)
    return int(failed or (not settings and any(player.first for player in players)))


def _play(
    recording: Recording, players: Sequence[exchange.ReplayedNode]
) -> list[exchange.Shortage]:
    """Hand all recorded messages to the nodes; raises ValueError if the recording lacks some."""
    traffic = exchange.MessageExchange(players)
    with threadpool_limits(limits=1):  # as when recorded: several threads round differently
        traffic.begin()
        sequence: dict[str, int] = {}
        for kept in exchange.in_order_of_sending(recording):
            expected = sequence.get(kept.topic, 0)
            if kept.seq != expected:
                lacks = f"recording {recording.path} lacks {kept.topic} {expected}"
                raise ValueError(f"{lacks}: it has {kept.seq} instead")
            sequence[kept.topic] = expected + 1
            traffic.receive(kept)
        traffic.end()
    for player in players:
        player.end(closed=recording.closed)
    return list(traffic.shortages()) if recording.closed else []


def with_settings(
    chosen: Sequence[exchange.ReplayNode], graph: bytes, settings: Mapping[str, SourceMapped]
) -> tuple[exchange.ReplayNode, ...]:
    """Nodes with parameters set as by ``palpate run --set``, in the graph in which they ran.

    Raises InputError if a setting has another form, names a node that is not run again or a
    parameter that it lacks, or its value is of the wrong type or out of range.
    """
    if not settings:
        return tuple(chosen)
    entries = [_entry(node.wiring) for node in chosen]
    recorded = [*map(_entry, recorded_nodes(graph))]
    replayed = {name for entry in entries for name in (entry.name, entry.group)}
    ran = {name for entry in recorded for name in (entry.name, entry.group)}
    names = ", ".join(entry.name for entry in entries)
    for target, value in settings.items():
        node, _, param = target.partition(".")
        if param and node in ran - replayed:
            text = f"{node!r} is not among the nodes to run again: {names}; add it to --nodes"
            raise value.error((), text)
    changed = override(Graph(tuple(entries), ends=""), settings).entries
    nodes = list(chosen)
    for i, (again, entry) in enumerate(zip(chosen, changed, strict=True)):
        if entry.places:
            params: Any = convert(entry.settings, again.node.params, entry.name)
            nodes[i] = again._replace(wiring=replace(again.wiring, params=params))
    return tuple(nodes)


def _entry(node: Wiring | RecordedNode) -> Entry:
    """A node as in a launch file, in the namespace of its finger."""
    finger = f"finger_{node.name.rpartition('_')[2]}"
    is_of_finger = any(topic.startswith(f"/{finger}/") for topic in node.outputs.values())
    space = finger if is_of_finger else ""
    return Entry(name=node.name, kind=node.module, params=node.params, namespace=space)


def replay_figures(
    recording: Recording,
    players: Sequence[exchange.ReplayedNode],
    shortages: Sequence[exchange.Shortage],
) -> dict[str, Any]:
    """Differences as JSON values; a change beyond all floats is None."""
    return {
        "recording": str(recording.path),
        "complete": recording.closed,
        "nodes": {
            player.name: {
                "failure": player.failure or None,
                "first_difference": player.first or None,
                "topics": {topic: some.figures() for topic, some in player.publications.items()},
            }
            for player in players
        },
        "shortages": [shortage._asdict() for shortage in shortages],
    }


def verdict(player: exchange.ReplayedNode) -> str:
    """Result of a node in 80 columns: identical, its first difference, or its failure."""
    return "\n".join(titled(f"{player.name}:", _verdict(player), width=len(player.name) + 2))


def _verdict(player: exchange.ReplayedNode) -> str:
    if player.failure:
        return f"fails, {player.failure}"
    if player.first:
        return f"differs, {player.first}"
    counts = ", ".join(f"{some.compared} on {topic}" for topic, some in player.publications.items())
    return f"identical, {counts or 'nothing published'}"


def shortage_text(shortage: exchange.Shortage) -> str:
    """A line about a topic of which fewer or more messages were received than recorded."""
    topic, publisher, subscribers, fewer, more = shortage
    who = f"{', '.join(subscribers)}: received"
    if fewer:
        missed = counted(fewer, "fewer message")
        return f"{who} {missed} on {topic} than recorded: {publisher} publishes no more"
    beyond = counted(more, "more message")
    return f"{who} {beyond} on {topic}, after those recorded: {publisher} publishes more"


def change_table(players: Sequence[exchange.ReplayedNode]) -> list[str]:
    """Lines about the changes, by topic and field; empty without changes."""
    compared = [topic for player in players for topic in player.publications.values()]
    rows = [row for topic in compared for row in _rows(topic)]
    return text_table([CHANGE_COLUMNS, *rows], right=range(2, 7)) if rows else []


def _rows(topic: TopicComparison) -> Iterator[tuple[str, ...]]:
    compared = str(topic.compared)
    for field, change in topic.changes.fields.items():
        sizes = (f"{change.largest:.3g}", f"{change.rms:.3g}") if change.numbers else ("", "")
        unit = UNIT_WORDS.get(change.unit, change.unit) if change.numbers else ""
        notes = "; ".join(
            f"{note.count} {KIND_WORDS[kind]}, first {note.then} -> {note.now}"
            for kind, note in change.notes.items()
        )
        remark = "  ".join(filter(None, (unit, notes)))
        yield topic.topic, field, compared, str(change.differ), str(change.first), *sizes, remark
    if topic.fewer or topic.more:
        remark = f"{topic.fewer} fewer" if topic.fewer else f"{topic.more} more"
        yield topic.topic, "messages", compared, "", compared, "", "", f"{remark} than recorded"


def plan_resume(
    bag: Path, contour: int | None, *, nodes: Sequence[str] = (), out: Path | None = None
) -> Plan:
    """Plan to resume an exploration after a contour, or after all recorded messages.

    `nodes`: names of nodes with modules of a user that may be imported. Raises ValueError if the
    recording cannot be read, does not describe its graph, has fewer contours, or a node cannot be
    loaded; InputError if the folder cannot be used.
    """
    recording = open_recording(find_bag(bag))
    about = {key: text for key, text in recording.about.items() if key not in ("graph", "version")}
    if not recording.graph or "ends" not in about:
        raise ValueError(f"recording {recording.path} does not say which graph made it")
    name = about.get("scene_name", recording.path.stem)
    folder = choose_run_directory(name, out)
    wirings = _wirings(recording, nodes, folder.path / RECORDING)
    about["versions"] = versions_text()
    return Plan(
        name,
        with_description(wirings, about),
        about["ends"],
        about,
        folder,
        before=replace(
            earlier_run_of(wirings, _until(recording, contour)),
            changes=_changes(wirings, recording),  # also those after that contour
        ),
        demanded=demanded_of(wirings),
    )


def _wirings(recording: Recording, nodes: Sequence[str], path: Path) -> list[Wiring]:
    wirings = []
    for recorded in recorded_nodes(recording.graph):
        name, module = recorded.name, recorded.module
        if not module.startswith(exchange.OWN_PACKAGE):
            if name not in nodes:
                raise ValueError(
                    f"recording {recording.path} wants module {module!r} for {name}, which "
                    f"is not palpate's own; name it if you trust it: --nodes {name}"
                )
            search_current_folder(f"{module}:NODE")
        node = load_node(module)
        wiring = recorded.wiring(node.params)
        if module == RECORDER:
            wiring = replace(wiring, params=msgspec.structs.replace(wiring.params, path=str(path)))
        timeout, persistent = node.handler_timeout, is_persistent(node)
        wirings.append(replace(wiring, handler_timeout=timeout, persistent=persistent))
    return wirings


def earlier_run_of(wirings: Sequence[Wiring], messages: Iterable[RecordedMessage]) -> EarlierRun:
    """Messages that each node had received and published, in the order of sending."""
    persistent = {wiring.name for wiring in wirings if wiring.persistent}
    names = [wiring.name for wiring in wirings]
    subscribers: dict[str, list[tuple[str, str]]] = {}
    publishers = {topic: wiring.name for wiring in wirings for topic in wiring.outputs.values()}
    received: dict[str, list[ConsumedAt]] = {name: [] for name in names}
    sent: dict[str, list[SentMessage]] = {name: [] for name in names if name in persistent}
    times: dict[str, list[tuple[str, int]]] = {name: [] for name in names if name not in persistent}
    outside = defaultdict[str, list[OutsideMessage]](list)
    for wiring in wirings:
        for edge in () if wiring.module == RECORDER else wiring.inputs:
            subscribers.setdefault(edge.topic, []).append((wiring.name, edge.publisher))
    for kept in messages:
        topic, sent_ns = kept.topic, kept.sent_ns
        for name, publisher in subscribers.get(topic, ()):
            received[name].append((Consumed(publisher, topic, kept.seq), sent_ns))
        publisher = publishers[topic]
        if publisher in persistent:
            message = SentMessage(topic, sent_ns, kept.schema, kept.body, kept.outside)
            sent[publisher].append(message)
            continue
        times[publisher].append((topic, sent_ns))
        if kept.outside:
            outside[publisher].append(OutsideMessage(topic, kept.seq, kept.body, kept.schema))
    consumed = {
        wiring.name: answered_messages(wiring, received[wiring.name], sent[wiring.name])
        if wiring.persistent
        else [message for message, _ in received[wiring.name]]
        for wiring in wirings
    }
    return EarlierRun(consumed, sent, times, outside=outside)


def answered_messages(
    wiring: Wiring, received: Sequence[ConsumedAt], sent: Sequence[SentMessage]
) -> list[Consumed]:
    """Messages that a node that acts had answered, each by at least one of its own.

    Neither messages that it needs before all others count, nor what it published before its first
    request.
    """
    node = load_node(wiring.module)
    needs = node.needs if isinstance(node, Node) else ()
    latched = {edge.topic for edge in wiring.inputs if edge.local in needs}
    requests = [(message, at) for message, at in received if message.topic not in latched]
    if not requests:
        return []
    answers = sum(message.sent_ns > requests[0][1] for message in sent if not message.outside)
    return [message for message, _ in requests[:answers]]


def _changes(wirings: Sequence[Wiring], recording: Recording) -> dict[str, list[ParameterEvent]]:
    """Parameters that were set during the run, by node."""
    publishers = {topic: wiring.name for wiring in wirings for topic in wiring.outputs.values()}
    changes = defaultdict[str, list[ParameterEvent]](list)
    for kept in recording.messages():
        if kept.type == ParameterEvent.__name__ and not kept.outside:
            changes[publishers[kept.topic]].append(decode(ParameterEvent, kept.body))
    return dict(changes)


def _until(recording: Recording, contour: int | None) -> Iterable[RecordedMessage]:
    """Messages up to the first `contour` contours, or all."""
    known = 0
    for kept in exchange.in_order_of_sending(recording):
        cls = TYPES.get(kept.type)
        if cls is not None and schema_hash(cls) != kept.schema:
            raise ValueError(f"{kept.topic} was recorded with another version of {kept.type}")
        yield kept
        known += kept.type == CONTOUR
        if known == contour:
            return
    if contour is not None:
        raise ValueError(
            f"recording {recording.path} has {known} contours, so none to resume after {contour}"
        )


def past_differences(bag: Path, run: Path) -> str:
    """Text about topics that differ in the resumed run from the recording; empty without any."""
    if not (run / RECORDING).exists():
        return ""
    topics = compare_recordings(bag, run).topics.items()
    differ = [f"{name} ({diff.differ} of {diff.compared})" for name, diff in topics if diff.differ]
    if not differ:
        return ""
    return (
        f"{', '.join(differ)} differ from the recording: other code, or other versions; "
        f"palpate bag diff {find_bag(bag)} {run} shows it"
    )
