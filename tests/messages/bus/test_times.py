from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from palpate.messages.bus.past import Past
from palpate.messages.bus.times import Times
from palpate.messages.header import Header, pack_frame, split_frame

TOPICS = ["/talk", "/more"]


def test_times_outlive_their_node(tmp_path: Path) -> None:
    first = Times(tmp_path / "times", "talker", TOPICS)
    assert first.before("/talk", 0) is None
    first.note("/talk", 5)
    first.note("/more", 6)
    first.note("/talk", 1 << 60)
    first.close()
    again = Times(tmp_path / "times", "talker", TOPICS)
    again.close()
    said = [again.before(topic, seq) for topic in TOPICS for seq in range(2)]
    assert (said, again.before("/talk", 2)) == ([5, 1 << 60, 6, None], None)


def test_what_is_said_again_keeps_its_time_and_what_is_new_is_later(
    bench: Any, tmp_path: Path
) -> None:
    headers = []
    for epoch in range(2):
        times = Times(tmp_path / "said", "talker", TOPICS)
        talker = bench.publisher(f"talker_{epoch}", epoch=epoch, times=times, again=epoch > 0)
        frames = [
            talker.send(topic, b"", robot_time=0.0, schema=5)
            for topic in ("/talk", "/more", "/talk", *(["/more"] if epoch else []))
        ]
        headers.append([split_frame(frame)[1] for frame in frames])
    first, again = headers
    assert [one._replace(epoch=1) for one in first] == again[:3]
    assert again[3].sent_ns > again[2].sent_ns


@pytest.mark.parametrize("latest", [0, 1 << 62])
def test_who_goes_on_with_what_was_kept_speaks_later_than_that(
    latest: int, bench: Any, tmp_path: Path
) -> None:
    kept = Past(tmp_path / "past", TOPICS, keep=True)
    kept.add("/talk", pack_frame("/talk", Header(1, 0, 0, latest, 0.0, 5), b""))
    kept.close()
    past = Past(tmp_path / "past", TOPICS, keep=True, epoch=1)
    talker = bench.publisher(past=past)
    frame = talker.send("/talk", b"", robot_time=0.0, schema=5)
    past.close()
    assert split_frame(frame)[1].sent_ns > latest
