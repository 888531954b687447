from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path
from types import NoneType
from typing import Any, NamedTuple, get_args, get_type_hints

import numpy as np
import pytest

from palpate.messages.codec import decode, encode, schema
from palpate.messages.fields import Array, CodecError, Unit
from palpate.messages.types.catalogue import TYPES

Make = Callable[..., Any]
EVERY_TYPE = pytest.mark.parametrize("cls", TYPES.values(), ids=TYPES)


class Field(NamedTuple):
    name: str
    plain: Any  # Its type, without marks, and without None where it may be left out
    marks: tuple[Any, ...]
    optional: bool

    @property
    def array(self) -> Array | None:
        return next((mark for mark in self.marks if isinstance(mark, Array)), None)


def fields_of(cls: type) -> list[Field]:
    found = []
    for name, hint in get_type_hints(cls, include_extras=True).items():
        if name not in cls.__dataclass_fields__:  # type: ignore[attr-defined]
            continue
        optional = NoneType in get_args(hint)
        given = get_args(hint)[0] if optional else hint
        marks = getattr(given, "__metadata__", ())
        found.append(Field(name, get_args(given)[0] if marks else given, marks, optional))
    return found


def refused(message: Any, name: str, value: object, words: str) -> None:
    """A message with another value of a field is refused by the name of that field."""
    with pytest.raises(CodecError) as caught:
        encode(dataclasses.replace(message, **{name: value}))
    wanted = f"^not a {type(message).__name__}: {name} {words}"
    assert re.match(wanted, str(caught.value)), (name, value, str(caught.value))


def same(one: object, other: object) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    return type(one) is type(other) and one == other


@EVERY_TYPE
def test_a_message_comes_back_as_it_was(cls: type, example: Make):
    for seed in range(5):
        message = example(cls, seed)
        body = encode(message)
        back = decode(cls, body)
        for field in fields_of(cls):
            assert same(getattr(back, field.name), getattr(message, field.name)), (seed, field)
        assert encode(back) == body


@EVERY_TYPE
def test_decoded_arrays_are_read_only(cls: type, example: Make):
    back = decode(cls, encode(example(cls)))
    for field in fields_of(cls):
        if field.array:
            assert not getattr(back, field.name).flags.writeable, field.name


@EVERY_TYPE
def test_a_value_of_a_wrong_kind_is_refused(cls: type, example: Make):
    message = example(cls)
    for field in fields_of(cls):
        refused(message, field.name, object(), ".* a object$")


@EVERY_TYPE
def test_nothing_is_a_value_only_where_it_may_be(cls: type, example: Make):
    message = example(cls)
    for field in fields_of(cls):
        if field.optional:
            without = dataclasses.replace(message, **{field.name: None})
            assert getattr(decode(cls, encode(without)), field.name) is None, field.name
        else:
            refused(message, field.name, None, "must be")


@EVERY_TYPE
def test_a_number_is_of_its_kind_finite_and_has_a_unit(cls: type, example: Make):
    bad: dict[Any, tuple[list[Any], str]] = {
        float: ([float("nan"), float("inf"), float("-inf")], "must be finite"),
        int: ([1.0, True, "1", 1 << 63], "must be int"),
        bool: ([1, 0, "true"], "must be bool"),
    }
    message = example(cls)
    for field in fields_of(cls):
        values, words = bad.get(field.plain, ([], ""))
        for value in values:
            refused(message, field.name, value, words)
        if field.plain is float:
            assert any(isinstance(mark, Unit) for mark in field.marks), field.name


@EVERY_TYPE
def test_an_array_of_another_dtype_or_shape_or_not_finite_is_refused(cls: type, example: Make):
    message = example(cls)
    for field in fields_of(cls):
        if field.array is None:
            continue
        array = getattr(message, field.name)
        other = array.astype("<f4")
        refused(message, field.name, other, "must have dtype")
        narrow = array[..., :0] if field.array.shape[-1] else array.reshape(-1, 1, 1, 1, 1)
        for other in (array[None], narrow):
            refused(message, field.name, other, "must have shape")
        if field.array.dtype == "<f8":
            other = array.copy()
            other.flat[-1] = np.nan
            refused(message, field.name, other, "must be finite")


@EVERY_TYPE
def test_the_schema_names_every_field(cls: type):
    described, names = schema(cls), [field.name for field in dataclasses.fields(cls)]
    assert described["title"] == cls.__name__
    assert list(described["properties"]) == described["required"] == names


@EVERY_TYPE
def test_the_documentation_lists_every_field(cls: type):
    page = (Path(__file__).parents[3] / "docs" / "messages.md").read_text()
    section = page.partition(f"### {cls.__name__}\n")[2].partition("\n### ")[0]
    assert [one.name for one in fields_of(cls) if f"`{one.name}`" not in section] == []
