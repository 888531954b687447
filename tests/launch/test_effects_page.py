from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest

from palpate.core.ranges import ranges_of
from palpate.core.touch.effects.catalogue import NAMES, effect_type
from palpate.launch.scene_report import effects_known, title_of

PAGE = (Path(__file__).parents[2] / "docs" / "effects.md").read_text(encoding="utf-8")


def section(name: str) -> str:
    _, found, after = PAGE.partition(f"### {name}\n")
    assert found, name
    return after.partition("\n### ")[0]


def test_the_page_has_the_effects_in_their_order() -> None:
    assert [line[4:] for line in PAGE.splitlines() if line.startswith("### ")] == list(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_the_page_has_each_parameter_with_default_range_and_unit(name: str) -> None:
    kind = effect_type(name)
    text = section(name)
    assert title_of(name) in " ".join(text.split())
    for field in fields(kind):  # type: ignore[arg-type]
        default = "none" if field.default is None else field.default
        allowed = ranges_of(kind).get(field.name, "")
        assert f"| `{field.name}` | {default} | {allowed} |" in text


def test_the_list_names_every_effect_and_parameter() -> None:
    said = effects_known()
    for name in NAMES:
        assert f"{name}: {title_of(name)}" in said
        assert all(f"\n  {field.name} " in said for field in fields(effect_type(name)))  # type: ignore[arg-type]
