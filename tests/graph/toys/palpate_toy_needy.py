"""A node that handles nothing before it has received what it needs."""

from __future__ import annotations

import msgspec

from palpate.messages.types import TactileFrame
from palpate.nodes.runtime.node import Finished, Node, Outputs


class Params(msgspec.Struct, frozen=True, kw_only=True):
    pass


def _on_need(params: Params, received: tuple[str, ...], _: TactileFrame) -> tuple[object, Outputs]:
    return (*received, "need"), []


def _on_frame(params: Params, received: tuple[str, ...], _: TactileFrame) -> tuple[object, Outputs]:
    if "need" not in received:
        raise RuntimeError("received a frame before what it needs")
    return (*received, "frame"), [Finished("all there")]


NODE = Node(
    params=Params,
    start=lambda params: ((), []),
    inputs={"/need": (TactileFrame, _on_need), "/in": (TactileFrame, _on_frame)},
    outputs={},
    needs=("/need",),
)
