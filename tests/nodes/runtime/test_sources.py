from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from palpate.messages.bus.message_log import SourceProgress
from palpate.messages.codec import decode, encode
from palpate.messages.fields import CodecError
from palpate.messages.types.catalogue import LogRecord
from palpate.messages.types.world import World
from palpate.nodes.runtime.node import Finished, Source, Timed, Wiring
from palpate.nodes.runtime.sources import PlaybackClock, SourceWork
from palpate.nodes.runtime.work import ContractError, Outgoing


class Params(msgspec.Struct, frozen=True):
    publications: Any = ()
    paused: bool = False


def line(text: str) -> LogRecord:
    return LogRecord(node="n", level="info", text=text, robot_time=2.5)


def source(**more: Any) -> Source:
    return Source(
        params=Params,
        outputs=lambda params: {"/out": LogRecord},
        open=lambda params: iter(params.publications),
        paused=lambda params: params.paused,
        **more,
    )


WIRING = Wiring(
    name="source", module="", params=b"", inputs=(), outputs={"/out": "/a/out"}, subscribers={}
)


def lines(count: int, every: float = 0.0) -> list[Timed]:
    return [Timed(every * number, "/out", line(str(number))) for number in range(count)]


def work(
    publications: Any, *, paused: bool = False, tally: SourceProgress | None = None, **more: Any
) -> SourceWork:
    made = SourceWork(source(**more), Params(publications, paused), WIRING, tally)
    made.began = list(made.begin())  # type: ignore[attr-defined]
    return made


def texts(parcels: Any) -> list[str]:
    return [decode(LogRecord, one.body).text for one in parcels if isinstance(one, Outgoing)]


def test_what_is_due_is_published_on_the_wire_with_its_robot_time():
    [parcel] = work(lines(1)).publish_due()
    assert isinstance(parcel, Outgoing)
    assert (parcel.topic, parcel.robot_time) == ("/a/out", 2.5)
    assert texts([parcel]) == ["0"]


def test_what_is_due_later_is_not_published_yet():
    made = work(lines(3, every=60.0))
    assert texts(made.publish_due()) == ["0"]
    left = made.wait()
    assert left is not None and 59.0 < left <= 60.0
    assert made.patience(125) == 125


def test_a_short_wait_is_waited_to_its_end():
    assert texts(work(lines(3, every=1e-3)).publish_due()) == ["0", "1", "2"]


def test_encoded_bodies_are_published_as_they_are():
    [parcel] = work([Timed(0.0, "/out", encode(line("x")))]).publish_due()
    assert texts([parcel]) == ["x"]


def test_it_ends_with_its_word_and_has_nothing_to_tell_after_it():
    made = work([*lines(1), Finished("enough")])
    assert list(made.publish_due())[1:] == [Finished("enough")]
    assert made.wait() is None
    assert made.patience(125) == 125


def test_where_there_is_nothing_yet_it_is_asked_again_soon():
    made = work([None, *lines(1)])
    assert texts(made.publish_due()) == []
    assert texts(made.publish_due()) == ["0"]
    assert made.latency.count == 1


def test_an_earlier_starts_messages_are_published_at_once_and_the_rest_in_time(
    tmp_path: Path,
):
    tally = SourceProgress(tmp_path / "tally")
    first = work(lines(5, every=60.0), tally=tally)
    assert texts(first.publish_due()) == ["0"]
    first.obey({"kind": "pause"})
    first.obey({"kind": "step", "number": 2})
    assert texts(first.publish_due()) == ["1", "2"]
    tally.close()
    again = work(lines(5, every=60.0), tally=SourceProgress(tmp_path / "tally"))
    assert texts(again.began) == ["0", "1", "2"]  # type: ignore[attr-defined]
    assert again.wait() is None  # as it stood still before
    again.obey({"kind": "resume"})
    left = again.wait()
    assert left is not None and 59.0 < left <= 60.0


