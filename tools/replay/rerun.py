"""Runs nodes again on what they had received, and compares what they publish.

A node is a pure function of its parameters and of its inputs in their order. So with the same
parameters it must publish the same, and with others the difference is what these parameters do.
An exploration goes on from its recording: every node is handed what it had received until then, in
the order in which it was sent, and publishes what it had published, without anybody receiving it.
From there the graph goes on, and comes to the same solid.
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
ConsumedAt = tuple[Consumed, int]  # What was sent to a node, and when, ns
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
    """Run nodes of a recording again, all that can be replayed exactly if none is named.

    What one of them publishes now is what the others receive; all else comes from the recording.
    `settings` are laid over the recorded parameters. `echo` is told of the differences in lines, or
    `as_json` in one text. Returns 1 if a node raised, or without settings if one did not publish
    the same, byte for byte; else 0. Raises ValueError if the recording cannot be read or lacks
    messages, or a node is unknown, cannot be replayed, or was recorded with other message types;
    InputError if a setting cannot be used.
    """
    recording = open_recording(find_bag(bag))
    chosen = with_settings(exchange.choose_nodes(recording, nodes), recording.graph, settings or {})
    events = [one for one in recording.messages() if one.type == ParameterEvent.__name__]
    players = [exchange.ReplayedNode(one, recorded_changes(events, *one)) for one in chosen]
    if not (recording.closed or as_json):
        echo(f"{recording.path} was never closed: replaying as far as it goes")
    traffic = exchange.MessageExchange(players)
    with threadpool_limits(limits=1):  # as when it was recorded: several threads round otherwise
        traffic.begin()
        sequence: dict[str, int] = {}
        for kept in exchange.in_order_of_sending(recording):
            wanted = sequence.get(kept.topic, 0)
            if kept.seq != wanted:
                raise ValueError(
                    f"recording {recording.path} lacks {kept.topic} {wanted}: it has {kept.seq} "
                    "instead"
                )
            sequence[kept.topic] = wanted + 1
            traffic.receive(kept)
        traffic.end()
    for player in players:
        player.end(closed=recording.closed)
    shortages = list(traffic.shortages()) if recording.closed else []
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


def with_settings(
    chosen: Sequence[exchange.ReplayNode], graph: bytes, settings: Mapping[str, SourceMapped]
) -> tuple[exchange.ReplayNode, ...]:
    """The nodes with parameters set as by ``palpate run --set``, in the graph in which they ran.

    Raises InputError if a setting does not look like this, or names a node that is not run again or
    a parameter that it lacks, or its value is of the wrong type or out of range.
    """
    if not settings:
        return tuple(chosen)
    entries = [_entry(one.wiring) for one in chosen]
    others = [_entry(one) for one in recorded_nodes(graph)]
    again = {name for entry in entries for name in (entry.name, entry.group)}
    ran = {name for entry in others for name in (entry.name, entry.group)}
    names = ", ".join(entry.name for entry in entries)
    for target, value in settings.items():
        node, _, param = target.partition(".")
        if param and node in ran - again:
            text = f"{node!r} is not among the nodes to run again: {names}; add it to --nodes"
            raise value.error((), text)
    laid = override(Graph(tuple(entries), ends=""), settings).entries
    found = list(chosen)
    for i, (one, entry) in enumerate(zip(chosen, laid, strict=True)):
        if entry.places:
            params: Any = convert(entry.settings, one.node.params, entry.name)
            found[i] = one._replace(wiring=replace(one.wiring, params=params))
    return tuple(found)


def _entry(place: Wiring | RecordedNode) -> Entry:
    """The node as a launch file would describe it, in the namespace of its finger."""
    finger = f"finger_{place.name.rpartition('_')[2]}"
    within = any(topic.startswith(f"/{finger}/") for topic in place.outputs.values())
    space = finger if within else ""
    return Entry(name=place.name, kind=place.module, params=place.params, namespace=space)


def replay_figures(
    recording: Recording,
    players: Sequence[exchange.ReplayedNode],
    shortages: Sequence[exchange.Shortage],
) -> dict[str, Any]:
    """What has changed, ready for JSON; a change that no float holds is None."""
    return {
        "recording": str(recording.path),
        "complete": recording.closed,
        "nodes": {
            player.name: {
                "failure": player.failure or None,
                "first_difference": player.first or None,
                "topics": {topic: one.figures() for topic, one in player.publications.items()},
            }
            for player in players
        },
        "shortages": [shortage._asdict() for shortage in shortages],
    }


def verdict(player: exchange.ReplayedNode) -> str:
    """What came of a node: identical, its first difference, or how it failed, in 80 columns."""
    told = _verdict(player)
    return "\n".join(titled(f"{player.name}:", told, width=len(player.name) + 2))


def _verdict(player: exchange.ReplayedNode) -> str:
    if player.failure:
        return f"fails, {player.failure}"
    if player.first:
        return f"differs, {player.first}"
    counts = ", ".join(f"{one.compared} on {topic}" for topic, one in player.publications.items())
    return f"identical, {counts or 'nothing published'}"


def shortage_text(shortage: exchange.Shortage) -> str:
    """One line on a topic of which another number was received than had been recorded."""
    topic, publisher, subscribers, fewer, more = shortage
    who = f"{', '.join(subscribers)}: received"
    if fewer:
        missed = counted(fewer, "fewer message")
        return f"{who} {missed} on {topic} than recorded: {publisher} publishes no more"
    beyond = counted(more, "more message")
    return f"{who} {beyond} on {topic}, after those recorded: {publisher} publishes more"


def change_table(players: Sequence[exchange.ReplayedNode]) -> list[str]:
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


def plan_resume(
    bag: Path, contour: int | None, *, nodes: Sequence[str] = (), out: Path | None = None
) -> Plan:
    """Plan to go on with an exploration after a contour, or after all that was recorded.

    `nodes` names those whose modules are not palpate's own, and may be imported. Raises ValueError
    if the recording cannot be read, does not say how it was made, has fewer contours, or a node
    cannot be loaded; InputError if the folder cannot be used.
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
            changes=_changes(wirings, recording),  # those after that contour, too
        ),
        demanded=demanded_of(wirings),
    )


