"""A graph of one talking node in a thread of the test, for tools that look at running graphs."""

import json
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from palpate.launch.processes.registry import Announcement, RunCard, addresses_of, private_folder
from palpate.messages import Count, Header, PerMetre, encode, pack_frame, schema, schema_hash
from palpate.messages.bus import FROM_TOOLS, ControlServer, NodeSockets, SocketContext
from palpate.messages.types import NodeStatus
from palpate.nodes.filter import Params
from palpate.nodes.runtime.node import Input, RecordedNode
from palpate.nodes.runtime.testing import example

WIRES = {"/out": "/t", "/odd": "/odd", "/own": "/own", "/model": "/m"}
TYPES = {"/t": "TactileFrame", "/odd": "NoSuchType", "/own": "Bends", "/m": "ShapeModel"}
PARAMS = {"size": 3, "mesh": b"\0" * 300, "text": "some words " * 40, "deep": {"pose": [1.5]}}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Bends:
    """A message type that palpate does not have."""

    goal: Count
    curvature: PerMetre


def node(name: str, module: str, params: Any = None, **more: Any) -> RecordedNode:
    raw = msgspec.Raw(msgspec.json.encode(params or {}))
    return RecordedNode(
        name=name, module=module, params=raw, **{"inputs": (), "outputs": {}, **more}
    )


NODES = (
    node(
        "talker",
        "my_lab.talker",
        PARAMS,
        outputs=WIRES,
        types=TYPES,
        schemas={"Bends": json.dumps(schema(Bends))},
    ),
    node("hearer", "my_lab.hearer", inputs=(Input("talker", "/t", "/in", "TactileFrame"),)),
    node("cleaner", "palpate.nodes.filter", Params(contact=1e-4)),
    node("player", "palpate.nodes.player", {"path": "a.mcap"}),
)


class ToyGraph(threading.Thread):
    """The talker's sockets and the launcher's answers; used by one thread at a time."""

    def __init__(self, folder: Path) -> None:
        super().__init__(daemon=True)
        names = [one.name for one in NODES]
        place = addresses_of(folder, names, 100, folder)
        self.card = RunCard(
            run=f"{place.run:016x}",
            name="vase",
            pid=os.getpid(),
            began="2026-01-01T00:00:00",
            folder="",
            ends="talker",
            nodes=NODES,
            taps=dict(place.taps),
            tools=place.tools,
        )
        Announcement(folder, self.card)
        subscribed = {topic: ("hearer",) for topic in TYPES}
        self.sockets = NodeSockets("talker", place, subscriptions={}, publications=subscribed)
        self._context = SocketContext()
        self._tools = ControlServer(self._context.context, place.tools, accepts=FROM_TOOLS)
        self._run, self._folder, self._ended = place.run, folder, threading.Event()
        self.copies: list[bytes] = []  # sent to each tool that begins to listen
        self.requests: list[dict[str, Any]] = []  # of tools, but those for the status
        self.refusing = ""  # why requests are refused, if they are
        about = {"pid": 9, "restarts": 0, "silent_s": 0.1}
        self.nodes = {name: dict(about) for name in names}  # as the launcher describes them
        self.status = {"node": "talker", "state": "running", "messages": 5, "sent": 7}

    def copy(self, topic: str, seq: int, message: Any, **fields: Any) -> None:
        """Add a copy of a message, with this number; other `fields` of its header by name."""
        raw = isinstance(message, bytes)
        header = {"run": self._run, "epoch": 0, "sent_ns": 0, "robot_time": 0.0}
        header |= {"schema": 0 if raw else schema_hash(type(message)), **fields}
        body = message if raw else encode(message)
        self.copies.append(pack_frame(topic, Header(seq=seq, **header), body))

    def publish(self, topic: str, message: Any, *, copied: bool = True) -> None:
        """Publish a message, of which the copy for tools may be lost, before the thread starts."""
        send = self.sockets.send if copied else self.sockets.publisher.send
        send(topic, encode(message), 0.0, schema_hash(type(message)))

    def run(self) -> None:
        """Serve tools until the end."""
        tap = self.sockets.tap
        while not self._ended.wait(2e-3):
            for frame in self.copies if tap.refresh() else ():
                tap.socket.send(frame)
            self.status["cpu"] = self.status.get("cpu", 0.0) + 1e-3
            tap.publish(example(NodeStatus, **self.status))
            while (asked := self._tools.receive()) is not None:
                self._answer(*asked)

    def _answer(self, tool: str, asked: dict[str, Any]) -> None:
        if asked["kind"] == "status":
            self._tools.send(tool, "status", launcher=7, for_s=3.0, nodes=self.nodes)
            return
        self.requests.append(asked)
        if self.refusing:
            self._tools.send(tool, "refused", text=self.refusing)
        else:
            self._tools.send(tool, "done")

    def vanish(self) -> None:
        """Take the card away, as a graph that ends."""
        (self._folder / "run.json").unlink()

    def close(self) -> None:
        self._ended.set()
        if self.is_alive():
            self.join()
        self._tools.close()
        self._context.close()
        self.sockets.close()


@contextmanager
def toy_graph() -> Iterator[ToyGraph]:
    """A graph that is announced; it serves tools from its `start` on."""
    with private_folder(None) as folder:
        graph = ToyGraph(folder)
        try:
            yield graph
        finally:
            graph.close()
