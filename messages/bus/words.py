"""The words that nodes and the launcher say to each other, and what belongs to each of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import msgpack

from palpate.messages.nested import at_most

MAX_BYTES = 1 << 20
"""Longest word."""
MAX_ITEMS = 4096
"""Most entries of a list or map, and most lists and maps of a word."""

Word = dict[str, Any]
Check = Callable[[Any], bool]


def _is_text(value: Any) -> bool:
    return type(value) is str


def _is_count(value: Any) -> bool:
    return type(value) is int and value >= 0


def _is_bytes(value: Any) -> bool:
    return type(value) is bytes


def _are_texts(value: Any) -> bool:
    return type(value) is list and all(map(_is_text, value))


def _are_sent(value: Any) -> bool:
    """Topics, and how many messages were sent on each."""
    return type(value) is dict and all(_is_text(k) and _is_count(v) for k, v in value.items())


def _are_consumed(value: Any) -> bool:
    """Publishers, topics, and how many messages were consumed."""
    return type(value) is list and all(
        type(one) is list and len(one) == 3 and _are_texts(one[:2]) and _is_count(one[2])
        for one in value
    )


Kinds = Mapping[str, Mapping[str, Check]]

OF_NODES: Kinds = {
    "ready": {},
    "alive": {},
    "finished": {"reason": _is_text},
    "count": {
        "round": _is_count,
        "sent": _are_sent,
        "consumed": _are_consumed,
        "waits": _are_texts,
    },
    "bye": {"status": _is_bytes},
    "failed": {"text": _is_text, "trace": _is_text},
}
"""What nodes say, and the fields of each word."""
OF_LAUNCHER: Kinds = {"go": {}, "count": {"round": _is_count}, "stop": {}}
"""What the launcher says."""


def read_word(data: bytes, kinds: Kinds) -> Word:
    """Word in a frame.

    Parameters
    ----------
    data : bytes
        The frame.
    kinds : mapping
        `OF_NODES` or `OF_LAUNCHER`.

    Raises
    ------
    ValueError
        If the frame holds no such word, or one that lacks what belongs to it.
    """
    if len(data) > MAX_BYTES:
        raise ValueError(f"a word has at most {MAX_BYTES} bytes, got {len(data)}")
    count = at_most(MAX_ITEMS)
    try:
        word = msgpack.unpackb(
            data,
            list_hook=count,
            object_hook=count,
            max_array_len=MAX_ITEMS,
            max_map_len=MAX_ITEMS,
            max_ext_len=0,
        )
    except (ValueError, RecursionError) as error:
        reason = f"{type(error).__name__}: {error!s:.100}"
        raise ValueError(f"a word is a map with a kind, got no msgpack: {reason}") from None
    if not isinstance(word, dict) or not isinstance(word.get("kind"), str):
        raise ValueError(f"a word is a map with a kind, got {len(data)} bytes of something else")
    fields = kinds.get(word["kind"])
    if fields is None:
        raise ValueError(f"a word is one of {', '.join(kinds)}, got {word['kind'][:40]!r}")
    if word.keys() != {"kind", *fields}:
        raise ValueError(f"the word {word['kind']} has the fields {', '.join(fields) or 'none'}")
    for name, check in fields.items():
        if not check(word[name]):
            raise ValueError(f"the word {word['kind']} has a {name} that cannot be one")
    return word
