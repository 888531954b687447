"""Message types made from their JSON schemas, where the modules that define them are missing.

The schema of such a type equals its source to the last bit, so that messages of a user's own type
can be read with the schema of a recording or a running graph.
"""

from __future__ import annotations

import json
import keyword
from dataclasses import make_dataclass
from functools import lru_cache
from types import GenericAlias
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from palpate.messages.codec import printable, schema
from palpate.messages.fields import MAX_MESSAGE_BYTES, Array, CodecError, Unit

MAX_SCHEMA_CHARS = 1 << 20
MAX_SCHEMA_FIELDS = 512
_PLAIN = {"number": float, "integer": int, "boolean": bool, "string": str}


@lru_cache(maxsize=256)
def type_of_schema(text: str) -> type:
    """The message type of a JSON schema; the same text gives the same type.

    Raises CodecError if the text is not the schema of a message type of this version of palpate.
    """
    try:
        if len(text) > MAX_SCHEMA_CHARS:
            raise ValueError(f"it has {len(text)} characters, at most {MAX_SCHEMA_CHARS} will do")
        described = json.loads(text)
        cls = _made(described)
        if json.dumps(schema(cls), sort_keys=True) != json.dumps(described, sort_keys=True):
            raise ValueError("it has more than the schema of a message type")
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        raise CodecError(f"this is no schema of a message type: {printable(str(error))}") from None
    return cls


def _made(described: dict[str, Any]) -> type:
    name, fields = described["title"], described["properties"]
    for word in (name, *fields):
        if not word.isidentifier() or keyword.iskeyword(word) or word == "MAX_BYTES":
            raise ValueError(f"{word!r} is no name")
    if not 0 < len(fields) <= MAX_SCHEMA_FIELDS:
        raise ValueError(f"it has {len(fields)} fields, expected 1 to {MAX_SCHEMA_FIELDS}")
    return make_dataclass(
        name,
        [(field, _hint(rule)) for field, rule in fields.items()],
        namespace={"MAX_BYTES": MAX_MESSAGE_BYTES, "__doc__": "Known by its schema alone."},
        frozen=True,
        slots=True,
        eq=False,
        kw_only=True,
    )


def _hint(rule: dict[str, Any]) -> Any:
    """The type of a field, the inverse of `field_rule`."""
    if "dtype" in rule:
        dtype = np.dtype(str(rule["dtype"]))
        if dtype.kind not in "fiub":
            raise ValueError(f"{rule['dtype']!r} is no dtype of numbers")
        return Annotated[NDArray[Any], Array(rule["dtype"], tuple(rule["shape"]), rule["unit"])]
    if "enum" in rule:
        return Literal[tuple(rule["enum"])]
    if "anyOf" in rule:
        return _hint(rule["anyOf"][0]) | None
    if rule["type"] == "array":
        return GenericAlias(tuple, (_hint(rule["items"]), ...))
    if rule["type"] == "object":
        return dict[str, float]
    plain = _PLAIN[rule["type"]]
    return Annotated[plain, Unit(rule["unit"])] if "unit" in rule else plain