def _wirings(recording: Recording, nodes: Sequence[str], path: Path) -> list[Wiring]:
    wirings = []
    for one in recorded_nodes(recording.graph):
        if not one.module.startswith(exchange.OWN_PACKAGE):
            if one.name not in nodes:
                raise ValueError(
                    f"recording {recording.path} wants module {one.module!r} for {one.name}, which "
                    f"is not palpate's own; name it if you trust it: --nodes {one.name}"
                )
            search_current_folder(f"{one.module}:NODE")
        node = load_node(one.module)
        wiring = one.wiring(node.params)
        if one.module == RECORDER:
            wiring = replace(wiring, params=msgspec.structs.replace(wiring.params, path=str(path)))
        timeout, persistent = node.handler_timeout, is_persistent(node)
        wirings.append(replace(wiring, handler_timeout=timeout, persistent=persistent))
    return wirings


def earlier_run_of(wirings: Sequence[Wiring], messages: Iterable[RecordedMessage]) -> EarlierRun:
    """What each node had received, and what it had published when, in the order of sending."""
    subscribers: dict[str, list[tuple[str, str]]] = {}
    publishers = {topic: one for one in wirings for topic in one.outputs.values()}
    received: dict[str, list[ConsumedAt]] = {one.name: [] for one in wirings}
    sent: dict[str, list[SentMessage]] = {one.name: [] for one in wirings if one.persistent}
    outside = defaultdict[str, list[OutsideMessage]](list)
    times: dict[str, list[tuple[str, int]]] = {
        one.name: [] for one in wirings if not one.persistent
    }
    for wiring in wirings:
        for edge in () if wiring.module == RECORDER else wiring.inputs:
            subscribers.setdefault(edge.topic, []).append((wiring.name, edge.publisher))
    for one in messages:
        for name, publisher in subscribers.get(one.topic, ()):
            received[name].append((Consumed(publisher, one.topic, one.seq), one.sent_ns))
        wiring = publishers[one.topic]
        if wiring.persistent:
            sent[wiring.name].append(
                SentMessage(one.topic, one.sent_ns, one.schema, one.body, one.outside)
            )
            continue
        times[wiring.name].append((one.topic, one.sent_ns))
        if one.outside:
            message = OutsideMessage(one.topic, one.seq, one.body, one.schema)
            outside[wiring.name].append(message)
    consumed = {
        one.name: answered_messages(one, received[one.name], sent[one.name])
        if one.persistent
        else [each for each, _ in received[one.name]]
        for one in wirings
    }
    return EarlierRun(consumed, sent, times, outside=outside)


def answered_messages(
    wiring: Wiring, received: Sequence[ConsumedAt], sent: Sequence[SentMessage]
) -> list[Consumed]:
    """What a node that acts had answered: each message by one of its own at least, in its order.

    What it needs before all else does not count, nor what it publishes before it is asked anything.
    """
    node = load_node(wiring.module)
    needs = node.needs if isinstance(node, Node) else ()
    latched = {one.topic for one in wiring.inputs if one.local in needs}
    asked = [(one, sent_ns) for one, sent_ns in received if one.topic not in latched]
    if not asked:
        return []
    answers = sum(one.sent_ns > asked[0][1] for one in sent if not one.outside)
    return [one for one, _ in asked[:answers]]


def _changes(wirings: Sequence[Wiring], recording: Recording) -> dict[str, list[ParameterEvent]]:
    """By node the parameters that were set while it ran."""
    publishers = {topic: one.name for one in wirings for topic in one.outputs.values()}
    found = defaultdict[str, list[ParameterEvent]](list)
    for kept in recording.messages():
        if kept.type == ParameterEvent.__name__ and not kept.outside:
            found[publishers[kept.topic]].append(decode(ParameterEvent, kept.body))
    return dict(found)


def _until(recording: Recording, contour: int | None) -> Iterable[RecordedMessage]:
    """All that was sent before a contour was known, that contour included."""
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
            f"recording {recording.path} has {known} contours, so none to go on from "
            f"after {contour}"
        )


def past_differences(bag: Path, run: Path) -> str:
    """What of the earlier run came out otherwise in the one that went on; empty if nothing did."""
    if not (run / RECORDING).exists():
        return ""
    found = compare_recordings(bag, run).topics.items()
    differ = [f"{topic} ({one.differ} of {one.compared})" for topic, one in found if one.differ]
    if not differ:
        return ""
    return (
        f"{', '.join(differ)} came out otherwise than recorded: other code, or other versions; "
        f"palpate bag diff {find_bag(bag)} {run} shows it"
    )
