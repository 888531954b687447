"""A toy node that counts frames and passes them on, with which the bus is measured."""

from __future__ import annotations

import multiprocessing
import os
import sys
import time

import msgspec
import numpy as np

from palpate.messages.types import TactileFrame
from palpate.nodes.runtime.node import Finished, Input, Node, Outputs, Wiring

MODULE = __name__
# Content of every frame: only its size matters.
DIRECTION = np.array([0.0, 0.0, 1.0])
POSE = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
TAXELS = np.full((16, 16), 2e-6)


class ToyParams(msgspec.Struct, frozen=True, kw_only=True):
    """What a toy does."""

    burst: int = 0  # Frames published at the start
    laps: int = 0  # Answers a frame with the next one until it has published this many
    relay: bool = False  # Publishes what it receives
    expects: int = 0  # Finishes when it has received this many; 0: never
    work: float = 0.0  # [s] that each message takes
    late: float = 0.0  # [s] after which its process begins to join
    core: int = -1  # Processor core on which it runs; -1: any

    def __post_init__(self) -> None:
        """Wait for `late` and settle on the core, if this is the toy's own process."""
        if multiprocessing.parent_process() is not None:
            time.sleep(self.late)
            settle(self.core)


def settle(core: int) -> None:
    """Keep all threads of this process on one core; -1 leaves them free."""
    if core >= 0 and sys.platform == "linux":
        for thread in os.listdir("/proc/self/task"):
            os.sched_setaffinity(int(thread), {core})


def frame(touch: int) -> TactileFrame:
    """Frame of 16 by 16 taxels with this number of its touch."""
    return TactileFrame(
        goal=0,
        touch=touch,
        finger=1,
        direction=DIRECTION,
        pose=POSE,
        outcome="hit",
        array=TAXELS,
        robot_time=0.1 * touch,
    )


def toy(
    name: str, params: ToyParams, *, upstream: str = "", subscribers: tuple[str, ...] = ()
) -> Wiring:
    """Wiring of a toy that publishes ``/<name>`` and subscribes to at most one other."""
    inputs = (Input(upstream, f"/{upstream}", "/in", "TactileFrame"),) if upstream else ()
    outputs = {"/out": f"/{name}", "/mark": f"/{name}/mark"}
    return Wiring(
        name=name,
        module=MODULE,
        params=params,
        inputs=inputs,
        outputs=outputs,
        subscribers={f"/{name}": subscribers},
        types=dict.fromkeys(outputs.values(), "TactileFrame"),
    )


def token_ring(laps: int, core: int = -1, nodes: int = 2) -> list[Wiring]:
    """Toys that pass a frame around `laps` times; two toys pass it there and back."""
    names = ["source", *(f"relay{i}" if i else "relay" for i in range(nodes - 1))]
    params = [ToyParams(burst=1, laps=laps, expects=laps, core=core)]
    params += [ToyParams(relay=True, core=core)] * (nodes - 1)
    upstream = [names[-1], *names[:-1]]
    ring = zip(names, params, upstream, strict=True)
    return [toy(name, one, upstream=before) for name, one, before in ring]


def _start(params: ToyParams) -> tuple[int, Outputs]:
    return 0, [("/out", frame(touch)) for touch in range(params.burst)]


def _on_frame(params: ToyParams, received: int, message: TactileFrame) -> tuple[int, Outputs]:
    if message.touch != received:
        raise ValueError(f"expected number {received}, got {message.touch}")
    received += 1
    if params.work:
        time.sleep(params.work)
    outputs: Outputs = []
    if params.relay:
        outputs.append(("/out", message))
    elif params.laps > received:
        outputs.append(("/out", frame(received)))
    if params.laps and received in (1, params.laps):
        outputs.append(("/mark", message))
    if received == params.expects:
        outputs.append(Finished(f"{received} received"))
    return received, outputs


NODE = Node(
    params=ToyParams,
    start=_start,
    inputs={"/in": (TactileFrame, _on_frame)},
    outputs={"/out": TactileFrame, "/mark": TactileFrame},
)
