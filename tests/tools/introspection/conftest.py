import msgspec
import pytest

from palpate.launch.processes.registry import RunCard
from palpate.messages.codec import Header
from palpate.nodes.runtime.node import Input, RecordedNode
from palpate.tools.introspection.topics import TapMessage


@pytest.fixture
def copy():
    """A copy of the message with this number, sent at this time, s."""

    def make(seq, sent, *, late=0.0, body=b""):
        sent_ns, came_ns = round(1e9 * sent), round(1e9 * (sent + late))
        return TapMessage("/t", "talker", Header(1, 0, seq, sent_ns, 0.0, 0), body, 0, came_ns)

    return make


@pytest.fixture
def card():
    """A talker whom a hearer hears."""
    params = {"size": 3, "mesh": b"\0" * 300, "text": "some words " * 40, "deep": {"pose": [1.5]}}
    talker = RecordedNode(
        name="talker",
        module="palpate.nodes.talker",
        params=msgspec.Raw(msgspec.json.encode(params)),
        inputs=(),
        outputs={"/out": "/t", "/odd": "/odd"},
        types={"/t": "TactileFrame", "/odd": "NoSuchType"},
    )
    hearer = RecordedNode(
        name="hearer",
        module="my_lab.hearer",
        params=msgspec.Raw(b"{}"),
        inputs=(Input("talker", "/t", "/in", "TactileFrame"),),
        outputs={},
    )
    return RunCard(
        run="ab12cd34ab12cd34",
        name="vase",
        pid=7,
        began="2026-01-01T00:00:00",
        folder="",
        ends="talker",
        nodes=(talker, hearer),
        taps={"talker": "ipc:///nowhere/t0", "hearer": "ipc:///nowhere/t1"},
        tools="ipc:///nowhere/tools",
    )
