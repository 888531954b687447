from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from palpate.launch.files import InputError
from tests.studies.accuracy import runs as kept
from tests.studies.accuracy.conftest import point, run_of
from tests.studies.accuracy.runs import FORM, VERSION, Run, RunsFile, read_runs

HEAD = {"form": FORM, "version": VERSION, "methods": {"mine": "a method"}}
POINT = {"touches": 5, "robot_time_s": 1.0, "compute_s": 0.1, "rms_m": 1e-3, "chamfer_m": 8e-4}
RUN: dict[str, Any] = {
    **{"method": "mine", "object": "egg", "seed": 0, "tolerance_m": None, "size_m": 0.09},
    **{"sampling_floor_m": 0.0, "curve": [POINT], "final": None},
}


def written(folder: Path, content: Any) -> Path:
    path = folder / "runs.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_what_another_program_wrote_is_read(tmp_path):
    [run] = read_runs(written(tmp_path, {**HEAD, "runs": [RUN]})).runs
    assert (run.key, run.curve[0].bound_m) == (("mine", "egg", 0, None), None)
    assert run.error == pytest.approx(1e-3 / 0.09)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "holds no results of palpate tolerance: "),
        ({"form": "other"}, "holds no results of palpate tolerance"),
        ({**HEAD, "version": 2}, "holds results of version 2; this palpate reads version 1"),
        ({**HEAD, "runs": [{**RUN, "size_m": 0.0}]}, r"> 0.0 - at `\$.runs\[0\].size_m`"),
        ({**HEAD, "runs": [{**RUN, "size": 1.0}]}, "unknown field `size`"),
        ({**HEAD, "runs": [RUN, RUN]}, "has the run .'mine', 'egg', 0, None. more than once"),
        ({**HEAD, "methods": {}, "runs": [RUN]}, "methods says nothing of 'mine', which has runs"),
        (
            {**HEAD, "runs": [{**RUN, "curve": [POINT, {**POINT, "touches": 4}]}]},
            "curve of mine on egg must not become cheaper, got 4 touches after 5",
        ),
    ],
)
def test_what_is_no_file_of_runs_is_refused_in_one_sentence(tmp_path, content, words):
    with pytest.raises(InputError, match=words) as told:
        read_runs(written(tmp_path, content))
    assert "\n" not in str(told.value)


def test_runs_are_kept_as_they_come_and_found_again(tmp_path):
    path = tmp_path / "results.json"
    first = RunsFile(path, {"mine": "a method"}, ("Poisson",))
    first.add([run_of()])
    again = RunsFile(path, {"other": "another"}, ())
    again.add([run_of(method="other", curve=(point(3, 1e-3), point(9, 1e-4)))])
    found = read_runs(path)
    assert [one.method for one in found.runs] == ["mine", "other"]
    assert set(found.methods) == {"mine", "other"}
    assert found.machine["cores"]
    assert isinstance(found.runs[0], Run)


def test_runs_of_another_palpate_are_not_mixed_with_those_of_today(tmp_path, monkeypatch):
    path = tmp_path / "results.json"
    RunsFile(path, {"mine": "a method"}, ()).add([run_of()])
    monkeypatch.setattr(kept, "SOURCES", ("core",))
    with pytest.raises(InputError, match="was measured with another palpate; name another folder"):
        RunsFile(path, {"mine": "a method"}, ())


def test_the_file_that_the_page_shows_is_read(tmp_path):
    page = Path(__file__).parents[3] / "docs" / "benchmark.md"
    [shown] = re.findall(r"```json\n(.*?)```", page.read_text(), re.DOTALL)
    [run] = read_runs(written(tmp_path, shown)).runs
    assert (run.method, run.curve[1].bound_m) == ("spiral", 5e-4)
    assert run.final is not None and run.final.touched_5mm["20"] == 0.29
