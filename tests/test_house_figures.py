from __future__ import annotations

from palpate.core.geometry.meshes import solidity
from palpate.core.shapes.tessellations import icosphere
from tests import house
from tests.house import (
    Call,
    CallWatch,
    Visit,
    code_lines,
    folder_size,
    frames_of,
    house_rows,
    passed,
    sources,
    within,
)

TEXT = '''"""A module.

Two lines of it.
"""

# A comment
NAME = """a string
of two lines"""


def call() -> None:
    """One line."""
    return None
'''


def test_blank_lines_comments_and_docstrings_are_no_code(tmp_path):
    assert code_lines(TEXT) == 4
    (tmp_path / "one.py").write_text(TEXT)
    assert folder_size("x", [tmp_path / "one.py"])[1:] == (1, 13, 4, 13, 0, 1)


def test_the_product_is_the_sum_of_its_folders(monkeypatch):
    monkeypatch.setattr(house, "FOLDERS", ("launch", "palpate", "tests"))
    monkeypatch.setattr(house, "sources", lambda folder: sources(folder)[:9])
    _, product, *folders = house_rows(quick=True)
    rooms = [one for one in folders if one.name != "tests"]
    assert {one.name for one in rooms} == {"launch", "palpate"}
    assert product[1:4] == tuple(sum(one[i] for one in rooms) for i in (1, 2, 3))


def test_calls_are_told_by_file_until_a_function_returns():
    mesh = icosphere(2)
    with CallWatch() as watch:
        solidity(*mesh)
    assert "core/geometry/meshes.py" in watch.files
    assert "tests/test_house_figures.py" not in {
        call.file for _, calls in watch.visits for call in calls
    }


def test_a_frame_is_one_round_of_all_its_nodes():
    def visit(node: str) -> Visit:
        return node, (Call(True, f"{node}.py", "f"), Call(False, f"{node}.py", "f"))

    nodes = ("simulator", "filter", "curvature", "tracer", "reconstructor")
    visits = [visit(node) for node in ("filter", *nodes, "simulator", "filter")]
    [calls] = frames_of(visits)
    assert passed(calls) == {"files": 5, "changes of file": 4, "calls": 5}
    assert within(calls, "g") == calls[:2]