def test_it_stands_still_goes_on_and_steps_when_it_is_told_to():
    made = work(lines(4, every=1e-3), paused=True)
    assert texts(made.publish_due()) == ["0"]
    assert made.wait() is None
    made.obey({"kind": "step", "number": 1})
    assert texts(made.publish_due()) == ["1"]
    made.obey({"kind": "resume"})
    assert texts(made.publish_due()) == ["2", "3"]


def test_tools_may_speak_for_a_source_that_lets_them():
    word = {"kind": "publish", "topic": "/a/out", "body": encode(line("typed"))}
    assert texts(work((), outside=True, repeats=False).obey(word)) == ["typed"]
    assert work(()).obey(word) == []


def test_what_a_tool_publishes_must_be_of_the_topics_type():
    other = encode(World(platform=0.0, reach=0.3, fingers=1, seed=1))
    with pytest.raises(CodecError, match="not a LogRecord"):
        work((), outside=True, repeats=False).obey(
            {"kind": "publish", "topic": "/a/out", "body": other}
        )


@pytest.mark.parametrize(
    ("published", "words"),
    [
        (Timed(0.0, "/else", line("x")), "published /else, which it does not declare"),
        (
            Timed(0.0, "/out", World(platform=0.0, reach=0.3, fingers=1, seed=1)),
            "published a World on /out, declared as LogRecord",
        ),
    ],
)
def test_what_is_not_declared_is_refused(published: Timed, words: str):
    with pytest.raises(ContractError, match=words):
        list(work([published]).publish_due())


def test_it_receives_nothing():
    from palpate.messages.bus.subscriber import Received
    from palpate.messages.codec import Header

    with pytest.raises(ContractError, match="subscribes to nothing, and has received /in"):
        work(()).take(Received("other", "/in", Header(1, 0, 0, 0, 0.0, 0), b""))


def test_what_it_reads_is_let_go_of():
    closed = []

    def read() -> Iterator[Timed]:
        try:
            yield from lines(9, every=60.0)
        finally:
            closed.append(True)

    made = work(read())
    list(made.publish_due())
    made.close()
    assert closed == [True]


def test_what_is_due_later_is_waited_for():
    pace = PlaybackClock()
    pace.start(2.0, 100.0)
    assert pace.wait(2.0, 100.0) == 0.0
    assert pace.wait(3.5, 100.5) == 1.0
    assert pace.wait(3.5, 107.0) == 0.0


def test_while_it_stands_still_only_what_was_due_already_is_published():
    pace = PlaybackClock(paused=True)
    pace.start(0.0, 100.0)
    assert pace.wait(0.0, 105.0) == 0.0
    assert pace.wait(0.1, 105.0) is None


def test_a_pause_takes_no_time_of_the_source():
    pace = PlaybackClock()
    pace.start(0.0, 100.0)
    pace.pause(101.0)
    assert pace.wait(1.5, 150.0) is None
    pace.resume(200.0)
    assert pace.wait(1.5, 200.0) == 0.5


def test_pausing_or_going_on_twice_is_doing_it_once():
    pace = PlaybackClock()
    pace.start(0.0, 100.0)
    pace.pause(101.0)
    pace.pause(110.0)
    pace.resume(120.0)
    pace.resume(120.5)
    assert pace.wait(2.0, 121.0) == 0.0


def test_steps_tell_what_is_next_and_stand_still_again():
    pace = PlaybackClock(paused=True)
    pace.start(0.0, 100.0)
    pace.step(2)
    for due in (5.0, 9.0):
        assert pace.wait(due, 100.0) == 0.0
        pace.gone(due, 100.0)
    assert pace.wait(9.5, 100.0) is None
    pace.resume(300.0)
    assert pace.wait(9.5, 300.0) == 0.5


def test_who_does_not_stand_still_takes_no_steps():
    pace = PlaybackClock()
    pace.start(0.0, 100.0)
    pace.step(3)
    assert pace.wait(5.0, 101.0) == 4.0
