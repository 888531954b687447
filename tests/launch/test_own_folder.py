from __future__ import annotations

import os
from pathlib import Path

import pytest

from palpate.launch.own_folder import file_in


def test_a_file_of_the_folder_is_found_there_or_not(tmp_path: Path) -> None:
    (tmp_path / "a.ply").touch()

    assert file_in(tmp_path, "a.ply", "mesh") == tmp_path / "a.ply"
    assert file_in(tmp_path, "x/../a.ply", "mesh") == tmp_path / "a.ply"
    assert file_in(tmp_path, "none.ply", "mesh") == tmp_path / "none.ply"


@pytest.mark.parametrize(
    ("name", "words"),
    [
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
    ],
)
def test_a_name_that_leads_elsewhere_is_refused(tmp_path: Path, name: str, words: str) -> None:
    folder = tmp_path.resolve()
    (folder / "link.ply").symlink_to("/etc/passwd")
    (folder / "loop.ply").symlink_to(folder / "loop.ply")
    (folder / "folder.ply").mkdir()
    os.mkfifo(folder / "pipe.ply")

    if name == "a" * 250 + "/b":  # a name that may be, of a folder that is not there
        assert file_in(folder, name, "mesh") == folder / name
        return
    with pytest.raises(ValueError, match=r"^mesh is ") as caught:
        file_in(folder, name, "mesh")
    assert words in str(caught.value)
