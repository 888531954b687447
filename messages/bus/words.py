"""The words of nodes, the launcher, tools and other machines, and what belongs to each of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import msgpack

from palpate.messages.nested import at_most

MAX_BYTES = 1 << 20
"""Longest word."""
MAX_ITEMS = 4096
"""Most entries of a list or map, and most lists and maps of a word."""

Word = dict[str, Any]
Check = Callable[[Any], bool]


class Language(NamedTuple):
    """What somebody may say."""

    words: Mapping[str, Mapping[str, Check]]
    """Kind of the word to its fields, and what they can be."""
    max_bytes: int = MAX_BYTES
    """Longest word."""


def _is_text(value: Any) -> bool:
    return type(value) is str


def _is_truth(value: Any) -> bool:
    return type(value) is bool


def _is_count(value: Any) -> bool:
    return type(value) is int and value >= 0


def _is_bytes(value: Any) -> bool:
    return type(value) is bytes


def _is_integer(value: Any) -> bool:
    return type(value) is int


def _is_map(value: Any) -> bool:
    return type(value) is dict


def _are_texts(value: Any) -> bool:
    return type(value) is list and all(map(_is_text, value))


def _is_number(value: Any) -> bool:
    return type(value) is float


def _are_addresses(value: Any) -> bool:
    """Names, and the addresses of their sockets."""
    return type(value) is dict and all(map(_is_text, (*value, *value.values())))


def _are_sent(value: Any) -> bool:
    """Topics, and how many messages were sent on each."""
    return type(value) is dict and all(_is_text(k) and _is_count(v) for k, v in value.items())


def _are_consumed(value: Any) -> bool:
    """Publishers, topics, and how many messages were consumed."""
    return type(value) is list and all(
        type(one) is list and len(one) == 3 and _are_texts(one[:2]) and _is_count(one[2])
        for one in value
    )


OF_NODES = Language(
    {
        "ready": {},
        "alive": {},
        "finished": {"reason": _is_text},
        "count": {
            "round": _is_count,
            "sent": _are_sent,
            "consumed": _are_consumed,
            "waits": _are_texts,
            "speaks": _is_truth,
        },
        "did": {"ticket": _is_count},
        "bye": {"status": _is_bytes},
        "failed": {"text": _is_text, "trace": _is_text},
    }
)
"""What nodes say to the launcher."""
OF_LAUNCHER = Language(
    {
        "go": {},
        "count": {"round": _is_count},
        "stop": {},
        "pause": {"ticket": _is_count},
        "resume": {"ticket": _is_count},
        "step": {"number": _is_count, "ticket": _is_count},
        "publish": {"topic": _is_text, "body": _is_bytes, "ticket": _is_count},
    }
)
"""What the launcher says to nodes; what carries a ticket, a tool has asked for."""
OF_TOOLS = Language(
    {
        "status": {},
        "pause": {"node": _is_text},
        "resume": {"node": _is_text},
        "step": {"node": _is_text, "number": _is_count},
        "publish": {"node": _is_text, "topic": _is_text, "body": _is_bytes},
    }
)
"""What tools say to the launcher."""
TO_TOOLS = Language(
    {
        "status": {"launcher": _is_count, "for_s": _is_number, "nodes": _is_map},
        "done": {},
        "not_yet": {"text": _is_text},
        "refused": {"text": _is_text},
    }
)
"""What the launcher answers."""
TO_HOSTS = Language(
    {
        "hello": {"names": _are_texts, "modules": _are_texts},
        "bear": {"node": _is_text, "wiring": _is_bytes, "place": _is_bytes},
        "kill": {"node": _is_text},
        "alive": {},
        "end": {},
    },
    max_bytes=256 << 20,
)
"""What the launcher says to other machines; a node may have a large object among its parameters."""
OF_HOSTS = Language(
    {
        "hello": {"ns": _is_count, "endpoints": _are_addresses, "taps": _are_addresses},
        "unborn": {"node": _is_text, "text": _is_text},
        "ended": {"node": _is_text, "code": _is_integer},
        "alive": {},
        "parted": {},
    }
)
"""What other machines say to the launcher."""


def read_word(data: bytes, language: Language) -> Word:
    """Word in a frame.

    Parameters
    ----------
    data : bytes
        The frame.
    language : Language
        What may be said.

    Raises
    ------
    ValueError
        If the frame holds no such word, or one that lacks what belongs to it.
    """
    if len(data) > language.max_bytes:
        raise ValueError(f"a word has at most {language.max_bytes} bytes, got {len(data)}")
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
    fields = language.words.get(word["kind"])
    if fields is None:
        raise ValueError(f"a word is one of {', '.join(language.words)}, got {word['kind'][:40]!r}")
    if word.keys() != {"kind", *fields}:
        raise ValueError(f"the word {word['kind']} has the fields {', '.join(fields) or 'none'}")
    for name, check in fields.items():
        if not check(word[name]):
            raise ValueError(f"the word {word['kind']} has a {name} that cannot be one")
    return word
