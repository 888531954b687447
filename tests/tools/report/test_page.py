from __future__ import annotations

import base64
import gzip
import json
import re
import shutil
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from palpate.launch.files import InputError, uncertainties
from palpate.tools.report import page, write_report
from palpate.tools.report.run_facts import ratio_rows, read_run
from palpate.tools.report.view_data import SHADES, STEPS, view_data
from palpate.tools.view import read_timeline

VIEWER = Path(page.__file__).parent / "viewer"


@pytest.fixture(scope="module")
def text(run_folder, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report([run_folder], path)
    return path.read_text("utf-8")


def sections(text: str) -> dict[str, str]:
    parts = re.split(r"<h2>(.*?)</h2>", text)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def test_every_section_is_there_with_the_figures_of_the_run(text, run_folder):
    found, summary = sections(text), json.loads((run_folder / "summary.json").read_text())
    assert list(found) == list(page.SECTIONS)
    head = found["What was found"]
    assert f"{1e3 * summary['rms_m']:.3f} mm" in head
    assert f"{1e3 * summary['sampling_floor_m']:.3f} mm" in head
    assert f">{summary['touches']}<" in head
    for node in summary["nodes"]:
        assert f"<td >{node}</td>" in found["Load and latency"]
    assert "gaussian_noise" in found["Effects"]
    assert "sigma 5e-06 m" in found["Effects"]
    assert summary["mesh_sha256"] in found["How to run it again"]
    assert "palpate launch" in found["How to run it again"]


def test_nothing_is_fetched_from_elsewhere(text):
    plain = re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)
    targets = re.findall(r'(?:src|href)="([^"]*)"', plain)
    assert targets
    assert [one for one in targets if not one.startswith("data:")] == []
    assert "@import" not in plain
    assert "url(" not in plain


def test_every_picture_has_an_alternative_text_and_headings_go_down_in_steps(text):
    plain = re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)
    pictures = re.findall(r"<img [^>]*>", plain)
    assert len(pictures) == 5  # three of them are what accuracy cost, each for another width
    assert all(re.search(r'alt="[^"]{20,}"', one) for one in pictures)
    levels = [int(one) for one in re.findall(r"<h(\d)>", plain)]
    assert levels[0] == 1
    assert max(np.diff(levels)) == 1


def unpacked(data, place):
    kinds = {"u1": np.uint8, "u2": np.dtype("<u2"), "u4": np.dtype("<u4")}
    kind, offset, length = place
    return np.frombuffer(
        gzip.decompress(base64.b64decode(data.packed)), kinds[kind], length, offset
    )


def test_the_view_has_models_contours_touches_and_truth_to_half_a_step(run_folder):
    line = read_timeline(run_folder)
    data = view_data(line, [])
    told = json.loads(data.described)
    low, step = np.array(told["low"]), told["step"]
    assert len(told["models"]) == len(line.models)
    last, shown = line.models[-1], told["models"][-1]
    assert (unpacked(data, shown["faces"]).reshape(-1, 3) == last.faces).all()

    def places(one):
        return low + step * unpacked(data, one).reshape(-1, 3)

    assert np.abs(places(shown["vertices"]) - last.vertices).max() <= 0.5001 * step
    assert np.abs(places(told["truth"]["vertices"]) - line.truth.floor_vertices).max() < step
    for one, contour in zip(told["contours"], line.contours, strict=True):
        assert np.abs(places(one["points"]) - contour.points).max() <= 0.5001 * step
        assert one["time"] == contour.robot_time
    touched = np.concatenate([one.points for one in line.touches])
    assert np.abs(places(told["touches"]["points"]) - touched).max() <= 0.5001 * step
    assert told["touches"]["ends"][-1] == len(touched)
    assert step * STEPS < 0.5  # m: a step is some micrometres


def test_the_colours_are_deviation_and_uncertainty_over_the_top_of_their_scales(run_folder):
    line = read_timeline(run_folder)
    data = view_data(line, [])
    last = json.loads(data.described)["models"][-1]
    truth = {
        "deviation": line.surface.deviations(line.models[-1].vertices),
        "uncertainty": uncertainties(line.models[-1]),
    }
    assert list(data.tops) == list(truth)
    for name, values in truth.items():
        shades = unpacked(data, last["values"][name]) / SHADES * data.tops[name]
        inside = values < data.tops[name]
        assert inside.mean() > 0.95
        assert np.abs(shades - values)[inside].max() <= 0.5001 * data.tops[name] / SHADES
        assert (shades[~inside] == data.tops[name]).all()


