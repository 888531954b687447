from __future__ import annotations

from palpate.nodes.runtime_pace import Pace


def test_what_is_due_later_is_waited_for() -> None:
    pace = Pace()
    pace.start(2.0, 100.0)
    assert pace.wait(2.0, 100.0) == 0.0
    assert pace.wait(3.5, 100.5) == 1.0
    assert pace.wait(3.5, 107.0) == 0.0


def test_while_it_stands_still_only_what_was_due_already_is_said() -> None:
    pace = Pace(paused=True)
    pace.start(0.0, 100.0)
    assert pace.wait(0.0, 105.0) == 0.0
    assert pace.wait(0.1, 105.0) is None


def test_a_pause_takes_no_time_of_the_source() -> None:
    pace = Pace()
    pace.start(0.0, 100.0)
    pace.pause(101.0)
    assert pace.wait(1.5, 150.0) is None
    pace.resume(200.0)
    assert pace.wait(1.5, 200.0) == 0.5


def test_pausing_or_going_on_twice_is_doing_it_once() -> None:
    pace = Pace()
    pace.start(0.0, 100.0)
    pace.pause(101.0)
    pace.pause(110.0)
    pace.resume(120.0)
    pace.resume(120.5)
    assert pace.wait(2.0, 121.0) == 0.0


def test_steps_say_what_is_next_and_stand_still_again() -> None:
    pace = Pace(paused=True)
    pace.start(0.0, 100.0)
    pace.step(2)
    for due in (5.0, 9.0):
        assert pace.wait(due, 100.0) == 0.0
        pace.gone(due, 100.0)
    assert pace.wait(9.5, 100.0) is None
    pace.resume(300.0)
    assert pace.wait(9.5, 300.0) == 0.5


def test_who_does_not_stand_still_takes_no_steps() -> None:
    pace = Pace()
    pace.start(0.0, 100.0)
    pace.step(3)
    assert pace.wait(5.0, 101.0) == 4.0
