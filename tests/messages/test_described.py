import json
from dataclasses import dataclass, fields
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.messages.codec import decode, encode, schema, schema_hash
from palpate.messages.described import type_of_schema
from palpate.messages.fields import Array, CodecError, Metres, Points, Unit
from palpate.messages.types.catalogue import TYPES


@dataclass(frozen=True, kw_only=True)
class Everything:
    """All that a field can be."""

    length: Metres
    number: Annotated[int, Unit("#")]
    flag: bool
    text: str
    word: Literal["a", "b", 3]
    points: Points
    small: Annotated[NDArray[np.float32], Array("<f4", (2, None), "N")]
    maybe: Metres | None
    cloud: Points | None
    texts: tuple[str, ...]
    maybes: tuple[Metres | None, ...]
    table: dict[str, float]


def described(**changes: Any) -> str:
    """The schema of a type with one field of metres, changed."""
    text = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Odd",
        "type": "object",
        "required": ["x"],
        "additionalProperties": False,
        "properties": {"x": {"type": "number", "unit": "m"}},
    }
    return json.dumps({**text, **changes})


@pytest.mark.parametrize("cls", [Everything, *TYPES.values()], ids=lambda cls: cls.__name__)
def test_a_type_made_from_a_schema_has_that_schema(cls):
    made = type_of_schema(json.dumps(schema(cls)))
    assert made is not cls
    assert (made.__name__, schema(made), schema_hash(made)) == (
        cls.__name__,
        schema(cls),
        schema_hash(cls),
    )


def test_it_reads_what_the_type_itself_has_written_and_writes_the_same():
    body = encode(
        Everything(
            length=0.25,
            number=-4,
            flag=True,
            text="x",
            word=3,
            points=np.eye(3),
            small=np.ones((2, 5), np.float32),
            maybe=None,
            cloud=np.zeros((0, 3)),
            texts=("a", ""),
            maybes=(1.5, None),
            table={"k": 1.0},
        )
    )
    made = type_of_schema(json.dumps(schema(Everything)))
    read, own = decode(made, body), decode(Everything, body)
    for field in fields(Everything):
        np.testing.assert_equal(getattr(read, field.name), getattr(own, field.name))
    assert encode(read) == body
    with pytest.raises(CodecError, match="not a Everything"):
        decode(made, body[:-1])


def test_the_same_text_gives_the_same_type():
    assert type_of_schema(described()) is type_of_schema(described())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "Expecting value"),
        ("[" * 100_000, "recursion"),
        ("[]", "indices"),
        ("7", "subscriptable"),
        ("{}", "'title'"),
        (" " * (1 << 20) + " ", "1048577 characters, at most 1048576 will do"),
        (described(title=7), "isidentifier"),
        (described(title="x: exit()"), "'x: exit[(][)]' is no name"),
        (described(properties={"class": {"type": "number"}}), "'class' is no name"),
        (described(properties={"MAX_BYTES": {"type": "number"}}), "'MAX_BYTES' is no name"),
        (described(properties={}), "it has 0 fields, expected 1 to 512"),
        (described(properties={f"f{i}": {} for i in range(513)}), "it has 513 fields"),
        (described(properties={"x": {"type": "null"}}), "'null'"),
        (described(properties={"x": {"enum": [[]]}}), ""),
        (described(properties={"x": {"type": "array", "items": {"enum": []}}}), ""),
        (described(description="more"), "it says more than a message type can"),
        (described(properties={"x": {"type": "number", "minimum": 3}}), "says more"),
        *(
            (
                described(
                    properties={"x": {"type": "object", "dtype": dtype, "shape": [3], "unit": "m"}}
                ),
                f"'{dtype}' is no dtype of numbers",
            )
            for dtype in ("|O", "<M8", "<U4", "3f8", "<c16")
        ),
    ],
)
def test_what_is_no_schema_of_a_message_type_is_refused_in_one_sentence(text, words):
    with pytest.raises(CodecError, match=f"no schema of a message type: .*{words}") as caught:
        type_of_schema(text)
    assert len(str(caught.value).splitlines()) == 1
