from __future__ import annotations

from pathlib import Path

import pytest

from palpate.launch.processes.folder import place_of, private_folder


def test_the_folder_is_private_and_vanishes_with_all_that_is_in_it(tmp_path: Path) -> None:
    with private_folder(tmp_path) as folder:
        assert folder.stat().st_mode & 0o777 == 0o700
        (folder / "n0").touch()
    assert list(tmp_path.iterdir()) == []


def test_the_users_own_folder_is_preferred(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with private_folder(None) as folder:
        assert folder.parent == tmp_path


def test_without_a_folder_of_ones_own_the_temporary_one_will_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "nowhere"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with private_folder(None) as folder:
        assert folder.parent == tmp_path


def test_nodes_of_any_name_have_addresses_of_their_own(tmp_path: Path) -> None:
    place = place_of(tmp_path, ["finger_1/filter", "x" * 200], depth=7, past=tmp_path)
    addresses = [*place.endpoints.values(), *place.taps.values(), place.control, place.tools]
    assert len(set(addresses)) == 6
    assert all(address.startswith(f"ipc://{tmp_path}/") for address in addresses)
    assert place.depth == 7
