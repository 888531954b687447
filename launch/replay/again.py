"""Runs nodes again on what they heard, and compares what they say with what they had said.

A node is a pure function of its parameters and of its inputs in their order. So with the same
parameters it must say the same, and with others the difference is what these parameters do.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from threadpoolctl import threadpool_limits

from palpate.launch.bag.bag_file import find_bag
from palpate.launch.located import Located
from palpate.launch.replay.chosen import choose
from palpate.launch.replay.exchange import Exchange
from palpate.launch.replay.order import in_order_of_sending
from palpate.launch.replay.player import Player
from palpate.launch.replay.settings import lay_over
from palpate.launch.replay.text import shortage_text, table, verdict
from palpate.messages.recording.reader import Kept, Recording, open_recording


def replay(
    bag: Path,
    nodes: Sequence[str] = (),
    echo: Callable[[str], None] = print,
    *,
    settings: Mapping[str, Located] | None = None,
) -> int:
    """Run nodes of a recording again, in lockstep and as fast as they can.

    What one of them says now is what the others hear; what the others of the graph had said comes
    from the recording.

    Parameters
    ----------
    bag : Path
        The recording, or the folder of its run.
    nodes : sequence of str
        Names of nodes in the recorded graph; all that can be replayed exactly if empty.
    echo : function
        Prints a line.
    settings : map, optional
        ``node.param`` to its value, laid over the recorded parameters.

    Returns
    -------
    int
        1 if a node raised, or if none was given another parameter and one did not say what it had
        said, byte for byte; otherwise 0.

    Raises
    ------
    ValueError
        If the recording cannot be read or lacks messages, or a node is unknown, cannot be
        replayed, or was recorded with other message types.
    InputError
        If a setting cannot be used.
    """
    recording = open_recording(find_bag(bag))
    chosen = lay_over(choose(recording, nodes), recording.graph, settings or {})
    players = [Player(one) for one in chosen]
    if not recording.closed:
        echo(f"{recording.path} was never closed: replaying as far as it goes")
    exchange = Exchange(players)
    with threadpool_limits(limits=1):  # as when it was recorded: several threads round otherwise
        _play(recording, exchange)
    for player in players:
        player.end(closed=recording.closed)
        echo(verdict(player))
    if recording.closed:
        for shortage in exchange.shortages():
            echo(shortage_text(shortage))
    for line in table(players):
        echo(line)
    failed = any(player.failure for player in players)
    return int(failed or (not settings and any(player.first for player in players)))


def _play(recording: Recording, exchange: Exchange) -> None:
    exchange.begin()
    sequence: dict[str, int] = {}
    for kept in in_order_of_sending(recording):
        _check_sequence(recording, sequence, kept)
        exchange.hear(kept)
    exchange.end()


def _check_sequence(recording: Recording, sequence: dict[str, int], kept: Kept) -> None:
    wanted = sequence.get(kept.topic, 0)
    if kept.seq != wanted:
        raise ValueError(
            f"recording {recording.path} lacks {kept.topic} {wanted}: it has {kept.seq} instead"
        )
    sequence[kept.topic] = wanted + 1
