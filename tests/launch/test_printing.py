import pytest

from palpate.launch.printing import counted, millimetres, size_text, text_table, titled


def test_columns_are_aligned_and_no_cell_is_cut():
    assert text_table(
        [("topic", "n", "to"), ("/a", "12", ""), ("/[b]x", "3", ":smile:")], (1,)
    ) == ["topic   n  to", "/a     12", "/[b]x   3  :smile:"]
    assert "x" * 200 in text_table([("a", "b"), ("x" * 200, "1")], least=(1, 3))
    assert text_table([("a", "b")], (1,), (3, 4)) == ["a       b"]


def test_lines_break_between_parts_and_long_words_stay_whole():
    assert titled("time", *["one part"] * 8) == [
        "time       one part  one part  one part  one part  one part  one part  one part",
        "           one part",
    ]
    assert titled("run", "/a" * 60, width=4) == ["run " + "/a" * 60]
    assert titled("nodes") == ["nodes      "]


@pytest.mark.parametrize(
    ("size", "text"),
    [(0, "0 B"), (999, "999 B"), (1500, "1.5 kB"), (2_000_000, "2.0 MB"), (3 * 10**9, "3.0 GB")],
)
def test_sizes_have_the_unit_that_suits_them(size, text):
    assert size_text(size) == text


def test_figures_have_units_and_things_are_counted():
    assert millimetres(0.0123456) == "12.346 mm"
    assert [counted(1, "touch", "touches"), counted(2, "touch", "touches")] == [
        "1 touch",
        "2 touches",
    ]
    assert counted(3, "topic") == "3 topics"


def test_a_last_cell_of_words_is_broken_so_that_lines_have_80_columns():
    names = ", ".join(f"node_{number}" for number in range(12))
    beside, below = (text_table([("topic", "to"), (head, names)]) for head in ("/a", 70 * "x"))
    assert beside[1].startswith("/a     node_0, node_1")
    assert all(line.startswith("       node_") for line in beside[2:])
    assert below[1] == 70 * "x"
    assert below[2].startswith("    node_0, node_1")
    for lines in (beside, below):
        assert max(map(len, lines)) <= 80
        assert " ".join(" ".join(lines).split()).endswith(names)


def test_columns_beyond_80_stand_below_each_row_and_nothing_is_cut():
    rows = [("topic", "field", "first", "told"), (50 * "x", 40 * "y", "1.5", "word " * 20)]
    lines = text_table(rows, right=(2,))
    assert max(map(len, lines)) <= 80
    assert " ".join(lines).split() == " ".join(cell for row in rows for cell in row).split()
