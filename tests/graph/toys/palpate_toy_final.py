"""A node that ends the graph with the final model."""

from __future__ import annotations

import msgspec

from palpate.messages.types.model import ShapeModel
from palpate.nodes.runtime.node import Finished, Node, Outputs


class Params(msgspec.Struct, frozen=True, kw_only=True):
    pass


def _take(params: Params, state: None, model: ShapeModel) -> tuple[None, Outputs]:
    return None, [Finished("the model is final")] if model.final else []


NODE = Node(
    params=Params,
    start=lambda params: (None, []),
    inputs={"/model/shape": (ShapeModel, _take)},
    outputs={},
)
