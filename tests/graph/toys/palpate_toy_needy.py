"""A node that handles nothing before it has heard what it needs."""

from __future__ import annotations

import msgspec

from palpate.messages.types.touch import TactileFrame
from palpate.nodes.runtime.node import Finished, Node, Outputs


class Params(msgspec.Struct, frozen=True, kw_only=True):
    pass


def _on_need(params: Params, heard: tuple[str, ...], _: TactileFrame) -> tuple[object, Outputs]:
    return (*heard, "need"), []


def _on_frame(params: Params, heard: tuple[str, ...], _: TactileFrame) -> tuple[object, Outputs]:
    if "need" not in heard:
        raise RuntimeError("heard a frame before what it needs")
    return (*heard, "frame"), [Finished("all there")]


NODE = Node(
    params=Params,
    start=lambda params: ((), []),
    inputs={"/need": (TactileFrame, _on_need), "/in": (TactileFrame, _on_frame)},
    outputs={},
    needs=("/need",),
)
