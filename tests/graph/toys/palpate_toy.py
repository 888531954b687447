"""A node that counts and passes on; it may begin late, work long and stall."""

from __future__ import annotations

import multiprocessing
import time

import msgspec
import numpy as np

from palpate.messages.types import TactileFrame
from palpate.nodes.runtime.node import Finished, Input, Node, Outputs, Wiring


class ToyParams(msgspec.Struct, frozen=True, kw_only=True):
    burst: int = 0  # Frames published at the start
    laps: int = 0  # Publishes the next frame when one comes, until it has published this many
    relay: bool = False  # Publishes what it receives
    expects: int = 0  # Finishes when it has received this many; 0 never does
    work: float = 0.0  # Time that each message takes [s]
    stall: tuple[int, float] = (-1, 0.0)  # Message at which it stands still, and how long [s]
    late: float = 0.0  # Time after which its process begins to join [s]

    def __post_init__(self) -> None:
        if multiprocessing.parent_process() is not None:
            time.sleep(self.late)


def frame(touch: int) -> TactileFrame:
    """Frame of 16 by 16 taxels with this number."""
    return TactileFrame(
        goal=0,
        touch=touch,
        finger=1,
        direction=np.array([0.0, 0.0, 1.0]),
        pose=np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
        outcome="hit",
        array=np.full((16, 16), 2e-6),
        robot_time=0.1 * touch,
    )


def wiring(name: str, module: str, params: object, upstream: str = "", **more: object) -> Wiring:
    """Wiring of a toy that subscribes to at most one other."""
    inputs = (Input(upstream, f"/{upstream}", "/in", "TactileFrame"),) if upstream else ()
    options = {"inputs": inputs, "outputs": {"/out": f"/{name}"}, "subscribers": {}, **more}
    return Wiring(name=name, module=module, params=params, **options)  # type: ignore[arg-type]


def toy(name: str, *, upstream: str = "", **params: object) -> Wiring:
    """Wiring of this node, which publishes ``/<name>``, and ``/<name>/mark`` at its ends."""
    outputs = {"/out": f"/{name}", "/mark": f"/{name}/mark"}
    types = dict.fromkeys(outputs.values(), "TactileFrame")
    made = ToyParams(**params)  # type: ignore[arg-type]
    return wiring(name, __name__, made, upstream, outputs=outputs, types=types)


def _start(params: ToyParams) -> tuple[int, Outputs]:
    return 0, [("/out", frame(touch)) for touch in range(params.burst)]


def _on_frame(params: ToyParams, received: int, message: TactileFrame) -> tuple[int, Outputs]:
    if message.touch != received:
        raise ValueError(f"expected number {received}, got {message.touch}")
    received += 1
    place, seconds = params.stall
    if pause := seconds if place == received else params.work:
        time.sleep(pause)
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
