"""What users test their nodes with: drive, feed, example and assert_same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from palpate.messages import CodecError, Header, encode, schema_hash
from palpate.messages.recording import RecordingWriter
from palpate.messages.types import TYPES, LogRecord, SensorInfo, TactileFrame, TactileImage, World
from palpate.nodes import curvature, filter
from palpate.nodes.runtime.node import (
    Finished,
    Input,
    Node,
    Outputs,
    Source,
    Timed,
    Wiring,
    describe_wirings,
)
from palpate.nodes.runtime.work import ContractError
from palpate.testing import assert_same, drive, example, feed, messages_on, recorded
from tests.messages.cases import cases
from tests.nodes.loop import INFO

Record = Callable[..., Path]


class Params(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    prefix: str = "got"


def line(text: str) -> LogRecord:
    return LogRecord(node="n", level="info", text=text, robot_time=2.5)


def on_line(params: Params, count: int, message: LogRecord) -> tuple[int, Outputs]:
    if message.text == "end":
        return count, [Finished("done")]
    return count + 1, [("/out", line(f"{params.prefix} {count} {message.text}"))]


NODE = Node(
    params=Params,
    start=lambda params: (0, []),
    inputs={"/in": (LogRecord, on_line), "/need": (LogRecord, on_line)},
    outputs={"/out": LogRecord},
    needs=("/need",),
)


def texts(published: list[Any]) -> list[str]:
    return [one.reason if isinstance(one, Finished) else one[1].text for one in published]


def test_node_publishes_what_handlers_return_once_its_needs_have_come():
    received = [("/in", line("a")), ("/in", line("b"))]
    assert drive(NODE, received) == []
    published = drive(NODE, [*received, Finished("x"), ("/need", line("n")), ("/in", line("end"))])
    assert texts(published) == ["got 0 n", "got 1 a", "got 2 b", "done"]
    for params in ({"prefix": "had"}, Params(prefix="had")):
        assert texts(drive(NODE, [("/need", line("n"))], params)) == ["had 0 n"]


def write_into(params: Params, state: int, image: TactileImage) -> tuple[int, Outputs]:
    image.compression[0, 0] = 1.0
    return state, []


SPOILING = replace(NODE, inputs={"/in": (TactileImage, write_into)}, needs=())
IMAGE = example(TactileImage, compression=np.zeros((4, 4)))


def source(*published: object) -> Source:
    outputs = {"/out": LogRecord}
    return Source(params=Params, outputs=lambda _: outputs, open=lambda _: iter(published))


@cases(
    "node, received, params, error, words",
    (NODE, [("/inn", line("n"))], None, ValueError, "subscribe to /inn; it subscribes to /in,"),
    (NODE, [("/in", 3)], None, ValueError, "subscribes to /in as LogRecord, got a int"),
    (NODE, [("/in", replace(line(""), robot_time=np.nan))], None, CodecError, "must be finite"),
    (NODE, [], {"sais": 1}, ValueError, "the parameters do not fit: .*sais"),
    (NODE, [], {"prefix": 1}, ValueError, "the parameters do not fit: Expected `str`"),
    (NODE, [], {"prefix": object()}, ValueError, "the parameters do not fit"),
    (SPOILING, [("/in", IMAGE)], None, ValueError, "read-only"),
    (source(), [("/in", line("a"))], None, ValueError, "a source subscribes to nothing"),
    (source(Timed(0.0, "/x", line(""))), [], None, ContractError, "/x, .*; it declares /out"),
    (source(Timed(0.0, "/out", example(World))), [], None, ContractError, "published a World on"),
)
def test_what_the_runtime_would_refuse_is_refused(node, received, params, error, words):
    with pytest.raises(error, match=words):
        drive(node, received, params)


def test_source_is_driven_to_its_end_without_waiting():
    late = Timed(60.0, "/out", encode(line("b")))
    made = [Timed(0.0, "/out", line("a")), None, late, Finished("e")]
    assert texts(drive(source(*made, Timed(1, "/x", 1)))) == ["a", "b", "e"]
    assert texts(drive(source(*made), most=1)) == ["a"]


def test_example_has_the_given_fields_and_plain_ones_otherwise():
    image = example(TactileImage, touch=3)
    assert (image.touch, image.outcome, image.mask.shape) == (3, "hit", (0, 0))
    assert all(encode(example(cls)) for cls in TYPES.values())
    with pytest.raises(ValueError, match="a World has no hight; it has platform, held, reach"):
        example(World, hight=1)
    with pytest.raises(CodecError, match="seed must be int"):
        example(World, seed="x")


@cases(
    "expected, words",
    ([("/out", line("b"))], r"^0: /out text: published 'a', expected 'b'$"),
    ([("/x", line("a"))], r"^0: published a LogRecord on /out, expected a LogRecord on /x$"),
    ([("/out", example(World))], r"expected a World on /out$"),
    ([Finished("a")], r"^0: published a LogRecord on /out, expected Finished\('a'\)$"),
    ([], r"^published 1, expected 0; more was published: a LogRecord on /out$"),
    ([("/out", line("a")), Finished("end")], r"^.*expected 2; not published: Finished\('end'\)$"),
)
def test_first_difference_is_told(expected: list[Any], words: str):
    with pytest.raises(AssertionError, match=words):
        assert_same([("/out", line("a"))], expected)
    assert_same(*([("/out", line("a")), Finished("done")] for _ in range(2)))
    with pytest.raises(AssertionError, match=r"reach: published 0.0, expected -0.0"):
        assert_same(*([("/world", example(World, reach=value))] for value in (0.0, -0.0)))


def wiring(name: str) -> Wiring:
    return Wiring(
        name=name,
        module="palpate.nodes.filter",
        params=filter.Params(contact=100e-6),
        inputs=(
            Input("simulator", "/touch/info", "/touch/info", "SensorInfo"),
            Input("simulator", "/f/raw", "/touch/raw", "TactileFrame"),
        ),
        outputs={"/touch/image": "/f/image"},
        subscribers={},
    )


def frame(touch: int, info: SensorInfo) -> TactileFrame:
    pressed = np.zeros((16, 16))
    pressed[6:10, 6:10] = 80e-6 + 1e-5 * touch
    array = 2.0 * (info.thickness - pressed) / info.sound_speed
    pose = np.array([0.0, 0, 0, 0, 0, 0, 1])
    fields = {"touch": touch, "finger": 1, "direction": np.array([1.0, 0.0, 0.0])}
    return example(TactileFrame, **fields, pose=pose, array=array, robot_time=float(touch))


@pytest.fixture
def record(tmp_path: Path) -> Record:
    """Writes a recording of filters, of which one received three frames."""

    def make(*graph: str) -> Path:
        received: list[tuple[str, Any]] = [("/touch/info", INFO)]
        received += [("/touch/raw", frame(touch, INFO)) for touch in range(3)]
        published = drive(filter.NODE, received, {"contact": 100e-6})
        sent = [(topic.replace("touch", "f"), message) for topic, message in received[1:]]
        sent += [("/f/image", image) for image in messages_on(published, "/touch/image")]
        about = {"graph": describe_wirings([*map(wiring, graph)]).decode() if graph else ""}
        types = {"/touch/info": "SensorInfo", "/f/raw": "TactileFrame", "/f/image": "TactileImage"}
        writer = RecordingWriter(tmp_path / "topics.mcap", types, {}, about)
        # The recorder received the sensor last, though it was sent first.
        for time, (topic, message) in [*enumerate([received[0], *sent])][::-1]:
            seq = sum(t == topic for t, _ in [received[0], *sent][:time])
            header = Header(1, 0, seq, time, 0.0, schema_hash(type(message)))
            writer.write(topic, header, encode(message))
        writer.close()
        return tmp_path / "topics.mcap"

    return make


def only(topic: str) -> Any:
    return {topic: curvature.NODE.inputs[topic]}


def test_node_fed_with_a_recording_publishes_as_recorded_also_a_new_one(
    record: Record,
):
    path, own = record("filter"), replace(filter.NODE)
    published = feed(filter.NODE, path)
    images = sorted(recorded(path, "/f/image", TactileImage), key=lambda image: image.touch)
    assert [image.touch for image in images] == [0, 1, 2] and len(recorded(path, "/f/raw")) == 3
    assert_same(published, [("/touch/image", image) for image in images])
    assert_same(feed(filter.NODE, path.parent), published)
    assert_same(feed(own, path, name="filter", params={"contact": 100e-6}), published)
    lower = messages_on(feed(filter.NODE, path, params={"contact": 50e-6}), "/touch/image")
    assert [int(image.mask.sum()) for image in lower] == [16, 16, 16]
    assert not messages_on(published, "/touch/image")[0].mask.any()
    inputs = {**only("/touch/info"), "/f/image": curvature.NODE.inputs["/touch/image"]}
    path.unlink()
    patches = messages_on(feed(replace(curvature.NODE, inputs=inputs), record()), "/touch/patch")
    assert [patch.touch for patch in patches] == [0, 1, 2]


BLIND = replace(curvature.NODE, inputs=only("/touch/image"), needs=())


@cases(
    "graph, node, name, words",
    (["filter"], filter.NODE, "fliter", "has no node 'fliter'; it has filter"),
    ([], filter.NODE, "filter", "has no node 'filter'; it has none"),
    (["a", "b"], filter.NODE, None, "has a, b; say with name whose place to take"),
    (["filter"], BLIND, "filter", "/touch/image, none of what filter received in it"),
    ([], BLIND, None, "the node subscribes to /touch/image, none of its topics"),
)
def test_place_that_is_not_there_is_refused(record: Record, graph, node, name, words):
    with pytest.raises(ValueError, match=words):
        feed(node, record(*graph), name=name)


def test_topic_or_type_that_is_not_there_is_refused(record: Record, tmp_path: Path):
    path = record()
    for topic, cls, words in (
        ("/raw", None, "has nothing on /raw; it has /f/image, /f/raw"),
        ("/f/raw", World, "/f/raw is not a World of this version"),
    ):
        with pytest.raises(ValueError, match=words):
            recorded(path, topic, cls)
    with pytest.raises(ValueError, match="cannot be read"):
        recorded(tmp_path / "no.mcap", "/f/raw")
