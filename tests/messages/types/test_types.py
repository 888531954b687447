from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest

from palpate.messages.codec import decode, encode, schema
from palpate.messages.fields import Array, CodecError, Unit
from palpate.messages.types.catalogue import TYPES

Make = Callable[..., Any]
FIELDS = [(cls, field.name) for cls in TYPES.values() for field in dataclasses.fields(cls)]
ARRAYS = [
    (cls, name, mark)
    for cls in TYPES.values()
    for name, hint in get_type_hints(cls, include_extras=True).items()
    for mark in getattr(hint, "__metadata__", ())
    if isinstance(mark, Array)
]
OPTIONAL = [
    (cls, name)
    for cls, name in FIELDS
    if NoneType in get_args(get_type_hints(cls, include_extras=True)[name])
]
GIVEN = [field for field in FIELDS if field not in OPTIONAL]


def same(one: object, other: object) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    return type(one) is type(other) and one == other


def hint_of(cls: type, name: str) -> Any:
    """The type of a field that is given, with its marks."""
    hint = get_type_hints(cls, include_extras=True)[name]
    return get_args(hint)[0] if (cls, name) in OPTIONAL else hint


def plain(cls: type, name: str) -> Any:
    hint = hint_of(cls, name)
    return get_args(hint)[0] if hasattr(hint, "__metadata__") else hint


def of_plain(kind: Any) -> list[tuple[type, str]]:
    return [(cls, name) for cls, name in FIELDS if plain(cls, name) is kind]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("cls", TYPES.values(), ids=TYPES)
def test_a_message_comes_back_as_it_was(cls: type, seed: int, example: Make) -> None:
    message = example(cls, seed)

    back = decode(cls, encode(message))

    for field in dataclasses.fields(cls):
        assert same(getattr(back, field.name), getattr(message, field.name)), field.name


@pytest.mark.parametrize("cls", TYPES.values(), ids=TYPES)
def test_encoding_again_gives_the_same_bytes(cls: type, example: Make) -> None:
    body = encode(example(cls))

    assert encode(decode(cls, body)) == body


@pytest.mark.parametrize(("cls", "name", "mark"), ARRAYS)
def test_decoded_arrays_are_read_only(cls: type, name: str, mark: Array, example: Make) -> None:
    array = getattr(decode(cls, encode(example(cls))), name)

    with pytest.raises(ValueError, match="read-only"):
        array[...] = 0


@pytest.mark.parametrize(("cls", "name"), FIELDS)
def test_a_value_of_a_wrong_kind_is_refused(cls: type, name: str, example: Make) -> None:
    message = dataclasses.replace(example(cls), **{name: object()})

    with pytest.raises(CodecError, match=f"^not a {cls.__name__}: {name} must .* a object"):
        encode(message)


@pytest.mark.parametrize(("cls", "name"), OPTIONAL)
def test_nothing_comes_back_as_nothing_where_it_may_be_said(
    cls: type, name: str, example: Make
) -> None:
    message = dataclasses.replace(example(cls), **{name: None})

    assert getattr(decode(cls, encode(message)), name) is None


@pytest.mark.parametrize(("cls", "name"), GIVEN)
def test_nothing_is_no_value(cls: type, name: str, example: Make) -> None:
    message = dataclasses.replace(example(cls), **{name: None})

    with pytest.raises(CodecError, match=f"^not a {cls.__name__}: {name} must"):
        encode(message)


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), float("-inf")])
@pytest.mark.parametrize(("cls", "name"), of_plain(float))
def test_a_number_that_is_not_finite_is_refused(
    cls: type, name: str, bad: float, example: Make
) -> None:
    with pytest.raises(CodecError, match=f"^not a {cls.__name__}: {name} must be finite, got"):
        encode(dataclasses.replace(example(cls), **{name: bad}))


@pytest.mark.parametrize("bad", [1.0, True, "1", 1 << 63])
@pytest.mark.parametrize(("cls", "name"), of_plain(int))
def test_a_count_is_an_integer_of_64_bits(cls: type, name: str, bad: Any, example: Make) -> None:
    with pytest.raises(CodecError, match=f"^not a {cls.__name__}: {name} must (be an int|fit)"):
        encode(dataclasses.replace(example(cls), **{name: bad}))


@pytest.mark.parametrize("bad", [1, 0, "true"])
@pytest.mark.parametrize(("cls", "name"), of_plain(bool))
def test_a_truth_value_is_no_number(cls: type, name: str, bad: Any, example: Make) -> None:
    with pytest.raises(CodecError, match=f"^not a {cls.__name__}: {name} must be true or false"):
        encode(dataclasses.replace(example(cls), **{name: bad}))


@pytest.mark.parametrize(("cls", "name", "mark"), ARRAYS)
def test_an_array_of_another_dtype_is_refused(
    cls: type, name: str, mark: Array, example: Make
) -> None:
    message = example(cls)
    other = getattr(message, name).astype("<f4")

    with pytest.raises(CodecError, match=f"{name} must be an array of .*, got an array of float32"):
        encode(dataclasses.replace(message, **{name: other}))


@pytest.mark.parametrize(("cls", "name", "mark"), ARRAYS)
def test_an_array_of_another_shape_is_refused(
    cls: type, name: str, mark: Array, example: Make
) -> None:
    message = example(cls)
    array = getattr(message, name)
    shapes = [array[None], array[..., :0] if mark.shape[-1] else array.reshape(-1, 1, 1, 1, 1)]
    for other in shapes:
        with pytest.raises(CodecError, match=f"{name} must have shape"):
            encode(dataclasses.replace(message, **{name: other}))


@pytest.mark.parametrize(
    ("cls", "name", "mark"), [entry for entry in ARRAYS if entry[2].dtype == "<f8"]
)
def test_an_array_that_is_not_finite_is_refused(
    cls: type, name: str, mark: Array, example: Make
) -> None:
    message = example(cls)
    array = getattr(message, name).copy()
    array.flat[-1] = np.nan

    with pytest.raises(CodecError, match=f"^not a {cls.__name__}: {name} must be finite"):
        encode(dataclasses.replace(message, **{name: array}))


@pytest.mark.parametrize(("cls", "name"), FIELDS)
def test_every_number_has_a_unit(cls: type, name: str) -> None:
    if plain(cls, name) is float:
        assert any(isinstance(mark, Unit) for mark in hint_of(cls, name).__metadata__)


@pytest.mark.parametrize("cls", TYPES.values(), ids=TYPES)
def test_the_schema_names_every_field(cls: type) -> None:
    described = schema(cls)

    names = [field.name for field in dataclasses.fields(cls)]
    assert described["title"] == cls.__name__
    assert list(described["properties"]) == names
    assert described["required"] == names


def test_the_documentation_lists_every_type_and_field() -> None:
    page = (Path(__file__).parents[3] / "docs" / "messages.md").read_text()

    missing = [
        f"{cls.__name__}.{name}" for cls, name in FIELDS if f"`{name}`" not in _section(page, cls)
    ]
    assert missing == []


def _section(page: str, cls: type) -> str:
    """What the page says of one type: from its heading to the next."""
    before, found, after = page.partition(f"### {cls.__name__}\n")
    return after.partition("\n### ")[0] if found else before[:0]
