"""One node of a running graph, as a text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from palpate.launch.looking.ask import ask
from palpate.launch.looking.beats import Beats, hear_beats
from palpate.launch.looking.parameters import find_node, params_of
from palpate.launch.looking.showing import yaml_lines
from palpate.launch.looking.topics import topics_of
from palpate.launch.processes.register import Card
from palpate.nodes.recording import Recorded

HOME = "palpate.nodes."


def living_nodes(card: Card) -> list[str]:
    """Names of the nodes whose process runs, sorted.

    Raises
    ------
    ValueError
        If the launcher gives no answer.
    """
    return sorted(name for name, about in ask(card, "status")["nodes"].items() if about["pid"])


def node_text(card: Card, name: str) -> str:
    """What a node is, how it is doing, what it hears and says, and its parameters.

    Raises
    ------
    ValueError
        If the graph has no such node, or the launcher gives no answer.
    """
    node = find_node(card, name)
    about = ask(card, "status")["nodes"][node.name]
    beats = hear_beats(card, [node.name]) if about["pid"] else {}
    return "\n".join(
        [
            node.name,
            f"  kind      {node.module.removeprefix(HOME)}",
            *_health_lines(about, beats.get(node.name)),
            *_traffic_lines(card, node),
            "  params",
            *(f"    {line}" for line in yaml_lines(params_of(node))),
        ]
    )


def _health_lines(about: Mapping[str, Any], beats: Beats | None) -> list[str]:
    lines = [f"  pid       {about['pid'] or 'none: it does not run'}"]
    lines.append(f"  restarts  {about['restarts']}")
    if beats is None:
        if about["pid"]:
            lines.append(f"  state     silent for {about['silent_s']:.1f} s: it works, or hangs")
        return lines
    status = beats.status
    load = "" if beats.load is None else f", {100.0 * beats.load:.0f} % of a core now"
    return [
        *lines,
        f"  state     {status.state}",
        f"  messages  {status.messages} handled, {status.sent} sent",
        f"  gaps      {status.gaps}, duplicates {status.duplicates}",
        f"  handler   p50 {status.p50:.0f} us, p99 {status.p99:.0f} us",
        f"  cpu       {status.cpu:.2f} s{load}",
    ]


def _traffic_lines(card: Card, node: Recorded) -> list[str]:
    topics = topics_of(card)
    hears = [(one.topic, one.type, f"from {one.publisher}") for one in node.inputs]
    says = [
        (wire, topics[wire].type, f"to {', '.join(topics[wire].listeners) or 'nobody'}")
        for wire in node.outputs.values()
    ]
    lines = []
    for what, rows in (("hears", hears), ("says", says)):
        lines += [f"  {what}", *(f"    {topic}  {said}  {who}" for topic, said, who in rows)]
    return lines
