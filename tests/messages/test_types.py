"""Laws of every message type: round trip, refusal field by field, schema, documentation."""

import dataclasses
import json
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate import messages
from palpate.messages import Array, CodecError, Count, Seconds, decode, encode, schema, schema_hash
from palpate.messages.types import TYPES
from tests.messages.cases import Rule, cases, drawn

DOCS = Path(__file__).parents[2] / "docs" / "messages.md"
EVERY_TYPE = pytest.mark.parametrize("cls", TYPES.values(), ids=TYPES)
Signals = Annotated[NDArray[np.float64], Array("<f8", (None, None), "N")]


def rules(cls: type) -> dict[str, Rule]:
    properties: dict[str, Rule] = schema(cls)["properties"]
    return properties


def equal(value: Any, other: Any) -> bool:
    if isinstance(value, np.ndarray):
        is_alike = (value.dtype, value.shape) == (other.dtype, other.shape)
        return is_alike and value.tobytes() == other.tobytes()
    return type(value) is type(other) and value == other


@EVERY_TYPE
def test_message_comes_back_bit_for_bit_and_read_only(cls):
    for seed in range(3):
        message = drawn(cls, seed)
        body = encode(message)
        back = decode(cls, body)
        assert encode(back) == body
        for name in rules(cls):
            value = getattr(back, name)
            assert equal(value, getattr(message, name)), name
            assert not isinstance(value, np.ndarray) or not value.flags.writeable, name


def wrong_values(rule: Rule, value: Any) -> list[tuple[Any, str]]:
    """Values that a field must refuse, each with words of the refusal."""
    wrong: list[tuple[Any, str]] = [(object(), ".* a object$")]
    plain = rule["anyOf"][0] if "anyOf" in rule else rule
    if plain is rule:
        wrong.append((None, "must be"))
    if "dtype" in plain and value is not None:
        narrow = value[..., :0] if plain["shape"][-1] else value.reshape(-1, 1, 1, 1, 1)
        wrong += [(value.astype("<f4"), "must have dtype"), (value[None], "must have shape")]
        wrong.append((narrow, "must have shape"))
        if plain["dtype"] == "<f8":
            hole = value.copy()
            hole.flat[-1] = np.nan
            wrong.append((hole, "must be finite"))
    kinds: dict[str, tuple[list[Any], str]] = {
        "number": ([float("nan"), float("inf"), float("-inf")], "must be finite"),
        "integer": ([1.0, True, "1", 1 << 63], "must be int"),
        "boolean": ([1, 0, "true"], "must be bool"),
    }
    values, words = kinds.get(plain.get("type", ""), ([], ""))
    return wrong + [(one, words) for one in values]


@EVERY_TYPE
def test_every_field_refuses_what_it_cannot_be(cls):
    message = drawn(cls)
    for name, rule in rules(cls).items():
        for value, words in wrong_values(rule, getattr(message, name)):
            with pytest.raises(CodecError) as caught:
                encode(replace(message, **{name: value}))
            text = str(caught.value)
            assert re.match(f"^not a {cls.__name__}: {name} {words}", text), (name, value, text)
        if "anyOf" in rule:
            without = replace(message, **{name: None})
            assert getattr(decode(cls, encode(without)), name) is None


@EVERY_TYPE
def test_schema_and_documentation_list_every_field_and_a_line_shows_it(cls, tetrahedron):
    names = [field.name for field in dataclasses.fields(cls)]
    described = schema(cls)
    assert described["title"] == cls.__name__
    assert list(described["properties"]) == described["required"] == names
    plain = [rule.get("anyOf", [rule])[0] for rule in rules(cls).values()]
    assert all(rule.get("unit") for rule in plain if rule.get("type") == "number")
    section = DOCS.read_text().partition(f"### {cls.__name__}\n")[2].partition("\n### ")[0]
    assert [name for name in names if f"`{name}`" not in section] == []
    shown = repr(drawn(cls))
    assert shown.startswith(f"{cls.__name__}(") and len(shown) < 1000 and "\n" not in shown
    many = dict.fromkeys(map(str, range(30)), np.float64(1.0))
    shown = repr(replace(tetrahedron, health=many))
    assert "vertices=<float64 (4, 3)>" in shown and "<dict of 30>" in shown


