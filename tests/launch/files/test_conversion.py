from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import pytest
from msgspec import Meta, Struct

from palpate.launch.files.source_map import InputError, SourceMapped
from palpate.launch.files.yaml_file import convert

Typed = Callable[[str], SourceMapped]
Length = Annotated[float, Meta(gt=0)]


class Block(Struct, frozen=True, kw_only=True):
    size: tuple[Length, Length]
    name: str = "block"

    def __post_init__(self) -> None:
        if self.name == "bad":
            raise ValueError("name must not be bad")


class Yard(Struct, frozen=True, kw_only=True):
    block: Block | None = None
    pile: tuple[Block, ...] = ()
    named: dict[str, Block] = {}
    count: int = 0


def test_a_document_becomes_a_struct(typed):
    found = convert(typed("block: {size: [1, 5e-2]}\npile: [{size: [2, 3]}]\n"), Yard)
    assert found == Yard(block=Block(size=(1.0, 0.05)), pile=(Block(size=(2.0, 3.0)),))


@pytest.mark.parametrize(("text", "sentence"), [
    ("count: 1\ncuont: 2", "f.yaml:2: unknown key 'cuont'; did you mean 'count'?"),
    ("block:\n  size: [1, 2]\n  nmae: x",
     "f.yaml:3: unknown key 'nmae' in block; did you mean 'name'?"),
    ("pile:\n- size: [1, 2]\n- sise: [1, 2]",
     "f.yaml:3: unknown key 'sise' in pile[1]; did you mean 'size'?"),
    ("named:\n  x: {size: 1}", "f.yaml:1: named is a map of x; expected list, got whole number"),
    ("block:\n  size:\n  - 1\n  - -2", "f.yaml:4: block.size[1] is -2; expected number > 0.0"),
    ("block:\n  size: [1, .inf]", "f.yaml:2: block.size[1] is inf; a number must be finite"),
    ("block:\n  size: [.nan, 1]", "f.yaml:2: block.size[0] is nan; a number must be finite"),
    ("block: {size: [1]}", "f.yaml:1: block.size is [1]; expected list of length 2, got 1"),
    ("count: x", "f.yaml:1: count is 'x'; expected whole number, got text"),
    ("count: 1.5", "f.yaml:1: count is 1.5; expected whole number, got number"),
    ("\nblock: {}", "f.yaml:2: block lacks the key 'size'"),
    ("block: {size: [1, 2], name: bad}", "f.yaml:1: block: name must not be bad"),
    ("pile: {a: 1}", "f.yaml:1: pile is a map of a; expected list, got map"),
    ("block: 7", "f.yaml:1: block is 7; expected map or nothing, got whole number"),
    ("[1]", "f.yaml:1: the document is [1]; expected map, got list"),
])  # fmt: skip
def test_a_complaint_names_place_path_value_and_what_would_be_right(typed, text, sentence):
    with pytest.raises(InputError) as caught:
        convert(typed(text), Yard)
    assert str(caught.value) == sentence


def test_a_name_is_put_before_the_path(typed):
    with pytest.raises(InputError, match=r"yard.count is 'x'"):
        convert(typed("count: x"), Yard, "yard")


def test_a_long_value_is_cut_short():
    with pytest.raises(InputError) as caught:
        convert(SourceMapped({"count": "x" * 1000}, "f"), Yard)
    assert len(str(caught.value)) < 150
