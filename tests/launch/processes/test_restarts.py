from __future__ import annotations

from palpate.launch.processes.restarts import Restarts


def test_a_node_may_be_started_again_but_not_in_a_storm() -> None:
    restarts = Restarts({"a": "restart", "b": "restart"})
    how = "was killed by SIGKILL"
    assert [restarts.refusal("a", how, False, now) for now in (0.0, 1.0, 2.0)] == [None] * 3
    assert restarts.refusal("b", how, False, 3.0) is None
    assert restarts.refusal("a", how, False, 9.0) == (
        "a was killed by SIGKILL, after it had been started again 3 times in 10 s"
    )
    assert restarts.refusal("a", how, False, 10.5) is None
    assert restarts.counts == {"a": 4, "b": 1}


def test_a_message_of_which_a_node_dies_twice_ends_the_run() -> None:
    restarts = Restarts({"a": "restart"})
    how = "failed while handling /in 7 from b: ValueError: no"
    assert restarts.refusal("a", how, True, 0.0) is None
    assert restarts.refusal("a", how.replace("7", "8"), True, 50.0) is None
    assert restarts.refusal("a", how.replace("7", "8"), True, 90.0) == (
        "a failed while handling /in 8 from b: ValueError: no; so it did when it was started again"
    )


def test_a_node_that_the_launch_file_says_so_of_ends_the_run_at_once() -> None:
    restarts = Restarts({"a": "stop"})
    assert restarts.refusal("a", "hung", False, 0.0) == "a hung"
    assert restarts.counts == {"a": 0}
