from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from palpate.core.explore.planners.catalogue import NAMES, make_planner, planner_type
from palpate.core.explore.planners.uniform import Uniform
from palpate.launch.init_planner import init_planner
from palpate.launch.located import InputError, Located
from palpate.launch.scene_planner import check_planner

Typed = Callable[[str], Located]


def test_a_planner_is_made_with_its_settings(typed: Typed) -> None:
    given = typed("explore: {planner: uniform, settings: {count: 5, order: nested}}")
    assert check_planner(given) == Uniform(count=5, order="nested")


@pytest.mark.parametrize("name", NAMES)
def test_every_planner_can_be_named_without_settings(typed: Typed, name: str) -> None:
    assert check_planner(typed(f"explore:\n  planner: {name}\n  settings:\n")) == make_planner(
        name, {}
    )


def test_settings_alone_are_those_of_the_default(typed: Typed) -> None:
    made = check_planner(typed("explore: {settings: {cover: 5}}"))
    assert isinstance(made, planner_type(NAMES[0]))
    assert getattr(made, "cover") == 5  # noqa: B009


@pytest.mark.parametrize("text", ["seed: 3", "explore: {tolerance: 2.0e-4}", "explore: 3"])
def test_a_scene_that_says_nothing_of_a_planner_is_left_alone(typed: Typed, text: str) -> None:
    assert check_planner(typed(text)) is None


def test_a_planner_of_ones_own_is_found_in_the_folder_where_palpate_is_started(
    typed: Typed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, _, named = init_planner("found_here", tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    made = check_planner(typed(f"explore:\n  planner: {named}\n  settings: {{most_bow: 2.0}}"))
    assert type(made).__name__ == "FoundHere"
    with pytest.raises(InputError, match=r"f.yaml:3: explore.settings: most_bow is 0; exp"):
        check_planner(typed(f"explore:\n  planner: {named}\n  settings: {{most_bow: 0.0}}"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("planner: unifrom", "f.yaml:2: there is no planner 'unifrom'; did you mean 'uniform'?"),
        ("planner: 3", "f.yaml:2: explore.planner is 3; it must be a name, as predicted"),
        ("planner: no_such_module:Any", "cannot be imported: ModuleNotFoundError"),
        ("planner: json:loads", "'json:loads' is no planner: 'loads' must be a frozen dataclass"),
        ("settings: 3", "explore.settings is 3; it must be a map of numbers"),
        ("settings: {covr: 5}", "covr"),
        ("settings: {cover: 5.5}", "explore.settings.cover is 5.5; expected whole number"),
        ("settings: {cover: many}", "explore.settings.cover is 'many'; expected whole number"),
        ("settings: {cover: 4}", "cover must be odd"),
        ("settings: {travel: .nan}", "travel is nan; a number must be finite"),
    ],
)
def test_what_is_no_planner_is_refused_with_its_line(typed: Typed, text: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        check_planner(typed(f"explore:\n  {text}"))
    assert words in str(caught.value)
