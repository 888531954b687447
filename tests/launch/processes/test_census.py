from __future__ import annotations

from palpate.launch.processes.census import AGAIN, Census, Count, Edge

EDGE = Edge("hearer", "talker", "/talk")


def census() -> Census:
    return Census(["talker", "hearer"], [EDGE])


def answer(one: Census, sent: int, consumed: int, now: float, waits: tuple[str, ...] = ()) -> None:
    round_ = one.round
    one.answer("talker", round_, Count({"/talk": sent}, {}), now, 0.0)
    one.answer("hearer", round_, Count({}, {("talker", "/talk"): consumed}, waits), now, 0.0)


def test_two_equal_rounds_with_everything_consumed_are_settled() -> None:
    one = census()
    answer(one, 3, 3, 0.0)
    assert not one.settled
    answer(one, 3, 3, 1.0)
    assert one.settled
    assert one.still_for(2.0) == 2.0


def test_a_message_that_is_on_its_way_is_not_settled() -> None:
    one = census()
    answer(one, 3, 2, 0.0)
    answer(one, 3, 2, 1.0)
    assert not one.settled
    assert one.unheard() == [(EDGE, 3, 2)]


def test_rounds_that_differ_are_not_settled() -> None:
    one = census()
    answer(one, 3, 3, 0.0)
    answer(one, 3, 3, 1.0)
    answer(one, 4, 4, 2.0)
    assert not one.settled
    assert one.still_for(3.0) == 0.0


def test_what_was_counted_before_is_forgotten() -> None:
    one = census()
    answer(one, 3, 3, 0.0)
    one.forget()
    answer(one, 3, 3, 1.0)
    assert not one.settled


def test_an_answer_to_an_earlier_round_does_not_count() -> None:
    one = census()
    answer(one, 3, 3, 0.0)
    one.answer("talker", 0, Count({"/talk": 3}, {}), 1.0, 0.0)
    one.answer("stranger", 1, Count({"/talk": 3}, {}), 1.0, 0.0)
    assert one.to_ask(1.0) == ["talker", "hearer"]


def test_who_has_not_answered_is_asked_again() -> None:
    one = census()
    assert one.to_ask(0.0) == ["talker", "hearer"]
    one.answer("talker", 0, Count({}, {}), 0.0, 0.0)
    assert one.to_ask(AGAIN / 2) == []
    assert one.to_ask(AGAIN) == ["hearer"]


def test_complaints_name_who_waits_for_what() -> None:
    one = census()
    answer(one, 3, 1, 0.0, waits=("/world",))
    assert one.complaints() == [
        "hearer needs /world before anything else",
        "hearer has consumed 1 of 3 on /talk from talker",
    ]
    answer(one, 0, 0, 1.0)
    assert one.complaints() == ["hearer has heard nothing on /talk (talker)"]


def test_who_is_dropped_is_neither_asked_nor_waited_for() -> None:
    one = Census(["talker", "hearer"], [EDGE, Edge("late", "talker", "/talk")])
    one.drop("hearer")
    assert one.to_ask(1.0) == ["talker"]
    for now in (1.0, 2.0):
        one.answer("talker", one.round, Count({"/talk": 3}, {}), now, 0.0)
    assert one.settled
