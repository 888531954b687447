"""Whether a running graph is well: its launcher answers, its nodes live, nothing is missing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from palpate.launch.looking.ask import ask
from palpate.launch.looking.beats import Beats, hear_beats
from palpate.launch.looking.findings import Finding, fail, ok, warn
from palpate.launch.looking.hearing import still_runs
from palpate.launch.processes.register import Card
from palpate.launch.processes.roll import SILENCE


def graphs_findings(cards: list[Card]) -> Iterator[Finding]:
    """What there is to say of each running graph."""
    if not cards:
        yield ok("no graph of yours is running")
    for card in cards:
        try:
            answer = ask(card, "status")
            beats = hear_beats(card, [n for n, one in answer["nodes"].items() if one["pid"]])
        except ValueError as error:
            if still_runs(card):
                yield fail(f"{error}; if it stays so, kill {card.pid}")
            continue
        yield from graph_findings(card, answer, beats)


def graph_findings(
    card: Card, answer: Mapping[str, Any], beats: Mapping[str, Beats]
) -> Iterator[Finding]:
    """What there is to say of one graph.

    Parameters
    ----------
    card : Card
        The running graph.
    answer : mapping
        What its launcher says.
    beats : mapping of str to Beats
        What its nodes say.
    """
    nodes, title = answer["nodes"], f"{card.run[:6]} ({card.name})"
    faults = list(_faults(title, nodes, beats))
    if faults:
        yield from faults
        return
    handled = sum(one.status.messages for one in beats.values())
    yield ok(
        f"{title} runs for {answer['for_s']:.0f} s: {len(nodes)} nodes, "
        f"{handled} messages handled, none missing"
    )


def _faults(
    title: str, nodes: Mapping[str, Mapping[str, Any]], beats: Mapping[str, Beats]
) -> Iterator[Finding]:
    for name, about in nodes.items():
        who = f"{title}: {name}"
        if not about["pid"]:
            yield warn(f"{who} does not run; if it should, see log.jsonl for why it ended")
            continue
        if about["restarts"]:
            yield warn(f"{who} was started again {about['restarts']} times; see log.jsonl")
        if about["silent_s"] > SILENCE:
            yield warn(f"{who} has been silent for {about['silent_s']:.0f} s: it works, or hangs")
        if name in beats and beats[name].status.gaps:
            yield fail(f"{who} misses {beats[name].status.gaps} messages: start the run anew")
