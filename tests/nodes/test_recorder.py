from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

import palpate
from palpate.messages.codec import Header, encode, schema_hash
from palpate.messages.recording.reader import open_recording
from palpate.messages.types.world import World
from palpate.nodes.recorder import SINK, Params
from palpate.nodes.runtime.node import (
    Input,
    Wiring,
    describe_wirings,
    publishers_of,
    recorded_nodes,
    with_description,
)


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    mesh: bytes
    size: tuple[float, float]
    name: str = "vase"


SIMULATOR = Wiring(
    name="simulator",
    module="palpate.nodes.simulator",
    params=Settings(mesh=b"\0\xff", size=(0.1, 1e-300)),
    inputs=(Input("tracer", "/f1/goal", "/goal", "TouchGoal"),),
    outputs={"/world": "/f1/world"},
    subscribers={"/f1/world": ("recorder",)},
)


def recorder(path: Path) -> Wiring:
    return Wiring(
        name="recorder",
        module="palpate.nodes.recorder",
        params=Params(path=str(path)),
        inputs=(Input("simulator", "/f1/world", "/f1/world", "World"),),
        outputs={},
        subscribers={},
    )


def test_what_is_received_is_kept(tmp_path: Path):
    path = tmp_path / "topics.mcap"
    _, told = with_description([SIMULATOR, recorder(path)], {"seed": "7"})
    body = encode(World(platform=0.0, reach=0.3, fingers=1, seed=3))
    writer = SINK.open(told.params, {"/f1/world": "World"})
    writer.write("/f1/world", Header(1, 0, 0, 5, 0.0, schema_hash(World)), body)
    writer.close({})
    recording = open_recording(path)
    assert recording.version == palpate.__version__
    assert [kept.body for kept in recording.messages()] == [body]
    assert [kept.publisher for kept in recording.messages()] == ["simulator"]
    assert [one.name for one in recorded_nodes(recording.graph)] == ["simulator", "recorder"]


def test_a_recording_without_a_description_is_a_recording(tmp_path: Path):
    path = tmp_path / "topics.mcap"
    SINK.open(Params(path=str(path)), {}).close({})
    assert open_recording(path).graph == b""


def test_a_described_node_comes_back_with_its_parameters():
    [recorded] = recorded_nodes(describe_wirings([SIMULATOR]))
    back = recorded.wiring(Settings)
    assert back.params == SIMULATOR.params
    assert (back.name, back.module) == (SIMULATOR.name, SIMULATOR.module)
    assert (back.inputs, back.outputs) == (SIMULATOR.inputs, SIMULATOR.outputs)


def test_a_description_names_the_publisher_of_each_topic():
    assert publishers_of(describe_wirings([SIMULATOR])) == {"/f1/world": "simulator"}
    assert publishers_of(b"") == {}


def test_only_recorders_are_told(tmp_path: Path):
    first, second = with_description([SIMULATOR, recorder(tmp_path / "a.mcap")], {"seed": "7"})
    assert first is SIMULATOR
    assert second.params.graph
    assert second.params.about == {"seed": "7"}


def test_parameters_that_do_not_fit_are_refused():
    [recorded] = recorded_nodes(describe_wirings([SIMULATOR]))
    with pytest.raises(ValueError, match="the recorded parameters of simulator do not fit"):
        recorded.wiring(Params)


def test_what_is_no_description_is_refused():
    with pytest.raises(ValueError, match="this is no description of a graph"):
        recorded_nodes(b"{]")


@pytest.mark.parametrize("path", ["", "runs/"])
def test_a_path_that_names_no_file_is_refused(path: str):
    with pytest.raises(ValueError, match="path must name a file, got"):
        Params(path=path)


def test_parameters_are_read_strictly():
    with pytest.raises(msgspec.ValidationError, match="unknown field `colour`"):
        msgspec.convert({"path": "a", "colour": 1}, Params)
