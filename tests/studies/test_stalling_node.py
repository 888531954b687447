from __future__ import annotations

from palpate.messages.types.catalogue import Clock
from palpate.nodes.runtime.node import Finished
from tests.studies.stalling_node import NODE, FloodCount, StallingParams


def test_a_subscriber_counts_what_is_left_out_and_what_is_out_of_turn():
    _, take = NODE.inputs["/in"]
    params, count = StallingParams(expects=6), FloodCount()
    for number in (0, 1, 4, 3, 4, 5):
        count, outputs = take(params, count, Clock(time=1e-3 * number))
    assert count == FloodCount(number=6, latest=5, missing=2, late=2)
    assert outputs == [Finished("6 received, 2 missing, 2 out of turn")]