def test_a_run_without_a_recording_has_figures_and_no_view(run_folder, tmp_path):
    for name in ("summary.json", "launch.yaml", "scene.yaml"):
        shutil.copy(run_folder / name, tmp_path)
    text = page.report_text([read_run(tmp_path)])
    found = sections(text)
    assert "The object" not in found
    assert "Contours" not in found
    assert "Effects" not in found  # it had some, but over no touch can they be measured
    assert '<script type="application/json">' not in text
    assert {"What was found", "What accuracy cost", "Graph"} <= found.keys()


def test_a_run_whose_launch_file_no_longer_holds_lacks_only_what_follows_from_it(
    run_folder, tmp_path
):
    folder = tmp_path / "run"
    shutil.copytree(run_folder, folder)
    (folder / "launch.yaml").write_text("nodes: {a: {kind: gone.module}}\n")
    found = sections(page.report_text([read_run(folder)]))
    assert "Graph" not in found
    assert "Effects" not in found  # nobody can tell what was simulated
    assert "The object" in found


def test_what_the_user_wrote_is_text_and_no_markup(run_folder, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(run_folder, folder)
    summary = json.loads((folder / "summary.json").read_text())
    summary |= {"scene": "<b>&", "reason": "<script>alert(1)</script>", "missed": ["<i>"]}
    (folder / "summary.json").write_text(json.dumps(summary))
    text = page.report_text([read_run(folder)])
    assert "&lt;b&gt;&amp;" in text
    assert "<script>alert" not in text
    assert "<i>" not in text


def test_letters_that_are_no_unicode_do_not_spoil_the_page(run_folder, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(run_folder, folder)
    (folder / "scene.yaml").write_bytes(b"\xff")
    summary = json.loads((folder / "summary.json").read_text())
    (folder / "summary.json").write_text(json.dumps(summary | {"scene": "\ud800 vase"}))
    write_report([folder], tmp_path / "report.html")
    assert "? vase" in (tmp_path / "report.html").read_text("utf-8")


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("summary.json", None, "no summary.json"),
        ("summary.json", b"{}", "of another version: no good 'reason'"),
        ("summary.json", b"[" * 200_000, "is no JSON"),
        ("topics.mcap", b"nonsense", "topics.mcap"),
        ("log.jsonl", b'{"level": "warn', "is no log of a run"),
        ("log.jsonl", b"{}", "is no log of a run"),
        ("log.jsonl", b"\xff", "is no log of a run"),
    ],
)
def test_a_folder_that_is_no_run_is_refused(run_folder, tmp_path, name, content, why):
    folder = tmp_path / "run"
    shutil.copytree(run_folder, folder)
    (folder / name).unlink(missing_ok=True)
    if content is not None:
        (folder / name).write_bytes(content)
    with pytest.raises(InputError, match=why):
        write_report([folder], tmp_path / "report.html")
    assert not (tmp_path / "report.html").exists()


def test_two_runs_stand_side_by_side_with_the_ratio_of_their_figures(run_folder, tmp_path):
    write_report([run_folder, run_folder], tmp_path / "r.html")
    text = (tmp_path / "r.html").read_text()
    side = sections(text)["Side by side"]
    assert side.count(">1.00<") == len(list(ratio_rows([read_run(run_folder).summary] * 2)))
    assert text.count('class="view3d"') == 2
    assert re.findall(r'id="(view\d)"', text) == ["view0", "view1"]


def test_ratios_leave_out_what_one_run_does_not_know():
    first = {"rms_m": 2e-4, "touches": 10, "robot_time_s": 0.0, "open_share": None}
    second = {"rms_m": 1e-4, "touches": 30, "robot_time_s": 5.0, "open_share": 0.1}
    rows = dict(ratio_rows([first, second]))
    assert rows["rms error"] == ["0.2 mm", "0.1 mm", "0.50"]
    assert rows["touches"] == ["10", "30", "3.00"]
    assert rows["robot time"][2] == ""
    assert "unknown share" not in rows


def test_the_program_of_the_view_was_made_from_its_source():
    bundle = (VIEWER / "viewer.min.js").read_text("utf-8")
    stamp = sha256((VIEWER / "viewer.js").read_bytes()).hexdigest()
    assert bundle.startswith(f"// viewer.js {stamp}"), "npm run build in tools/report/viewer"
    assert "Three.js Authors" in bundle
    assert "</script" not in bundle
