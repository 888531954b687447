from __future__ import annotations

from palpate.launch.damage.turns import bomb_of


def test_every_second_input_is_a_bomb_while_there_are_any() -> None:
    assert [bomb_of(number, "abc") for number in range(8)] == ["a", None, "b", None, "c"] + 3 * [
        None
    ]
