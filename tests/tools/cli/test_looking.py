from __future__ import annotations

import json
import shutil

import pytest

from palpate.tools.cli import command_line as cli


@pytest.fixture
def run(run_folder, tmp_path, monkeypatch):
    """A run of one's own, in the folder where palpate is started."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(run_folder, tmp_path / "run")
    return "run"


def test_a_report_is_written_into_the_folder_of_its_run(run, tmp_path, capsys):
    assert cli.run(["report", run]) == 0
    assert capsys.readouterr().out == "run/report.html: written\n"
    first = (tmp_path / "run" / "report.html").read_text()
    assert cli.run(["report", "run/topics.mcap", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"written": ["run/report.html"]}
    assert (tmp_path / "run" / "report.html").read_text()[:2000] == first[:2000]


def test_a_report_of_two_runs_is_written_here_or_where_one_says(run, tmp_path, capsys):
    assert cli.run(["report", run, run]) == 0
    assert (tmp_path / "report.html").is_file()
    assert cli.run(["report", run, run, "-o", "both.html"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "both.html: written"


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["report"], "Missing argument 'RUNS...'"),
        (["report", "run", "run", "run"], "at most two runs side by side, got 3"),
        (["report", "nowhere"], "nowhere: is no directory of a run"),
        (["report", "run", "-o", "nowhere/report.html"], "nowhere"),
        (["film", "run"], "Missing option '-o'"),
        (["film", "nowhere", "-o", "x.gif"], "nowhere"),
        (["film", "run", "-o", "x.avi"], "must end in .mp4 or .gif"),
        (["film", "run", "-o", "x.gif", "--seconds", "0"], "0.0 is not in the range"),
    ],
)
def test_what_cannot_be_done_is_refused_in_a_sentence(run, arguments, why, capsys, tmp_path):
    before = sorted(tmp_path.rglob("*"))
    assert cli.run(arguments) == 2
    told = capsys.readouterr().err
    assert why in told
    assert len(told.splitlines()) == 1
    assert sorted(tmp_path.rglob("*")) == before


SWEEP = "scene: sphere\nlist:\n  - {planner.most_touches: 24}\n"


def test_the_runs_of_a_sweep_get_their_reports_and_its_page_leads_to_them(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.yaml").write_text(SWEEP)
    assert cli.run(["sweep", "s.yaml", "-o", "out", "--workers", "1", "--quiet"]) == 1
    capsys.readouterr()
    assert cli.run(["report", "out"]) == 0
    first, page = capsys.readouterr().out.splitlines()
    assert page == "out/index.html: written"
    place = first.removesuffix(": written")
    assert (tmp_path / place).is_file()
    text = (tmp_path / "out/index.html").read_text()
    assert text.count(f'href="{place.removeprefix("out/")}"') == 3 * 3 + 1
    # A dot a cost in each of the three widths of its figure, and the row.
    assert cli.run(["report", "out", "-o", "x.html"]) == 2
