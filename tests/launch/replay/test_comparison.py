from __future__ import annotations

from palpate.launch.replay.comparison import TopicComparison
from palpate.messages.codec import encode
from palpate.messages.types import LogRecord


def log(value: float) -> bytes:
    return encode(LogRecord(node="x", level="info", text="", robot_time=value))


def compared(then: list[float], now: list[float], *, closed: bool = True) -> TopicComparison:
    comparison = TopicComparison("/log", LogRecord)
    for value in then:
        comparison.recorded(log(value))
    for value in now:
        comparison.said(log(value))
    comparison.end(closed=closed)
    return comparison


def test_the_same_messages_are_identical() -> None:
    found = compared([1.0, 2.0], [1.0, 2.0])

    assert (found.compared, found.differ, found.fewer, found.more, found.first) == (2, 0, 0, 0, "")


def test_the_first_of_several_differences_is_told() -> None:
    found = compared([1.0, 2.0, 3.0], [1.0, 2.5, 4.0])

    assert (found.compared, found.differ) == (3, 2)
    assert found.first == "/log 1 robot_time: recorded 2.0, now 2.5"


def test_what_one_side_lacks_is_counted() -> None:
    fewer, more = compared([1.0, 2.0], []), compared([1.0], [1.0, 2.0, 3.0])

    assert (fewer.fewer, fewer.first) == (2, "/log 0: recorded, but not said again")
    assert (more.more, more.first) == (2, "/log 1: said now, but not recorded")


def test_what_a_recording_without_its_end_lacks_is_no_difference() -> None:
    found = compared([1.0, 2.0], [1.0], closed=False)

    assert (found.fewer, found.first) == (0, "")


def test_after_it_fell_silent_what_was_recorded_is_counted() -> None:
    comparison = TopicComparison("/log", LogRecord)
    comparison.recorded(log(1.0))
    comparison.fall_silent()
    comparison.recorded(log(2.0))
    comparison.end(closed=True)

    assert (comparison.compared, comparison.fewer) == (0, 2)


def test_what_was_said_before_the_silence_is_still_compared() -> None:
    comparison = TopicComparison("/log", LogRecord)
    comparison.said(log(1.0))
    comparison.fall_silent()
    comparison.recorded(log(1.0))
    comparison.recorded(log(2.0))
    comparison.end(closed=True)

    assert (comparison.compared, comparison.differ, comparison.fewer) == (1, 0, 1)
