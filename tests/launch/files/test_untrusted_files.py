"""Files that cannot be trusted: bounded, plain, within their folder; archives that are no bombs."""

import io
import os
import re
import zipfile

import numpy as np
import pytest

from palpate.launch.files.file_access import file_within, read_bounded
from palpate.launch.files.solid_file import read_npz
from palpate.launch.files.source_map import InputError
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
    ("a\0.ply", "letters that can be seen"),
    ("\ud800.ply", "letters that can be seen"),
    ("a" * 256, "a name has at most 255 letters"),
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


def test_npz_arrays_are_read_as_they_were_written():
    given = {"a": np.eye(3), "b/c": np.arange(4, dtype=np.int32), "d": np.array("text")}
    found = read_npz(npz(given))
    assert found.keys() == given.keys()
    for name, array in given.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)
    packed = io.BytesIO()
    np.savez_compressed(packed, a=np.zeros(1000))
    assert read_npz(packed.getvalue())["a"].shape == (1000,)


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
    (lambda: member(header("(1,)"), how=zipfile.ZIP_LZMA), "packed in a way that is not read"),
])  # fmt: skip
def test_bad_npz_file_is_refused(data, words):
    with pytest.raises(ValueError, match=r"^(is no|unpacks)") as caught:
        read_npz(data())
    assert words in str(caught.value)


def test_overlapping_parts_are_refused():
    data = npz({"a": np.zeros(1000)})
    start = data.rindex(b"PK\x01\x02")
    entry, end = data[start:-22], data[-22:]
    many = (20).to_bytes(2, "little")
    size = (20 * len(entry)).to_bytes(4, "little")
    twenty = data[:start] + 20 * entry + end[:8] + many + many + size + end[16:]
    with pytest.raises(ValueError, match="its parts overlap"):
        read_npz(twenty)
