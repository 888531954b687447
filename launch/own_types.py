"""Message types that palpate does not have: what a recording must say of them, and their names."""

from __future__ import annotations

import json
from collections.abc import Mapping

from palpate.launch.placing import Publisher
from palpate.messages.codec import schema
from palpate.messages.fields import CodecError
from palpate.messages.types import TYPES


def own_schema(cls: type) -> str:
    """JSON schema of a type that palpate does not have; empty of its own."""
    return "" if TYPES.get(cls.__name__) is cls else json.dumps(schema(cls))


def check_own_types(said: Mapping[str, Publisher]) -> None:
    """Refuse types that could not travel, or that a recording could not tell apart.

    Raises
    ------
    InputError
        If a type is no message type, or has the name of another one.
    """
    named = dict(TYPES)
    for topic, publisher in said.items():
        cls = publisher.type
        try:
            schema(cls)
        except CodecError as error:
            raise publisher.placed.entry.error(f"publishes {topic}: {error}") from None
        if named.setdefault(cls.__name__, cls) is not cls:
            other = named[cls.__name__]
            raise publisher.placed.entry.error(
                f"publishes {topic} as {cls.__name__} of {cls.__module__}, but {other.__module__} "
                "has a type of that name; call it otherwise"
            )
