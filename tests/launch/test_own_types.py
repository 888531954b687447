from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from palpate.launch.graph import Entry, Graph
from palpate.launch.located import InputError
from palpate.messages.codec import encode, schema, schema_hash
from palpate.messages.header import Header
from palpate.messages.quantity import Metres
from palpate.messages.recording.framing import records
from palpate.messages.types import World
from palpate.nodes import recorder
from palpate.nodes.recording import schemas_of, with_description
from palpate.nodes.wiring import Wiring

MakeNode = Callable[..., str]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Width:
    width: Metres


def named(name: str) -> type:
    """Another message type of one's own, with this name."""

    @dataclass(frozen=True, slots=True, eq=False, kw_only=True)
    class Made:
        height: Metres

    Made.__name__ = name
    return Made


def graph(make_node: MakeNode, path: Path, *says: type) -> tuple[Wiring, ...]:
    for number, cls in enumerate(says):
        make_node(f"t.n{number}", says={f"/n{number}": cls})
    entries = [Entry(name=f"n{i}", kind=f"t.n{i}") for i in range(len(says))]
    keeps = Entry(name="recorder", params={"path": str(path)})
    return Graph((*entries, keeps), ends="n0").wirings()


def test_a_recording_has_the_schemas_of_types_of_ones_own(
    make_node: MakeNode, tmp_path: Path
) -> None:
    path = tmp_path / "topics.mcap"
    wirings = with_description(graph(make_node, path, Width, World), {})
    params = wirings[-1].params
    assert schemas_of(params.graph) == {"Width": json.dumps(schema(Width))}

    types = {one.topic: one.type for one in wirings[-1].inputs}
    writer = recorder.SINK.open(params, types)
    header = Header(1, 0, 0, 5, 0.0, schema_hash(Width))
    writer.write("/n0", header, encode(Width(width=0.01)))
    writer.close({})
    kept = {one.name: one.data for one in records(path) if type(one).__name__ == "Schema"}  # type: ignore[union-attr]
    assert json.loads(kept["Width"]) == schema(Width)


def test_without_its_schema_a_type_of_ones_own_is_not_recorded(tmp_path: Path) -> None:
    params = recorder.Params(path=str(tmp_path / "topics.mcap"))

    assert schemas_of(b"") == {}
    with pytest.raises(ValueError, match="no message type to record /n0 as Width"):
        recorder.SINK.open(params, {"/n0": "Width"})


@pytest.mark.parametrize(
    ("says", "words"),
    [
        ((named("World"),), "node 'n0': publishes /n0 as World of .*, but palpate.messages.types"),
        ((Width, named("Width")), "node 'n1': publishes /n1 as Width of .*; call it otherwise"),
        ((int,), "node 'n0': publishes /n0: int is not a message type"),
    ],
)
def test_types_that_could_not_be_told_apart_are_refused(
    make_node: MakeNode, tmp_path: Path, says: tuple[type, ...], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        graph(make_node, tmp_path / "topics.mcap", *says)


def test_one_type_may_be_on_two_topics(make_node: MakeNode, tmp_path: Path) -> None:
    assert graph(make_node, tmp_path / "topics.mcap", Width, Width)
