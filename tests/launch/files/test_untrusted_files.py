"""Files that cannot be trusted: bounded, plain, in their folder; archives, and YAML with places."""

import io
import os
import re
import zipfile
from typing import Annotated

import numpy as np
import pytest
from msgspec import Meta, Struct

from palpate.launch.files.file_access import file_within, read_bounded
from palpate.launch.files.solid_file import read_npz
from palpate.launch.files.source_map import InputError, SourceMapped
from palpate.launch.files.yaml_file import convert, parse_yaml, read_yaml
from tests.launch.files.samples import npz


def test_file_is_read_up_to_its_bound(tmp_path):
    (tmp_path / "a").write_bytes(b"x" * 2048)
    assert read_bounded(tmp_path / "a", 2048) == b"x" * 2048
    assert read_bounded(tmp_path / "a", 1 << 60) == b"x" * 2048  # which nobody could set aside
    with pytest.raises(InputError, match="a: is larger than 1 kB, the most that is read"):
        read_bounded(tmp_path / "a", 2047)


@pytest.mark.parametrize(("name", "words"), [
    ("none", "none: the mesh cannot be read: No such file or directory"),
    ("folder", "folder: the mesh cannot be read: Is a directory"),
    ("pipe", "pipe: the mesh cannot be read: it is no plain file"),
    ("a\0b", "the mesh cannot be read: embedded null"),
    ("\ud800", "the mesh cannot be read: 'utf-8' codec"),
])  # fmt: skip
def test_no_plain_file_is_refused_at_once(tmp_path, name, words):
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match=re.escape(words)):
        read_bounded(tmp_path / name, 10, "the mesh ")


@pytest.mark.parametrize(("name", "words"), [
    ("../a.ply", "must lie in the scene's own folder"),
    ("/etc/passwd", "must lie in the scene's own folder"),
    ("link.ply", "must lie in the scene's own folder"),
    ("loop.ply", "leads nowhere"),
    ("folder.ply", "which is no file"),
    ("pipe.ply", "which is no file"),
    ("", "which is no file"),
    ("a\0.ply", "visible characters"),
    ("\ud800.ply", "visible characters"),
    ("a" * 256, "a name has at most 255 visible characters"),
    ("a" * 250 + "/b", "mesh is"),
])  # fmt: skip
def test_name_that_leads_elsewhere_is_refused(tmp_path, name, words):
    folder = tmp_path.resolve()
    (folder / "link.ply").symlink_to("/etc/passwd")
    (folder / "loop.ply").symlink_to(folder / "loop.ply")
    (folder / "folder.ply").mkdir()
    os.mkfifo(folder / "pipe.ply")
    if name == "a" * 250 + "/b":  # a name that may be, of a folder that is not there
        assert file_within(folder, name, "mesh") == folder / name
        return
    with pytest.raises(ValueError, match=r"^mesh is ") as caught:
        file_within(folder, name, "mesh")
    assert words in str(caught.value)


def test_npz_arrays_are_read_as_they_were_written_unless_they_overlap():
    written = {"a": np.eye(3), "b/c": np.arange(4, dtype=np.int32), "d": np.array("text")}
    read = read_npz(npz(written))
    assert read.keys() == written.keys()
    for name, array in written.items():
        assert read[name].dtype == array.dtype
        np.testing.assert_array_equal(read[name], array)
    packed = io.BytesIO()
    np.savez_compressed(packed, a=np.zeros(1000))
    assert read_npz(packed.getvalue())["a"].shape == (1000,)
    data = npz({"a": np.zeros(1000)})
    start = data.rindex(b"PK\x01\x02")
    entry, end = data[start:-22], data[-22:]
    many = (20).to_bytes(2, "little")
    size = (20 * len(entry)).to_bytes(4, "little")
    twenty = data[:start] + 20 * entry + end[:8] + many + many + size + end[16:]
    with pytest.raises(ValueError, match="its parts overlap"):
        read_npz(twenty)


def member(content, name="x.npy", how=zipfile.ZIP_DEFLATED):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", how) as parts:
        parts.writestr(name, content)
    return file.getvalue()


def header(shape, kind="<f8"):
    text = f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


@pytest.mark.parametrize(("data", "words"), [
    (lambda: b"", "is no NPZ file"),
    (lambda: npz({"a": np.eye(3)})[:-30], "is no NPZ file"),
    (lambda: member(bytes(63 << 20)), "unpacks to 63 MiB, more than is read of such a file"),
    (lambda: member(header("(1000000000000,)")), "states 8000000000000 bytes, and holds 0"),
    (lambda: member(header("(9223372036854775807, 9223372036854775807)")), "is no NPZ file"),
    (lambda: member(header("(-1,)")), "states -8 bytes"),
    (lambda: member(header("(0, -1)")), "states 0 bytes, and holds 0"),
    (lambda: member(header("()", "|O")), "an array of objects, which are not read"),
    (lambda: member(b"\x93NUMPY\x09\x00"), "an array of format (9, 0)"),
    (lambda: member(header("(" * 500)), "is no NPZ file of numbers: 'x.npy': "),
    (lambda: member(header("(1,)"), how=zipfile.ZIP_LZMA), "its compression is not read"),
])  # fmt: skip
def test_bad_npz_file_is_refused(data, words):
    with pytest.raises(ValueError, match=r"^(is no|unpacks)") as caught:
        read_npz(data())
    assert words in str(caught.value)


def test_numbers_are_yaml_1_2_values_have_lines_and_a_file_is_text(tmp_path):
    value = parse_yaml("[5e-2, 1e3, no, 012, true, null, 0x10]", "f").value
    assert value == [0.05, 1000.0, "no", 12, True, None, 16]
    document = parse_yaml("a:\n  b:\n    - 1\n    - c: 2\n", "f.yaml")
    assert document.place(("a", "b", 1, "c")) == "f.yaml:4"
    assert document.place(("a", "b", 0, "none")) == "f.yaml:3"
    assert document.part(("a", "b")).place((1,)) == "f.yaml:4"
    with pytest.raises(InputError, match=r"none.yaml: cannot be read: No such file"):
        read_yaml(tmp_path / "none.yaml")
    (tmp_path / "f.yaml").write_bytes(b"a: \xff\xfe")
    with pytest.raises(InputError, match="is not text in UTF-8"):
        read_yaml(tmp_path / "f.yaml")


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
