from __future__ import annotations

from palpate.launch.looking.hearing import Order
from palpate.messages.header import Header


def places(order: Order, *numbers: tuple[int, int]) -> list[int | None]:
    """What is missing before messages of these epochs and numbers."""
    return [order.place(Header(1, epoch, seq, 0, 0.0, 0)) for epoch, seq in numbers]


def test_what_came_before_the_tool_is_not_missing() -> None:
    assert places(Order(anew=False), (0, 500), (0, 501)) == [0, 0]


def test_missing_messages_are_counted_from_the_numbers() -> None:
    assert places(Order(anew=False), (0, 1), (0, 5), (0, 6)) == [0, 3, 0]


def test_what_a_node_says_again_after_a_restart_is_no_news() -> None:
    again = [(1, 0), (1, 1), (1, 2), (1, 3)]
    assert places(Order(anew=False), (0, 1), (0, 2), *again) == [0, 0, None, None, None, 0]


def test_a_late_copy_of_an_earlier_start_is_no_news() -> None:
    assert places(Order(anew=True), (1, 3), (0, 9)) == [0, None]


def test_who_counts_anew_after_a_restart_has_lost_nothing() -> None:
    assert places(Order(anew=True), (0, 7), (1, 2), (1, 4)) == [0, 0, 1]
