"""Parameters set from outside, laid over those with which a graph was recorded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from palpate.launch.convert import convert
from palpate.launch.entry import Entry
from palpate.launch.graph import Graph
from palpate.launch.located import Located
from palpate.launch.override import override
from palpate.launch.replay.chosen import Chosen
from palpate.nodes.recording import Recorded, recorded_wirings
from palpate.nodes.wiring import Wiring


def lay_over(
    chosen: Sequence[Chosen], graph: bytes, settings: Mapping[str, Located]
) -> tuple[Chosen, ...]:
    """The nodes with parameters set as by ``palpate run --set``.

    Parameters
    ----------
    chosen : sequence of Chosen
        The nodes that are run again.
    graph : bytes
        Description of the graph in which they ran.
    settings : map
        ``node.param`` to its value.

    Raises
    ------
    InputError
        If a setting does not look like this, names a node that is not run again, or a parameter
        that it does not have, or has a value that is of the wrong type or out of range.
    """
    if not settings:
        return tuple(chosen)
    entries = [_entry(one.wiring) for one in chosen]
    _refuse_others(entries, graph, settings)
    laid = override(Graph(tuple(entries), ends=""), settings).entries
    return tuple(
        one._replace(wiring=_with(one, after)) if after.places else one
        for one, after in zip(chosen, laid, strict=True)
    )


def _with(one: Chosen, entry: Entry) -> Wiring:
    params: Any = convert(entry.settings, one.node.params, entry.name)
    return replace(one.wiring, params=params)


def _refuse_others(entries: Sequence[Entry], graph: bytes, settings: Mapping[str, Located]) -> None:
    """Refuse settings for nodes that ran, but are not run again."""
    others = [_entry(one) for one in recorded_wirings(graph)]
    again = {name for entry in entries for name in (entry.name, entry.group)}
    ran = {name for entry in others for name in (entry.name, entry.group)}
    for target, value in settings.items():
        node, _, param = target.partition(".")
        if param and node in ran - again:
            names = ", ".join(entry.name for entry in entries)
            raise value.error(
                (), f"{node!r} is not among the nodes to run again: {names}; add it to --nodes"
            )


def _entry(place: Wiring | Recorded) -> Entry:
    """The node as a launch file would describe it, in the namespace of its finger."""
    finger = f"finger_{place.name.rpartition('_')[2]}"
    within = any(topic.startswith(f"/{finger}/") for topic in place.outputs.values())
    return Entry(
        name=place.name,
        kind=place.module,
        params=place.params,
        namespace=finger if within else "",
    )
