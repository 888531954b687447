from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from palpate.launch.replay.changes import FieldChange, Note
from palpate.launch.replay.text import table


def player(fields: dict[str, FieldChange], *, fewer: int = 0, more: int = 0) -> Any:
    """A node that says ``/x``, of which 20 messages were compared."""
    changes = SimpleNamespace(fields=fields)
    said = SimpleNamespace(topic="/x", compared=20, fewer=fewer, more=more, changes=changes)
    return SimpleNamespace(says={"/x": said})


def test_a_field_without_a_size_has_its_note_in_that_place() -> None:
    height = FieldChange("m", 3, 12, 4, 0.5, 0.25, {"shape": Note(2, "(1,)", "(2,)")})
    kind = FieldChange("", 5, 1, notes={"value": Note(1, "'hit'", "'miss'")})
    count = FieldChange("#", 5, 1, 1, 2.0, 4.0)

    lines = list(table([player({"height": height, "kind": kind, "count": count}, fewer=3)]))

    assert lines == [
        "topic  field     compared  differ  first  largest   rms  unit",
        "/x     height          20      12      3      0.5  0.25  m      2 of another shape, "
        "first (1,) -> (2,)",
        "/x     kind            20       1      5  1 changed, first 'hit' -> 'miss'",
        "/x     count           20       1      5        2     2  count",
        "/x     messages        20             20  3 fewer than recorded",
    ]


def test_there_is_no_table_where_nothing_has_changed() -> None:
    assert list(table([player({})])) == []


def test_a_table_of_nothing_but_counts_has_all_heads() -> None:
    lines = list(table([player({}, more=1)]))

    assert lines == [
        "topic  field     compared  differ  first  largest  rms  unit",
        "/x     messages        20             20  1 more than recorded",
    ]
