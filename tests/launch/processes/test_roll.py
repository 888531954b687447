from __future__ import annotations

import time

import pytest

from palpate.launch.processes.roll import SILENCE, Roll
from palpate.messages.codec import encode
from palpate.messages.types import NodeStatus

STATUS = NodeStatus(
    node="filter",
    state="ending",
    messages=3,
    sent=3,
    gaps=0,
    duplicates=0,
    p50=1.0,
    p99=2.0,
    cpu=0.1,
)


def test_a_node_is_ready_and_says_goodbye_with_its_counters() -> None:
    roll = Roll(["filter"])
    assert roll.hear("filter", {"kind": "ready"}) == []
    assert roll.hear("filter", {"kind": "bye", "status": encode(STATUS)}) == []
    assert roll.ready == roll.bye == {"filter"}
    assert roll.statuses["filter"].messages == 3


def test_a_failure_is_one_line_and_its_trace_another() -> None:
    roll = Roll(["filter"])
    lines = roll.hear("filter", {"kind": "failed", "text": "it broke", "trace": "T" * 99_999})
    assert roll.failed == {"filter": "it broke"}
    assert [(line.level, len(line.text)) for line in lines] == [("error", 8), ("debug", 4000)]
    for line in lines:
        encode(line)


def test_a_stranger_is_refused() -> None:
    with pytest.raises(ValueError, match="somebody called 'spy' spoke, who is not in the graph"):
        Roll(["filter"]).hear("spy", {"kind": "ready"})


def test_counters_that_cannot_be_read_are_refused() -> None:
    with pytest.raises(ValueError, match="not a NodeStatus"):
        Roll(["filter"]).hear("filter", {"kind": "bye", "status": b""})


def test_silence_is_mentioned_once_until_the_node_speaks_again() -> None:
    roll = Roll(["filter"])
    late = time.monotonic() + 2 * SILENCE
    [line] = roll.silent(late)
    assert line.text.startswith("filter is still starting, or hangs")
    assert roll.silent(late) == []
    roll.hear("filter", {"kind": "ready"})
    [line] = roll.silent(late)
    assert line.text.startswith("filter is still working, or hangs")
