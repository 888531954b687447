from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from palpate.launch import explore as module
from palpate.launch.display import Silence
from palpate.launch.explore import explore
from palpate.launch.launch_path import EXPLORE
from palpate.launch.located import InputError, Located


def test_exploring_from_python_is_what_run_does(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, Any] = {}

    def plan(path: Path, args: Mapping[str, Located], settings: Any, **rest: Any) -> str:
        asked.update(path=path, settings=settings, **rest)
        asked["args"] = {name: value.value for name, value in args.items()}
        return "the plan"

    def perform(plan: str, **rest: Any) -> str:
        asked.update(plan=plan, **rest)
        return "the run"

    monkeypatch.setattr(module, "plan_run", plan)
    monkeypatch.setattr(module, "perform", perform)

    settings = {"planner.tolerance": 1e-4}
    done = explore("vase", seed=3, fingers=2, settings=settings, out="here", composed=True)

    assert done == "the run"  # type: ignore[comparison-overlap]
    assert asked["plan"] == "the plan"
    assert (asked["path"], asked["name"], asked["out"]) == (EXPLORE, "vase", Path("here"))
    assert Path(asked["args"].pop("scene")).name == "vase.yaml"
    assert asked["args"] == {"record": True, "seed": 3, "fingers": 2}
    assert asked["settings"]["planner.tolerance"].value == 1e-4
    assert asked["composed"] is True
    assert isinstance(asked["display"], Silence)


def test_a_scene_that_is_not_there_is_refused() -> None:
    with pytest.raises(InputError, match="there is no scene 'vaes'"):
        explore("vaes")
