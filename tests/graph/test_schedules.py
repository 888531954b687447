"""Whole explorations, models and decisions among them, however messages travel between nodes."""

import random
from functools import cache

import pytest

from palpate.launch.files.source_map import SourceMapped
from palpate.launch.launch_file import describe
from palpate.launch.launch_source import EXPLORE
from palpate.messages.codec import encode
from palpate.nodes.runtime import composed

SETTINGS = {"scene": "sphere", "record": False}
NODES = ("tracer", "planner", "reconstructor", "evaluator")


class Preference(random.Random):
    """Draws edges to one node only when there are no others, or before all others."""

    def __init__(self, node, last):
        super().__init__(0)
        self._node, self._last = node, last

    def choice(self, seq):
        preferred = [edge for edge in seq if (edge[1] == self._node) is not self._last]
        return super().choice(preferred or seq)


class Bodies:
    """A watcher that keeps the bytes of all messages, by topic."""

    def __init__(self):
        self.found = {}

    def received(self, topic, message):
        self.found.setdefault(topic, []).append(encode(message))

    def ready(self, seconds):
        """All nodes are up."""

    def tick(self, statuses):
        """Time has gone by."""


def explored(folder, fingers, draw=None):
    """All that a run in one process publishes, with so many fingers and a draw of the edges."""
    args = {**SETTINGS, "fingers": fingers}
    given = {name: SourceMapped(value, "") for name, value in args.items()}
    graph = describe(EXPLORE, given, folder).graph.wirings()
    watch = tuple(topic for one in graph for topic in one.outputs.values())
    watcher = Bodies()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(composed.random, "Random", lambda _: draw)
        ending = composed.run_composed(
            graph,
            ends="evaluator",
            watch=watch,
            watcher=watcher,
            schedule=None if draw is None else 0,
        )
    assert ending.status == "finished", ending.reason
    return watcher.found


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    """The same where messages are handled in the order in which they were sent."""
    return cache(lambda fingers: explored(tmp_path_factory.mktemp("usual"), fingers))


@pytest.mark.parametrize(
    ("fingers", "seeds"),
    [
        (1, range(1)),
        *(
            pytest.param(fingers, range(first, first + 25), marks=pytest.mark.slow)
            for fingers in (1, 2)
            for first in (1, 26, 51, 76)
        ),
    ],
)
def test_no_order_in_which_messages_are_handled_changes_a_byte(fingers, seeds, usual, tmp_path):
    assert len(usual(fingers)["/score"]) == len(usual(fingers)["/model/shape"]) > 3
    for seed in seeds:
        assert explored(tmp_path, fingers, random.Random(seed)) == usual(fingers), seed


@pytest.mark.parametrize("last", [True, False], ids=["starved", "preferred"])
@pytest.mark.parametrize(
    "node",
    [pytest.param(one, marks=[] if one == "reconstructor" else pytest.mark.slow) for one in NODES],
)
def test_who_is_always_late_or_always_first_changes_nothing(node, last, usual, tmp_path):
    assert explored(tmp_path, 1, Preference(node, last)) == usual(1)
