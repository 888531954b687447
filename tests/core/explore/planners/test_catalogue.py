from __future__ import annotations

from pathlib import Path

import pytest

from palpate.core.explore.planners.catalogue import NAMES, make_planner, planner_type
from palpate.core.explore.planners.predicted import Predicted
from palpate.core.explore.planners.uniform import Uniform

OWN = """
from dataclasses import dataclass
from palpate.core.explore.planners.choice import Height, Stop

@dataclass(frozen=True, kw_only=True)
class Middle:
    share: float = 0.5

    def next(self, known):
        if known.slices:
            return Stop("one is enough", None)
        return Height(known.low + self.share * known.extent, "the middle")

@dataclass
class Loose:
    def next(self, known): ...

WORD = 1
"""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "own_planner.py").write_text(OWN)
    (tmp_path / "broken_planner.py").write_text("1 / 0")
    monkeypatch.syspath_prepend(str(tmp_path))


def test_every_name_has_its_planner_and_the_default_comes_first() -> None:
    assert planner_type(NAMES[0]) is Predicted
    for name in NAMES:
        assert make_planner(name, {}) == planner_type(name)()


def test_settings_reach_the_planner() -> None:
    assert make_planner("uniform", {"count": 5}) == Uniform(count=5)


@pytest.mark.usefixtures("own")
def test_a_users_own_planner_is_found_by_module_and_class() -> None:
    assert getattr(make_planner("own_planner:Middle", {"share": 0.3}), "share") == 0.3  # noqa: B009


@pytest.mark.usefixtures("own")
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("own_planner:Loose", "must be a frozen dataclass with next"),
        ("own_planner:WORD", "must be a frozen dataclass"),
        ("own_planner:Absent", "must be a frozen dataclass"),
        ("no_such_planner:Any", "cannot be imported: ModuleNotFoundError"),
        ("broken_planner:Any", "cannot be imported: ZeroDivisionError"),
        (".own_planner:Middle", "must name its module in full"),
    ],
)
def test_what_is_no_planner_is_refused(name: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        planner_type(name)


def test_an_unknown_name_is_refused_with_those_there_are() -> None:
    with pytest.raises(LookupError, match="no planner 'best'; there are predicted, uniform"):
        planner_type("best")


def test_an_unknown_setting_is_refused_with_those_there_are() -> None:
    with pytest.raises(ValueError, match="'uniform' has no speed; it has count, order"):
        make_planner("uniform", {"speed": 1})
