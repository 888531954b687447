from __future__ import annotations

import os
import signal
import threading

import pytest

from palpate.launch.processes.fork_server import Interrupts, signals_as_ctrl_c


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_is_noted_and_the_first_one_counts(number):
    with Interrupts() as interrupts:
        assert interrupts.came is None
        os.kill(os.getpid(), number)
        os.kill(os.getpid(), signal.SIGINT)
        assert interrupts.came == number.name


def test_what_was_done_with_signals_before_is_done_again():
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    with Interrupts():
        assert signal.getsignal(signal.SIGINT) != before[0]
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


def test_a_closed_terminal_is_ignored_where_it_was_ignored_before():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with Interrupts() as interrupts:
            os.kill(os.getpid(), signal.SIGHUP)
            assert interrupts.came is None
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_request_to_end_interrupts_as_ctrl_c_does(number):
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt), signals_as_ctrl_c():
        os.kill(os.getpid(), number)
    assert signal.getsignal(number) is before


def test_in_another_thread_nothing_is_changed():
    seen: list[object] = []

    def look() -> None:
        with signals_as_ctrl_c():
            seen.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=look)
    thread.start()
    thread.join(10.0)
    assert seen == [signal.getsignal(signal.SIGTERM)]
