"""Which nodes of a recording are run again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from palpate.launch.own_modules import look_here
from palpate.messages.recording.reader import Recording
from palpate.nodes.node import Node
from palpate.nodes.recording import Recorded, recorded_wirings
from palpate.nodes.wiring import Wiring, load_node

OURS = "palpate."
"""A recording names modules to import; others than ours only if the user names the node."""


class Chosen(NamedTuple):
    """A node that is run again."""

    node: Node
    """What it does."""
    wiring: Wiring
    """Its place in the recorded graph, and its parameters."""


def choose(recording: Recording, names: Sequence[str]) -> tuple[Chosen, ...]:
    """Load the named nodes; all that can be replayed exactly if none is named.

    A node that heard one publisher beside its needs is replayed exactly: of two publishers it may
    have heard the other one first.

    Raises
    ------
    ValueError
        If the recording does not describe its graph, a node is unknown, a sink, cannot be
        loaded or has other parameters by now, or none can be replayed exactly.
    """
    if not recording.graph:
        raise ValueError(f"recording {recording.path} does not say which nodes made it")
    known = {one.name: one for one in recorded_wirings(recording.graph)}
    for name in names:
        if name not in known:
            raise ValueError(f"recording {recording.path} has no node {name!r}; it has {[*known]}")
    chosen = []
    for one in [known[name] for name in dict.fromkeys(names)] or known.values():
        if not names and not one.module.startswith(OURS):
            continue
        if not one.module.startswith(OURS):
            look_here(f"{one.module}:NODE")
        node = load_node(one.module)
        if isinstance(node, Node) and (names or _is_exact(one, node, recording)):
            chosen.append(Chosen(node, one.wiring(node.params)))
        elif names:
            raise ValueError(
                f"{one.name} is no node that hears and says: there is nothing to be compared"
            )
    if not chosen:
        raise ValueError(f"recording {recording.path} has no node that can be replayed exactly")
    return tuple(chosen)


def _is_exact(place: Recorded, node: Node, recording: Recording) -> bool:
    """Whether the recorded order is sure to be the order in which the node heard."""
    heard = [one for one in place.inputs if recording.counts.get(one.topic)]
    return len({one.publisher for one in heard if one.local not in node.needs}) <= 1
