"""A node that acts: each message that it hears leaves a line in a file, as a move would a dent."""

from __future__ import annotations

from pathlib import Path

import msgspec

from palpate.messages.types import TactileFrame
from palpate.nodes.runtime.node import Finished, Node, Outputs


class Params(msgspec.Struct, frozen=True, kw_only=True):
    path: str
    expects: int


def _act(params: Params, state: None, message: TactileFrame) -> tuple[None, Outputs]:
    with Path(params.path).open("a", encoding="utf-8") as file:
        file.write(f"{message.touch}\n")
    outputs: Outputs = [("/out", message)]
    if message.touch == params.expects - 1:
        outputs.append(Finished(f"{params.expects} done"))
    return None, outputs


NODE = Node(
    params=Params,
    start=lambda params: (None, []),
    inputs={"/in": (TactileFrame, _act)},
    outputs={"/out": TactileFrame},
    has_side_effects=True,
)
