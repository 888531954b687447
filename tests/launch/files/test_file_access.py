import os
import re

import pytest

from palpate.launch.files.file_access import file_within, read_bounded
from palpate.launch.files.source_map import InputError


def test_a_file_is_read_up_to_its_bound(tmp_path):
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
def test_what_is_no_plain_file_is_refused_at_once(tmp_path, name, words):
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match=re.escape(words)):
        read_bounded(tmp_path / name, 10, "the mesh ")


def test_a_file_of_the_folder_is_found_there_or_not(tmp_path):
    (tmp_path / "a.ply").touch()
    assert file_within(tmp_path, "a.ply", "mesh") == tmp_path / "a.ply"
    assert file_within(tmp_path, "x/../a.ply", "mesh") == tmp_path / "a.ply"
    assert file_within(tmp_path, "none.ply", "mesh") == tmp_path / "none.ply"


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
def test_a_name_that_leads_elsewhere_is_refused(tmp_path, name, words):
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
