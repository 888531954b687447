import sys
from types import ModuleType
from typing import Any

import msgspec
import pytest

from palpate.launch.processes.registry import SentMessage
from palpate.messages.bus.message_log import Consumed
from palpate.messages.types.catalogue import LogRecord
from palpate.nodes.runtime.node import Input, Node, Wiring
from palpate.tools.replay.rerun import answered_messages


class Params(msgspec.Struct, frozen=True):
    pass


@pytest.fixture
def actor(monkeypatch):
    quiet: Any = lambda params, state, message: (state, [])  # noqa: E731
    made = ModuleType("actor")
    made.NODE = Node(
        params=Params,
        start=lambda params: (None, []),
        inputs={"/world": (LogRecord, quiet), "/goal": (LogRecord, quiet)},
        outputs={"/done": LogRecord},
        needs=("/world",),
        has_side_effects=True,
    )
    monkeypatch.setitem(sys.modules, "actor", made)
    return Wiring(
        name="actor",
        module="actor",
        params=Params(),
        inputs=(
            Input("a", "/world", "/world", "LogRecord"),
            Input("b", "/g", "/goal", "LogRecord"),
        ),
        outputs={"/done": "/done"},
        subscribers={},
        persistent=True,
    )


WORLD = (Consumed("a", "/world", 0), 1)


def goals(*times):
    return [(Consumed("b", "/g", seq), sent_ns) for seq, sent_ns in enumerate(times)]


def published(*times):
    return [SentMessage("/done", sent_ns, 0, b"") for sent_ns in times]


def test_what_was_not_answered_is_still_to_be_done(actor):
    received = [WORLD, *goals(10, 11, 12, 13)]
    done = answered_messages(actor, received, published(5, 20, 30))
    assert done == [Consumed("b", "/g", 0), Consumed("b", "/g", 1)]


def test_more_answers_than_questions_answer_them_all(actor):
    assert len(answered_messages(actor, goals(10, 11), published(20, 21, 22, 23))) == 2


def test_what_it_needs_is_handed_over_again(actor):
    assert answered_messages(actor, [WORLD], published(5)) == []
    assert answered_messages(actor, [], []) == []
