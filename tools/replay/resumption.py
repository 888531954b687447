"""Goes on with an exploration from its recording: what was touched is not touched again.

Every node is handed what it had received until then, in the order in which it was sent, and
publishes what it had published, without anybody receiving it. From there the graph goes on, and
comes to the same solid.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import msgspec

from palpate.launch import (
    RECORDING,
    Plan,
    choose_run_directory,
    find_bag,
    search_current_folder,
    versions_text,
)
from palpate.launch.processes import EarlierRun, SentMessage
from palpate.messages import schema_hash
from palpate.messages.bus import Consumed
from palpate.messages.recording import RecordedMessage, Recording, open_recording
from palpate.messages.types import TYPES, Contour
from palpate.nodes.runtime import (
    RECORDER,
    AnyNode,
    Node,
    RecordedNode,
    Wiring,
    is_persistent,
    load_node,
    recorded_nodes,
    with_description,
)
from palpate.tools.bag import compare_recordings
from palpate.tools.replay.exchange import OWN_PACKAGE, in_order_of_sending

CONTOUR = Contour.__name__
ConsumedAt = tuple[Consumed, int]  # What was sent to a node, and when, ns


def plan_resume(
    bag: Path, contour: int | None, *, nodes: Sequence[str] = (), out: Path | None = None
) -> Plan:
    """Plan to go on with a recorded exploration.

    `bag`: the recording, or the folder of its run; `contour`: the last contour of which is known;
    None for all that was recorded; `nodes`: names of nodes whose modules are not palpate's own, and
    may be imported; `out`: the new run directory. Raises ValueError if the recording cannot be
    read, does not say how it was made, has fewer contours, or a node cannot be loaded; InputError
    if the folder cannot be used.
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
        before=earlier_run_of(wirings, _until(recording, contour)),
    )


def _wirings(recording: Recording, nodes: Sequence[str], path: Path) -> list[Wiring]:
    wirings = []
    for one in recorded_nodes(recording.graph):
        node = _load(recording, one, nodes)
        wiring = one.wiring(node.params)
        if one.module == RECORDER:
            params = msgspec.structs.replace(wiring.params, path=str(path))
            wiring = replace(wiring, params=params)
        wirings.append(
            replace(wiring, handler_timeout=node.handler_timeout, persistent=is_persistent(node))
        )
    return wirings


def _load(recording: Recording, one: RecordedNode, nodes: Sequence[str]) -> AnyNode:
    if not one.module.startswith(OWN_PACKAGE):
        if one.name not in nodes:
            raise ValueError(
                f"recording {recording.path} wants module {one.module!r} for {one.name}, which is "
                f"not palpate's own; name it if you trust it: --nodes {one.name}"
            )
        search_current_folder(f"{one.module}:NODE")
    return load_node(one.module)


def earlier_run_of(wirings: Sequence[Wiring], messages: Iterable[RecordedMessage]) -> EarlierRun:
    """What each node had received, and what it had published when, in the order of sending."""
    listeners: dict[str, list[tuple[str, str]]] = {}
    speaker = {topic: one for one in wirings for topic in one.outputs.values()}
    heard: dict[str, list[ConsumedAt]] = {one.name: [] for one in wirings}
    spoken: dict[str, list[SentMessage]] = {one.name: [] for one in wirings if one.persistent}
    times: dict[str, list[tuple[str, int]]] = {
        one.name: [] for one in wirings if not one.persistent
    }
    for wiring in wirings:
        for edge in () if wiring.module == RECORDER else wiring.inputs:
            listeners.setdefault(edge.topic, []).append((wiring.name, edge.publisher))
    for one in messages:
        for name, publisher in listeners.get(one.topic, ()):
            heard[name].append((Consumed(publisher, one.topic, one.seq), one.sent_ns))
        wiring = speaker[one.topic]
        if wiring.persistent:
            said = SentMessage(one.topic, one.sent_ns, one.schema, one.body)
            spoken[wiring.name].append(said)
        else:
            times[wiring.name].append((one.topic, one.sent_ns))
    consumed = {
        one.name: answered_messages(one, heard[one.name], spoken[one.name])
        if one.persistent
        else [each for each, _ in heard[one.name]]
        for one in wirings
    }
    return EarlierRun(consumed, spoken, times)


def answered_messages(
    wiring: Wiring, heard: Sequence[ConsumedAt], said: Sequence[SentMessage]
) -> list[Consumed]:
    """What a node that acts had answered: each message by one of its own at least, in its order.

    What it needs before all else does not count, nor what it publishes before it is asked anything.
    """
    node = load_node(wiring.module)
    needs = node.needs if isinstance(node, Node) else ()
    latched = {one.topic for one in wiring.inputs if one.local in needs}
    asked = [(one, sent_ns) for one, sent_ns in heard if one.topic not in latched]
    if not asked:
        return []
    answers = sum(one.sent_ns > asked[0][1] for one in said)
    return [one for one, _ in asked[:answers]]


def _until(recording: Recording, contour: int | None) -> Iterable[RecordedMessage]:
    """All that was sent before a contour was known, that contour included."""
    left = contour
    for kept in in_order_of_sending(recording):
        cls = TYPES.get(kept.type)
        if cls is not None and schema_hash(cls) != kept.schema:
            raise ValueError(f"{kept.topic} was recorded with another version of {kept.type}")
        yield kept
        if left is not None and kept.type == CONTOUR:
            left -= 1
            if left == 0:
                return
    if left is not None:
        assert contour is not None
        raise ValueError(
            f"recording {recording.path} has {contour - left} contours, so none to go on from "
            f"after {contour}"
        )


def past_differences(bag: Path, run: Path) -> str:
    """What of the earlier run came out otherwise, in a sentence; empty if nothing did.

    `bag`: the earlier recording, or the folder of its run; `run`: the run directory of the run that
    went on with it.
    """
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
