from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.messages.codec import Header, encode, schema_hash
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types.touch import TactileFrame, TactileImage
from palpate.messages.types.world import SensorInfo, World
from palpate.nodes import curvature, filter
from palpate.nodes.runtime.node import Input, Node, Wiring, describe_wirings
from palpate.nodes.runtime.testing import assert_same, drive, example, feed, messages_on, recorded

TYPES = {"/touch/info": "SensorInfo", "/f/raw": "TactileFrame", "/f/image": "TactileImage"}
Record = Callable[..., Path]


def wiring(name: str, params: Any = None) -> Wiring:
    return Wiring(
        name=name,
        module="palpate.nodes.filter",
        params=params or filter.Params(contact=100e-6),
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
    return example(
        TactileFrame,
        touch=touch,
        finger=1,
        direction=np.array([1.0, 0.0, 0.0]),
        pose=np.array([0.0, 0, 0, 0, 0, 0, 1]),
        array=2.0 * (info.thickness - pressed) / info.sound_speed,
        robot_time=float(touch),
    )


@pytest.fixture
def record(tmp_path: Path, info: SensorInfo) -> Record:
    """Writes a recording of two filters, of which one received three frames."""

    def make(*graph: Wiring, name: str = "topics.mcap") -> Path:
        received: list[tuple[str, Any]] = [("/touch/info", info)]
        received += [("/touch/raw", frame(touch, info)) for touch in range(3)]
        published = drive(filter.NODE, received, {"contact": 100e-6})
        images = [("/f/image", image) for image in messages_on(published, "/touch/image")]
        # The recorder received the sensor last, though it was sent first.
        sent = [received[0], *((t.replace("touch", "f"), m) for t, m in received[1:]), *images]
        about = {"graph": describe_wirings(graph).decode() if graph else ""}
        writer = RecordingWriter(tmp_path / name, TYPES, {}, about)
        for time, (topic, message) in [*enumerate(sent)][::-1]:
            seq = sum(t == topic for t, _ in sent[:time])
            writer.write(
                topic, Header(1, 0, seq, time, 0.0, schema_hash(type(message))), encode(message)
            )
        writer.close()
        return tmp_path / name

    return make


def test_a_node_publishes_what_it_published_when_it_was_recorded(record: Record):
    path = record(wiring("filter"))
    published = feed(filter.NODE, path)
    assert [image.touch for image in messages_on(published, "/touch/image")] == [0, 1, 2]
    images = sorted(recorded(path, "/f/image", TactileImage), key=lambda image: image.touch)
    assert_same(published, [("/touch/image", image) for image in images])
    assert_same(feed(filter.NODE, path.parent), published)


def test_parameters_may_be_others_than_were_recorded(record: Record):
    path = record(wiring("filter"))
    lower = messages_on(feed(filter.NODE, path, params={"contact": 50e-6}), "/touch/image")
    assert [int(image.mask.sum()) for image in lower] == [16, 16, 16]
    assert not messages_on(feed(filter.NODE, path), "/touch/image")[0].mask.any()


def test_a_new_node_takes_the_place_that_is_named(record: Record):
    path, own = record(wiring("filter")), replace(filter.NODE)
    published = feed(own, path, name="filter", params={"contact": 100e-6})
    assert_same(published, feed(filter.NODE, path))
    with pytest.raises(
        ValueError, match="subscribes to /touch/image, none of what filter received in it"
    ):
        feed(replace(curvature.NODE, inputs=only("/touch/image")), path, name="filter")


def only(topic: str) -> Any:
    return {topic: curvature.NODE.inputs[topic]}


def test_a_node_that_was_not_there_receives_its_topics(record: Record):
    path, received = record(), curvature.NODE.inputs["/touch/image"]
    node = replace(
        curvature.NODE,
        inputs={"/touch/info": curvature.NODE.inputs["/touch/info"], "/f/image": received},
    )
    patches = messages_on(feed(node, path), "/touch/patch")
    assert [patch.touch for patch in patches] == [0, 1, 2]


@pytest.mark.parametrize(
    ("graph", "name", "words"),
    [
        (["filter"], "fliter", "has no node 'fliter'; it has filter"),
        ([], "filter", "has no node 'filter'; it has none"),
        (["a", "b"], None, "has a, b; say with name whose place to take"),
    ],
)
def test_a_place_that_is_not_there_is_told(
    record: Record, graph: list[str], name: str | None, words: str
):
    with pytest.raises(ValueError, match=words):
        feed(filter.NODE, record(*map(wiring, graph)), name=name)


def test_a_node_that_receives_nothing_of_the_recording_is_told(record: Record):
    node: Node = replace(curvature.NODE, inputs=only("/touch/image"), needs=())
    with pytest.raises(ValueError, match="the node subscribes to /touch/image, none of its topics"):
        feed(node, record())


def test_a_topic_or_type_that_is_not_there_is_told(record: Record, tmp_path: Path):
    path = record()
    with pytest.raises(ValueError, match="has nothing on /raw; it has /f/image, /f/raw"):
        recorded(path, "/raw")
    with pytest.raises(ValueError, match="/f/raw is not a World of this version"):
        recorded(path, "/f/raw", World)
    with pytest.raises(ValueError, match="cannot be read"):
        recorded(tmp_path / "no.mcap", "/f/raw")
    assert len(recorded(path, "/f/raw")) == 3