@dataclass(frozen=True, kw_only=True)
class Everything:
    """All that a field can be."""

    length: messages.PerMetre
    number: Count
    flag: bool
    text: str
    word: Literal["a", "b", 3]
    point: messages.Vector
    small: Annotated[NDArray[np.float32], Array("<f4", (2, None), "N")]
    maybe: Seconds | None
    image: Signals | None
    texts: tuple[str, ...]
    maybes: tuple[Seconds | None, ...]
    table: dict[str, float]


@pytest.mark.parametrize("cls", [Everything, *TYPES.values()], ids=lambda cls: cls.__name__)
def test_type_made_from_schema_reads_and_writes_the_same(cls):
    made = messages.type_of_schema(json.dumps(schema(cls)))
    assert made is not cls and made is messages.type_of_schema(json.dumps(schema(cls)))
    assert (made.__name__, schema(made)) == (cls.__name__, schema(cls))
    assert schema_hash(made) == schema_hash(cls)
    body = encode(drawn(cls, 1))
    read = decode(made, body)
    assert all(equal(getattr(read, name), getattr(decode(cls, body), name)) for name in rules(cls))
    assert encode(read) == body
    with pytest.raises(AttributeError):
        setattr(read, next(iter(rules(cls))), None)
    with pytest.raises(CodecError, match=f"not a {cls.__name__}"):
        decode(made, body[:-1])


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


def of_field(**rule: Any) -> str:
    return described(properties={"x": rule})


@cases(
    "text, words",
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
    (described(description="more"), "it has more than the schema of a message type"),
    (of_field(type="null"), "'null'"),
    (of_field(enum=[[]]), ""),
    (of_field(type="array", items={"enum": []}), ""),
    (of_field(type="number", minimum=3), "it has more"),
    *(
        (of_field(type="object", dtype=dtype, shape=[3], unit="m"), "no dtype of numbers")
        for dtype in ("|O", "<M8", "<U4", "3f8", "<c16")
    ),
)
def test_text_that_is_no_schema_is_refused_in_one_sentence(text: str, words: str):
    with pytest.raises(CodecError, match=f"no schema of a message type: .*{words}") as caught:
        messages.type_of_schema(text)
    assert len(str(caught.value).splitlines()) == 1


def same_title(**hints: Any) -> type:
    return dataclass(frozen=True)(type("Same", (), {"__annotations__": hints}))


def test_schema_hash_tells_types_apart_and_unknown_kinds_are_refused():
    triples = Annotated[NDArray[np.float64], Array("<f8", (None, 3), "s")]
    pairs = Annotated[NDArray[np.float64], Array("<f8", (None, 2), "s")]
    kinds: list[dict[str, Any]] = [
        {"length": Seconds},
        {"length": messages.PerMetre},
        {"width": Seconds},
        {"length": Seconds, "count": Count},
        {"count": Count, "length": Seconds},
        {"length": triples},
        {"length": pairs},
    ]
    assert len({schema_hash(same_title(**one)) for one in kinds}) == len(kinds)
    assert schema_hash(same_title(length=Seconds)) == schema_hash(same_title(length=Seconds))
    single = same_title(length=Seconds)
    assert decode(single, encode(single(2.0))).length == 2.0
    with pytest.raises(CodecError, match="int is not a message type"):
        encode(42)
    kinds = (complex, tuple[int, int], tuple[messages.Vector, ...], dict[str, int], int | str)
    for kind in kinds:
        with pytest.raises(CodecError, match="no message field can be a "):
            encode(same_title(where=kind)(None))
