"""Developers' tools: damaged input is refused in one sentence, and defects are noticed."""

from importlib import import_module
from pathlib import Path

import pytest

from dev.fuzz.trials import INPUT_KINDS, InputKind, try_input
from dev.mutation.sites import bodies_of, draw, find
from palpate.launch.files.source_map import InputError

ROOT = Path(__file__).parents[1]
SLOW = pytest.mark.slow
SAMPLES = {
    "messages": range(700),
    "recordings": range(80),
    "meshes": range(150),
    "scenes": range(0, 300, 7),
    "solids": range(60),
}


@pytest.mark.parametrize("name", [
    "messages", "recordings", *(pytest.param(name, marks=SLOW) for name in [*SAMPLES][2:])
])  # fmt: skip
def test_damaged_input_is_valid_or_refused_in_one_sentence(name, tmp_path):
    INPUT_KINDS[name].prepare(tmp_path)
    outcomes = [try_input(INPUT_KINDS[name], number, tmp_path) for number in SAMPLES[name]]
    assert [trial.reason for trial in outcomes if trial.verdict == "defect"] == []
    assert {trial.verdict for trial in outcomes} == {"accepted", "refused"}


@pytest.mark.parametrize(("error", "verdict"), [
    (InputError("a.ply: is empty"), "refused"),
    (InputError("two\nlines"), "defect"),
    (KeyError("a"), "defect"),
    (MemoryError(), "defect"),
])  # fmt: skip
def test_error_other_than_a_refusal_is_a_defect(error, verdict, tmp_path):
    def attempt(*_: object) -> None:
        raise error

    kind = InputKind("x", lambda _: None, attempt, InputError)
    assert try_input(kind, 1, tmp_path).verdict == verdict


@pytest.mark.slow
def test_mutation_sites_depend_on_seed_and_are_located(tmp_path):
    (tmp_path / "messages").symlink_to(ROOT / "messages")
    bodies = bodies_of(tmp_path)
    drawn = draw(bodies, 20, 1)
    assert drawn == draw(bodies, 20, 1) != draw(bodies, 20, 2)
    assert all(find(bodies, site) for site in drawn)


@pytest.mark.parametrize("tool", ["mutation", "fuzz", "chaos", "house"])
def test_tool_prints_usage(tool, capsys):
    with pytest.raises(SystemExit) as end:
        import_module(f"dev.{tool}" if tool == "house" else f"dev.{tool}.__main__").main(["-h"])
    assert end.value.code == 0
    assert "usage" in capsys.readouterr().out
