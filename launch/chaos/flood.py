"""A source that says very much, as fast as it can, of which nobody needs anything."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from palpate.messages.types import Clock
from palpate.nodes.node import Said, Source


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    messages: int = 100_000
    """How much it says."""


def _flood(params: Params) -> Iterator[Said]:
    return (Said(0.0, "/flood", Clock(time=1e-3 * number)) for number in range(params.messages))


SOURCE = Source(params=Params, outputs=lambda params: {"/flood": Clock}, open=_flood)
