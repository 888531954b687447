import io
import zipfile

import numpy as np
import pytest

from palpate.launch.files.solid_file import read_npz
from tests.fuzz.files import hostile_solids, npz


def test_arrays_are_read_as_they_were_written():
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
    (lambda: member(header("(-1,)")), "states -8 bytes"),
    (lambda: member(header("(0, -1)")), "states 0 bytes, and holds 0"),
    (lambda: member(header("()", "|O")), "an array of objects, which are not read"),
    (lambda: member(b"\x93NUMPY\x09\x00"), "an array of format (9, 0)"),
    (lambda: member(header("(" * 500)), "is no NPZ file of numbers: 'x.npy': "),
    (lambda: member(header("(1,)"), how=zipfile.ZIP_LZMA), "packed in a way that is not read"),
])  # fmt: skip
def test_what_is_no_npz_file_of_numbers_is_refused(data, words):
    with pytest.raises(ValueError, match=r"^(is no|unpacks)") as caught:
        read_npz(data())
    assert words in str(caught.value)


def test_parts_that_overlap_are_refused():
    data = npz({"a": np.zeros(1000)})
    start = data.rindex(b"PK\x01\x02")
    entry, end = data[start:-22], data[-22:]
    many = (20).to_bytes(2, "little")
    size = (20 * len(entry)).to_bytes(4, "little")
    twenty = data[:start] + 20 * entry + end[:8] + many + many + size + end[16:]
    with pytest.raises(ValueError, match="its parts overlap"):
        read_npz(twenty)


def test_every_bomb_is_refused_or_harmless():
    for _, bomb in hostile_solids():
        try:
            found = read_npz(bomb)
        except ValueError:
            continue
        assert sum(array.nbytes for array in found.values()) < 32 << 20
