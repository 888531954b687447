import random
from contextlib import nullcontext
from types import SimpleNamespace

import pytest

import palpate.tools.introspection.topics as rates_module
from palpate.messages.codec import HEADER_SIZE
from palpate.tools.introspection.topics import (
    RateMonitor,
    Rates,
    Topic,
    bandwidth_text,
    delay_text,
    rate_text,
)


def rates_of(copies, window=10_000):
    rates = Rates(window)
    for one in copies:
        rates.add(one)
    return rates


@pytest.mark.parametrize("received", [1.0, 0.5, 0.05])
def test_lost_copies_do_not_falsify_a_rate_of_1_khz(copy, received):
    rng = random.Random(1)
    # Sent every millisecond, a little early or late; copies come late, in bursts, or not at all.
    sent = [1e-3 * seq + 2e-4 * rng.random() for seq in range(5000)]
    late = [0.3 * rng.random() for _ in sent]
    copies = (
        copy(seq, sent[seq], late=late[seq]) for seq in range(5000) if rng.random() < received
    )
    rate = rates_of(copies).rate()
    # Both ends may be off by 0.2 ms each, in about 5 s.
    assert rate == pytest.approx(1000.0, rel=1e-4)


def test_a_rate_is_right_after_the_longest_loss(copy):
    copies = [copy(seq, 1e-3 * seq) for seq in (0, 1, 4000, 4001)]
    assert rates_of(copies).rate() == pytest.approx(1000.0)


def test_periods_are_those_of_neighbours_alone(copy):
    rates = rates_of([copy(0, 0.0), copy(1, 0.01), copy(5, 0.05), copy(6, 0.08)])
    periods = rates.periods()
    assert periods is not None
    assert (periods.least, periods.most) == pytest.approx((0.01, 0.03))
    assert periods.deviation == pytest.approx(0.01)
    text = rate_text(rates)
    assert text == (
        "average rate: 75.000\n\tmin: 0.010000s max: 0.030000s std dev: 0.010000s "
        "window: 4 (3 sent, but not received)"
    )


def test_without_two_neighbours_there_is_a_rate_but_no_period(copy):
    rates = rates_of([copy(0, 0.0), copy(9, 0.09)])
    assert rates.periods() is None
    assert rate_text(rates) == (
        "average rate: 100.000\n\tno two neighbouring messages came "
        "window: 2 (8 sent, but not received)"
    )


def test_one_message_has_no_rate(copy):
    assert rate_text(rates_of([copy(0, 0.0)])) is None
    assert bandwidth_text(rates_of([copy(0, 0.0)])) is None
    assert rate_text(Rates()) is delay_text(Rates()) is bandwidth_text(Rates()) is None


def test_a_figure_is_that_of_the_window(copy):
    slow, fast = [copy(n, 1.0 * n) for n in range(10)], [copy(9 + n, 9 + 0.1 * n) for n in (1, 2)]
    rates = rates_of([*slow, *fast], window=3)
    assert (rates.rate(), rates.received) == (pytest.approx(10.0), 3)


def test_counting_from_0_once_more_begins_the_window_anew(copy):
    rates = rates_of([copy(7, 0.0), copy(8, 1.0), copy(0, 5.0), copy(1, 5.5)])
    assert (rates.rate(), rates.sent) == (2.0, 2)


def test_bandwidth_counts_whole_frames_and_those_not_received(copy):
    body = bytes(1000 - HEADER_SIZE - 3)
    rates = rates_of(copy(seq, 0.001 * seq, body=body) for seq in (0, 1, 3))
    assert rates.bandwidth() == pytest.approx(1e6)
    assert bandwidth_text(rates) == (
        "1.00 MB/s from 3 messages\n\tMessage size mean: 1.00 KB min: 1.00 KB max: 1.00 KB "
        "window: 3 (1 sent, but not received)"
    )


def test_a_delay_is_from_sending_to_taking(copy):
    rates = rates_of([copy(0, 1.0, late=0.001), copy(1, 2.0, late=0.003)])
    assert delay_text(rates) == (
        "average delay: 0.002000\n\tmin: 0.001000s max: 0.003000s std dev: 0.001000s window: 2"
    )


def test_figures_are_printed_once_a_second(card, monkeypatch):
    clock = iter(0.1 * tick for tick in range(1000))
    taps = SimpleNamespace(batches=lambda duration: [[]] * 25)
    monkeypatch.setattr(rates_module, "TapSubscription", lambda *_: nullcontext(taps))
    monkeypatch.setattr(rates_module, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    printed = []
    topics = [Topic("/t", "", ("talker",), ())]
    RateMonitor(topics, 10, rate_text, printed.append).run(card, topics, None)
    assert printed == ["no messages on /t"] * 2
