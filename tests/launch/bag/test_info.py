from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from palpate.launch.bag.info import bag_info
from palpate.launch.bag.info_text import info_text, size_text
from palpate.launch.cli import main as cli
from palpate.launch.located import InputError
from palpate.messages.codec import encode
from palpate.messages.types import LogRecord, World

Record = Callable[..., Path]

WORLD = World(platform=0.0, reach=0.3, fingers=1, seed=3)
LOG = LogRecord(node="filter", level="info", text="x" * 100, robot_time=0.0)
MESSAGES = [("/world", WORLD), *[("/log", LOG)] * 30]
GRAPH = json.dumps(
    [{"name": name, "module": "m", "params": {}, "inputs": [], "outputs": {}} for name in "ab"]
)


def test_a_recording_says_what_it_holds(record: Record) -> None:
    path = record(MESSAGES, graph=GRAPH)

    info = bag_info(path)

    sizes = [30 * len(encode(LOG)), len(encode(WORLD))]
    assert info["parts"] == [{"path": str(path), "bytes": info["bytes"], "closed": True}]
    assert info["bytes"] == path.stat().st_size
    assert (info["version"], info["closed"], info["end"]) == ("1.2.3", True, None)
    assert (info["messages"], info["nodes"]) == (31, ["a", "b"])
    assert info["duration_s"] == pytest.approx(30 * 0.007)
    assert info["topics"] == [
        {
            "topic": topic,
            "type": kind,
            "publisher": "somebody",
            "messages": count,
            "bytes": size,
            "share": size / sum(sizes),
        }
        for topic, kind, count, size in zip(
            ["/log", "/world"], ["LogRecord", "World"], [30, 1], sizes, strict=True
        )
    ]
    assert info["metadata"]["palpate"] == {"version": "1.2.3", "graph": len(GRAPH)}
    assert info["metadata"]["counts"] == {"/log": "30", "/world": "1"}


def test_a_recording_that_is_cut_off_is_shown_up_to_the_cut(record: Record) -> None:
    path = record(MESSAGES)
    size = path.stat().st_size // 2
    path.write_bytes(path.read_bytes()[:size])

    info = bag_info(path)

    assert not info["closed"] and info["end"] is not None
    assert info["end"]["why"] == f"is cut off at byte {size}"
    assert 0 < info["end"]["byte"] < size
    assert 0 < info["messages"] < 31
    assert "no: topics.mcap is cut off at byte" in info_text(info)


def test_a_recording_that_was_never_closed_says_so(record: Record) -> None:
    path = record(MESSAGES, close=False)

    info = bag_info(path)

    size = path.stat().st_size
    assert info["end"] == {"path": str(path), "byte": size, "why": "was never closed"}
    assert "counts" not in info["metadata"]


def test_the_parts_of_a_recording_are_listed_and_counted_together(record: Record) -> None:
    path = record(MESSAGES[:11], close=False)
    had = bag_info(path)["messages"]
    record(MESSAGES, name="topics.1.mcap", skip=had)

    info = bag_info(path.parent)

    assert [part["closed"] for part in info["parts"]] == [False, True]
    assert (info["closed"], info["messages"]) == (True, 31)
    assert "topics.1.mcap" in info_text(info)


def test_a_graph_that_is_none_is_not_believed(record: Record) -> None:
    info = bag_info(record(MESSAGES, graph="[{}]"))

    assert info["nodes"] == []
    assert "nodes      not known" in info_text(info)


def test_a_text_that_steers_a_terminal_is_shown_in_quotes(record: Record) -> None:
    info = bag_info(record(MESSAGES, publisher="\x1b[31mred", graph="\x1b"))

    assert "\x1b" not in info_text(info)
    assert info["topics"][0]["publisher"] == r"'\x1b[31mred'"


def test_lines_for_people(record: Record) -> None:
    lines = info_text(bag_info(record(MESSAGES, graph=GRAPH))).splitlines()

    assert lines[1:6] == [
        "version    1.2.3",
        "closed     yes",
        "duration   0.210 s",
        "messages   31",
        "nodes      a, b",
    ]
    assert f"metadata   palpate: version 1.2.3, graph of {len(GRAPH)} characters" in lines
    assert "metadata   counts: /log 30, /world 1" in lines
    assert lines[-3].split() == ["topic", "type", "publisher", "messages", "bytes", "share"]
    assert lines[-2].split()[:4] == ["/log", "LogRecord", "somebody", "30"]
    assert len({len(line) for line in lines[-3:]}) == 1


@pytest.mark.parametrize(
    ("size", "text"),
    [(0, "0 B"), (999, "999 B"), (1500, "1.5 kB"), (2e6, "2.0 MB"), (3e9, "3.0 GB")],
)
def test_sizes_have_the_unit_that_suits_them(size: int, text: str) -> None:
    assert size_text(int(size)) == text


@pytest.mark.parametrize(
    ("data", "words"), [(b"", "it is empty"), (b"x" * 99, "it is not an MCAP file")]
)
def test_what_is_no_recording_is_refused(tmp_path: Path, data: bytes, words: str) -> None:
    (tmp_path / "a.mcap").write_bytes(data)

    with pytest.raises(InputError, match=f"a.mcap: cannot be read as a recording: {words}"):
        bag_info(tmp_path / "a.mcap")


def test_the_exit_code_says_whether_a_recording_is_whole(
    record: Record, capsys: pytest.CaptureFixture[str]
) -> None:
    path = record(MESSAGES)

    assert cli.run(["bag", "info", str(path)]) == 0
    assert capsys.readouterr().out.startswith(f"recording  {path}")
    path.write_bytes(path.read_bytes()[:-3])
    assert cli.run(["bag", "info", str(path), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["closed"] is False
    assert cli.run(["bag", "info", "none.mcap"]) == 2
    assert capsys.readouterr().err == "palpate: none.mcap: the recording does not exist\n"
