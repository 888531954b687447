from __future__ import annotations

import doctest
from pathlib import Path

import numpy as np
import pytest

from palpate.core.geometry.meshes import close_rings
from palpate.core.shapes.protocol import Mesh
from tests import figures
from tests.figures import section_lines, write_thesis_figures
from tests.studies.rebuilt import REBUILT_SHAPES
from tests.studies.thesis import EXAMPLES

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "thesis.md"


def test_a_section_of_a_tube_is_its_outline():
    turn = 2.0 * np.pi * np.arange(96) / 96
    ring = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    rings = np.stack([ring, ring + [0, 0, 2.0]])
    lines = section_lines(Mesh(*close_rings(np.zeros(3), rings, np.array([0, 0, 2.0]))))
    lengths = np.linalg.norm(np.diff(lines, axis=1)[:, 0], axis=1)
    assert lengths.sum() == pytest.approx(2 * 2.0 + 2 * 2.0, rel=1e-3)
    assert np.abs(lines[..., 0]).max() == pytest.approx(1.0)


def test_the_figures_are_drawn(tmp_path, monkeypatch):
    for name, value in (
        ("ROWS", 20),
        ("COLUMNS", 24),
        ("THESIS_DPI", 30),
        ("EXAMPLES", EXAMPLES[1:]),
    ):
        monkeypatch.setattr(figures, name, value)
    write_thesis_figures(tmp_path / "new")
    assert (tmp_path / "new" / "thesis_example_2.png").stat().st_size > 1000


def test_the_page_shows_figures_that_are_there_and_examples_that_are_right():
    page = PAGE.read_text(encoding="utf-8")
    for number in (1, 2):
        assert f"figures/thesis_example_{number}.png" in page
        assert (ROOT / "docs" / "figures" / f"thesis_example_{number}.png").is_file()
    outcome = doctest.testfile(str(PAGE), module_relative=False)
    assert outcome.failed == 0
    assert outcome.attempted >= 10


def test_the_figure_shows_each_object_thrice(tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "REBUILT_SHAPES", {"vase": REBUILT_SHAPES["vase"]})
    monkeypatch.setattr(figures, "TOLERANCE", 2.0)
    monkeypatch.setattr(figures, "PEER_DPI", 20)
    drawn = figures.draw_shapes()
    monkeypatch.setattr(figures, "draw_shapes", lambda: drawn)
    figures.write_peer_figures(tmp_path / "new")
    assert [path.name for path in (tmp_path / "new").iterdir()] == [figures.NAME]
    assert len(drawn.axes) == 4


@pytest.mark.parametrize("what", [*figures.WRITERS, "all"])
def test_the_figures_of_one_bench_or_all_are_drawn(what, tmp_path, monkeypatch):
    drawn: list[str] = []
    for name in figures.WRITERS:
        write = lambda folder, name=name: drawn.append((name, folder))  # noqa: E731
        monkeypatch.setitem(figures.WRITERS, name, write)
    assert figures.main([what, str(tmp_path)]) == 0
    names = list(figures.WRITERS) if what == "all" else [what]
    assert drawn == [(name, tmp_path) for name in names]


def test_figures_of_another_bench_are_refused(capsys):
    with pytest.raises(SystemExit) as ended:
        figures.main(["explore", "x"])
    assert ended.value.code == 2
    assert "invalid choice: 'explore'" in capsys.readouterr().err
