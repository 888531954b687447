"""What the nodes of a recording had heard and said: with that they go on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from palpate.launch.processes.before import Before, Spoken
from palpate.messages.bus.journal import Consumed
from palpate.messages.recording.reader import Kept
from palpate.nodes.node import Node
from palpate.nodes.recording import RECORDER
from palpate.nodes.wiring import Wiring, load_node

Heard = tuple[Consumed, int]
"""What was sent to a node, and when, ns."""


def before_of(wirings: Sequence[Wiring], messages: Iterable[Kept]) -> Before:
    """What each node had heard, and what it had said when, in the order of sending.

    Parameters
    ----------
    wirings : sequence of Wiring
        The nodes; a recorder writes all of it anew.
    messages : iterable of Kept
        The messages that had been sent, by the time of sending.
    """
    listeners: dict[str, list[tuple[str, str]]] = {}
    speaker = {topic: one for one in wirings for topic in one.outputs.values()}
    heard: dict[str, list[Heard]] = {one.name: [] for one in wirings}
    spoken: dict[str, list[Spoken]] = {one.name: [] for one in wirings if one.keeps}
    times: dict[str, list[tuple[str, int]]] = {one.name: [] for one in wirings if not one.keeps}
    for wiring in wirings:
        for edge in () if wiring.module == RECORDER else wiring.inputs:
            listeners.setdefault(edge.topic, []).append((wiring.name, edge.publisher))
    for one in messages:
        for name, publisher in listeners.get(one.topic, ()):
            heard[name].append((Consumed(publisher, one.topic, one.seq), one.sent_ns))
        wiring = speaker[one.topic]
        if wiring.keeps:
            said = Spoken(one.topic, one.sent_ns, one.schema, one.body)
            spoken[wiring.name].append(said)
        else:
            times[wiring.name].append((one.topic, one.sent_ns))
    consumed = {
        one.name: answered(one, heard[one.name], spoken[one.name])
        if one.keeps
        else [each for each, _ in heard[one.name]]
        for one in wirings
    }
    return Before(consumed, spoken, times)


def answered(wiring: Wiring, heard: Sequence[Heard], said: Sequence[Spoken]) -> list[Consumed]:
    """What a node that acts had answered: each message by one of its own at least, in its order.

    What it needs before all else does not count, nor what it says before it is asked anything.

    Parameters
    ----------
    wiring : Wiring
        The node's.
    heard : sequence of (Consumed, int)
        What was sent to it.
    said : sequence of Spoken
        What it had said.
    """
    node = load_node(wiring.module)
    needs = node.needs if isinstance(node, Node) else ()
    latched = {one.topic for one in wiring.inputs if one.local in needs}
    asked = [(one, sent_ns) for one, sent_ns in heard if one.topic not in latched]
    if not asked:
        return []
    answers = sum(one.sent_ns > asked[0][1] for one in said)
    return [one for one, _ in asked[:answers]]
