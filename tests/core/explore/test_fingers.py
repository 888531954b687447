from __future__ import annotations

import itertools

from palpate.core.explore.fingers import next_finished


def test_the_earliest_result_is_taken_up_when_nobody_can_be_earlier() -> None:
    assert next_finished({}, {1, 2}, {}) is None
    assert next_finished({1: 5.0}, {1}, {}) == 1
    assert next_finished({1: 5.0}, {1, 2}, {2: 4.0}) is None
    assert next_finished({1: 5.0}, {1, 2}, {2: 5.5}) == 1
    assert next_finished({1: 5.0, 2: 4.0}, {1, 2}, {}) == 2


def test_a_finger_whose_clock_is_not_known_is_waited_for() -> None:
    assert next_finished({2: 5.0}, {1, 2}, {}) is None


def test_of_two_at_one_time_the_lower_number_comes_first() -> None:
    assert next_finished({1: 5.0, 2: 5.0}, {1, 2}, {}) == 1
    # Finger 1 may still end at 5 s, and would then come first; finger 3 would not.
    assert next_finished({2: 5.0}, {1, 2}, {1: 5.0}) is None
    assert next_finished({2: 5.0}, {2, 3}, {3: 5.0}) == 2


def test_the_order_does_not_depend_on_who_was_heard_first() -> None:
    ends = {1: 3.0, 2: 2.0, 3: 4.0}
    for heard in itertools.permutations(ends):
        finished: dict[int, float] = {}
        busy, taken = set(ends), []
        for finger in heard:
            finished[finger] = ends[finger]
            while (found := next_finished(finished, busy, finished)) is not None:
                taken.append(found)
                busy.discard(found)
                del finished[found]
        assert taken == [2, 1, 3]
