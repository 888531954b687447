"""YAML of users: plain, bounded, and every complaint with its place."""

from typing import Annotated

import pytest
from msgspec import Meta, Struct

from palpate.launch.files.source_map import InputError, SourceMapped
from palpate.launch.files.yaml_file import convert, parse_yaml, read_yaml


def test_numbers_are_yaml_1_2_and_values_have_lines():
    value = parse_yaml("[5e-2, 1e3, no, 012, true, null, 0x10]", "f").value
    assert value == [0.05, 1000.0, "no", 12, True, None, 16]
    found = parse_yaml("a:\n  b:\n    - 1\n    - c: 2\n", "f.yaml")
    assert found.place(("a", "b", 1, "c")) == "f.yaml:4"
    assert found.place(("a", "b", 0, "none")) == "f.yaml:3"
    assert found.part(("a", "b")).place((1,)) == "f.yaml:4"


@pytest.mark.parametrize(("text", "words"), [
    ("a: &x 1\nb: *x\n", "f.yaml:1: anchors and aliases"),
    ("a: !!python/object:os.system 1\n", "f.yaml:1: the tag"),
    ("a: 1\na: 2\n", "f.yaml:2: the key 'a' is given twice"),
    ("? [1]\n: 2\n", "f.yaml:1: a key must be a word"),
    ("--- 1\n--- 2\n", "f.yaml:2: is not YAML"),
    ("[" * 40 + "]" * 40, "f.yaml:1: is nested deeper than 16"),
    ("a: \x00", "f.yaml: is not YAML"),
    ("a: 2001-99-99\n", "f.yaml: is not YAML"),
    ("a: [" + "1," * 13_000 + "]", "f.yaml:1: has more than 12500 values"),
    ("".join(f"k{i}: 1\n" for i in range(7000)), "f.yaml:6250: has more than 12500 values"),
    ("a: " + "9" * 4000, "f.yaml:1: has a number of more than 1024 bits"),
    ("a: " + "9" * 5000, "f.yaml: is not YAML: Exceeds the limit"),
    ("a: &a [*a]", "f.yaml:1: anchors and aliases"),
    ('"' + "k" * 900 + '": 1\n"' + "k" * 900 + '": 2', "f.yaml:2: the key 'kkk"),
])  # fmt: skip
def test_yaml_that_is_not_plain_or_too_large_is_refused_with_its_line(text, words):
    with pytest.raises(InputError) as caught:
        parse_yaml(text, "f.yaml")
    assert str(caught.value).startswith(words)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 250


@pytest.mark.parametrize(("text", "words"), [
    ("", "is empty"),
    ("[1, 2]", "must be a map of keys to values, got a list"),
    ("word", "must be a map of keys to values, got 'word'"),
    ("#" * 200_001, "is larger than 195 kB"),
])  # fmt: skip
def test_file_must_hold_one_small_map(write, text, words):
    path = write("f.yaml", text)
    with pytest.raises(InputError, match=words):
        read_yaml(path)


def test_missing_file_and_bytes_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"none.yaml: cannot be read: No such file"):
        read_yaml(tmp_path / "none.yaml")
    (tmp_path / "f.yaml").write_bytes(b"a: \xff\xfe")
    with pytest.raises(InputError, match="is not text in UTF-8"):
        read_yaml(tmp_path / "f.yaml")


Length = Annotated[float, Meta(gt=0)]


class Block(Struct, frozen=True, kw_only=True):
    size: tuple[Length, Length]
    name: str = "block"

    def __post_init__(self):
        if self.name == "bad":
            raise ValueError("name must not be bad")


class Yard(Struct, frozen=True, kw_only=True):
    block: Block | None = None
    pile: tuple[Block, ...] = ()
    named: dict[str, Block] = {}
    count: int = 0


@pytest.mark.parametrize(("text", "sentence"), [
    ("count: 1\ncuont: 2", "f.yaml:2: unknown key 'cuont'; did you mean 'count'?"),
    ("block:\n  size: [1, 2]\n  nmae: x",
     "f.yaml:3: unknown key 'nmae' in block; did you mean 'name'?"),
    ("pile:\n- size: [1, 2]\n- sise: [1, 2]",
     "f.yaml:3: unknown key 'sise' in pile[1]; did you mean 'size'?"),
    ("named:\n  x: {size: 1}", "f.yaml:1: named is a map of x; expected list, got whole number"),
    ("block:\n  size:\n  - 1\n  - -2", "f.yaml:4: block.size[1] is -2; expected number > 0.0"),
    ("block:\n  size: [1, .inf]", "f.yaml:2: block.size[1] is inf; a number must be finite"),
    ("block: {size: [1]}", "f.yaml:1: block.size is [1]; expected list of length 2, got 1"),
    ("count: x", "f.yaml:1: count is 'x'; expected whole number, got text"),
    ("count: 1.5", "f.yaml:1: count is 1.5; expected whole number, got number"),
    ("\nblock: {}", "f.yaml:2: block lacks the key 'size'"),
    ("block: {size: [1, 2], name: bad}", "f.yaml:1: block: name must not be bad"),
    ("pile: {a: 1}", "f.yaml:1: pile is a map of a; expected list, got map"),
    ("block: 7", "f.yaml:1: block is 7; expected map or nothing, got whole number"),
    ("[1]", "f.yaml:1: the document is [1]; expected map, got list"),
])  # fmt: skip
def test_complaint_names_place_path_value_and_remedy(typed, text, sentence):
    with pytest.raises(InputError) as caught:
        convert(typed(text), Yard)
    assert str(caught.value) == sentence


def test_complaint_has_the_name_and_cuts_long_values(typed):
    with pytest.raises(InputError, match=r"yard.count is 'x'"):
        convert(typed("count: x"), Yard, "yard")
    with pytest.raises(InputError) as caught:
        convert(SourceMapped({"count": "x" * 1000}, "f"), Yard)
    assert len(str(caught.value)) < 150
