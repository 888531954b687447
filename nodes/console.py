"""Console node: publishes messages that a user types."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import repeat

from msgspec import Struct

from palpate.messages.types import TYPES
from palpate.nodes.runtime.node import Source


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    topics: dict[str, str]  # names of message types by topic

    def __post_init__(self) -> None:
        for topic, name in self.topics.items():
            if name not in TYPES:
                raise ValueError(
                    f"{topic} must be of a known type, got {name!r}; there are {', '.join(TYPES)}"
                )


def outputs(params: Params) -> Mapping[str, type]:
    """Types of its messages by topic."""
    return {topic: TYPES[name] for topic, name in params.topics.items()}


def listen(params: Params) -> Iterator[None]:
    """Publish nothing by itself: tools publish on its topics."""
    return repeat(None)


SOURCE = Source(params=Params, outputs=outputs, open=listen, repeats=False, outside=True)
