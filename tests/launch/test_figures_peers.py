from __future__ import annotations

from pathlib import Path

import pytest

from palpate.launch import figures_peers
from palpate.launch.rebuild_shapes import SHAPES


def test_the_figure_shows_each_object_thrice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures_peers, "SHAPES", {"vase": SHAPES["vase"]})
    monkeypatch.setattr(figures_peers, "TOLERANCE", 2.0)
    monkeypatch.setattr(figures_peers, "DPI", 20)
    figures_peers.write_figures(tmp_path / "new")
    assert [path.name for path in (tmp_path / "new").iterdir()] == [figures_peers.NAME]
    assert len(figures_peers.draw_shapes().axes) == 4
