from __future__ import annotations

from palpate.bench.bus.stalling_node import NODE, FloodCount, StallingParams
from palpate.messages.types.graph import Clock
from palpate.nodes.runtime.node import Finished


def test_a_listener_counts_what_is_left_out_and_what_is_out_of_turn() -> None:
    _, hear = NODE.inputs["/in"]
    params, heard = StallingParams(expects=6), FloodCount()
    for number in (0, 1, 4, 3, 4, 5):
        heard, said = hear(params, heard, Clock(time=1e-3 * number))
    assert heard == FloodCount(number=6, latest=5, early=2, again=2)
    assert said == [Finished("6 heard, 2 left out, 2 out of turn")]
