from __future__ import annotations

from typing import Any

import pytest

from palpate.bench.suite import groups as bench_explore
from palpate.bench.table import Row
from palpate.tools.cli import command_line as cli


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["bench", "explore", "--only", "whale"], "there is no group 'whale'; there are tracing"),
        (["bench", "touch", "--only", "whole"], "--only belongs to bus and explore"),
        (["bench", "bus", "--only", "whole"], "there is no group 'whole'; there are losses, hops,"),
        (["bench", "touch", "--json"], "--json belongs to explore"),
        (["bench", "explore", "--figures", "x"], "--figures belongs to curvature, shapes and"),
    ],
)
def test_options_of_another_bench_are_refused_in_one_sentence(
    capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    assert cli.run(arguments) == 2
    assert words in capsys.readouterr().err


def test_one_group_of_the_exploration_can_be_had_as_json(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def rows(quick: bool) -> list[Row]:
        return [Row("quick" if quick else "slow", "1", "", False)]

    groups: dict[str, Any] = {"whole": (rows,)}
    monkeypatch.setattr(bench_explore, "EXPLORE_GROUPS", groups)
    assert cli.run(["bench", "explore", "--quick", "--only", "whole", "--json"]) == 1
    said = capsys.readouterr().out
    assert '"group": "whole", "name": "quick"' in said
