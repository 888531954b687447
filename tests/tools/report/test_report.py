"""Reports: sections with the figures of their runs, the packed view, places of faults."""

import base64
import gzip
import json
import re
import shutil
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

import palpate.tools.report
from palpate.launch.files.mesh_file import uncertainties
from palpate.launch.files.source_map import InputError
from palpate.messages.types import Contour, ShapeModel, SurfacePatch
from palpate.tools.bag.decoding import open_decoded
from palpate.tools.drawables import LAYERS, Lines, Mesh, Points
from palpate.tools.report.page import write_report
from palpate.tools.view.timeline import read_timeline
from tests.tools.recordings import write_recording

SECTIONS = [
    *("The object", "What was found", "What accuracy cost", "Contours", "Load and latency"),
    *("Effects", "Diagnostics of the fit", "Graph", "How to run it again"),
]


def report_of(*folders):
    path = folders[0].parent / f"{folders[0].name}.html"
    write_report(folders, path)
    text = path.read_text("utf-8")
    path.unlink()
    return text


@pytest.fixture(scope="module")
def text(run_folder):
    return report_of(run_folder)


def sections(text: str) -> dict[str, str]:
    parts = re.split(r"<h2>(.*?)</h2>", text)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def test_sections_hold_the_figures_of_the_run(text, run_folder):
    by_heading, summary = sections(text), json.loads((run_folder / "summary.json").read_text())
    assert list(by_heading) == SECTIONS
    lengths = [f"{1e3 * summary[name]:.3f} mm" for name in ("rms_m", "sampling_floor_m")]
    for words in (*lengths, f">{summary['touches']}<"):
        assert words in by_heading["What was found"]
    assert all(f"<td >{node}</td>" in by_heading["Load and latency"] for node in summary["nodes"])
    assert "gaussian_noise" in by_heading["Effects"] and "sigma 5e-06 m" in by_heading["Effects"]
    assert "cast" in by_heading["Effects"]
    assert summary["mesh_sha256"] in by_heading["How to run it again"]
    assert "palpate launch" in by_heading["How to run it again"]


def test_page_is_self_contained_and_accessible(text):
    plain = re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)
    targets = re.findall(r'(?:src|href)="([^"]*)"', plain)
    assert targets and [one for one in targets if not one.startswith("data:")] == []
    assert "@import" not in plain and "url(" not in plain
    pictures = re.findall(r"<img [^>]*>", plain)
    assert len(pictures) == 6  # the object, errors against each cost, time by step, the graph
    assert all(re.search(r'alt="[^"]{20,}"', one) for one in pictures)
    levels = [int(one) for one in re.findall(r"<h(\d)>", plain)]
    assert levels[0] == 1 and max(np.diff(levels)) == 1


class Packed:
    """What the view of a page draws."""

    def __init__(self, text: str) -> None:
        (described,) = re.findall(r'<script type="application/json">(.*?)</script>', text)
        (packed,) = re.findall(r'<script type="text/plain">(.*?)</script>', text)
        self.described = json.loads(described)
        self._data = gzip.decompress(base64.b64decode(packed))
        self.step = self.described["step"]

    def array(self, place):
        return np.frombuffer(self._data, f"<{place[0]}", place[2], place[1])

    def points(self, place):
        return np.array(self.described["low"]) + self.step * self.array(place).reshape(-1, 3)


def test_packed_view_holds_the_run_to_half_a_step(text, run_folder):
    line, packed = read_timeline(run_folder), Packed(text)
    shown, step = packed.described, packed.step
    assert len(shown["models"]) == len(line.models) and step < 1e-5  # [m]
    assert {name: one["colour"] for name, one in shown["layers"].items()} == {
        name: layer.colour for name, layer in LAYERS.items()
    }
    wanted = {(one.path, one.time or 0.0): one.shape for one in line.drawn(line.at(line.end))}
    packed_shapes = {(one["path"], one["time"]): one for one in shown["drawables"]}
    kinds = {Mesh: "vertices", Lines: "pieces", Points: "points"}
    for key, shape in wanted.items():
        if key[0] == "touched":
            continue
        if key[0].startswith("finger"):
            assert packed_shapes[key]["pose"] == pytest.approx(shape.pose.tolist(), abs=1e-6)
            continue
        kind = kinds[type(shape)]
        exact = shape.pieces(0.0).reshape(-1, 3) if kind == "pieces" else getattr(shape, kind)
        assert np.abs(packed.points(packed_shapes[key][kind]) - exact).max() <= 0.5001 * step
    last = packed_shapes["solid", line.models[-1].robot_time]
    assert (packed.array(last["faces"]).reshape(-1, 3) == line.models[-1].faces).all()
    touched, touches = np.concatenate([one.points for one in line.touches]), shown["touches"]
    assert np.abs(packed.points(touches["points"]) - touched).max() <= 0.5001 * step
    assert touches["ends"][-1] == len(touched)
    for name in {one["layer"] for one in shown["drawables"]} | {"touched"}:
        assert f'background: {LAYERS[name].colour}"></i> {LAYERS[name].label}</label>' in text

    # Colours are deviation and uncertainty.
    model = [one for one in shown["drawables"] if one["layer"] == "solid"][-1]
    truth = {
        "deviation": line.surface.deviations(line.models[-1].vertices),
        "uncertainty": uncertainties(line.models[-1]),
    }
    assert list(model["values"]) == list(truth)
    for name, values in truth.items():
        shades = packed.array(model["values"][name]) / 255.0
        inside = shades < 1.0
        top = np.median(values[inside] / np.maximum(shades[inside], 1e-9))
        assert inside.mean() > 0.9
        # Half a shade, and as much again for the top of the scale, which is estimated here.
        assert np.abs(shades * top - values)[inside].max() <= 1.2 * top / 255.0


@pytest.fixture
def folder(run_folder, tmp_path):
    """A copy of the run."""
    shutil.copytree(run_folder, tmp_path / "run")
    return tmp_path / "run"


@pytest.mark.slow
def test_missing_parts_leave_their_sections_out(folder):
    launch, text = folder / "launch.yaml", (folder / "launch.yaml").read_text()
    plain, number = re.subn(r"\n( +)effects:\n(?:\1 +.*\n)+", r"\n\1effects: {}\n", text)
    launch.write_text(plain)
    assert number == 1
    none_simulated = [sections(report_of(folder))["Effects"]]
    launch.write_text("nodes: {a: {kind: gone.module}}\n")
    by_heading = sections(report_of(folder))
    assert "The object" in by_heading and not {"Graph", "Effects"} & by_heading.keys()
    (folder / "topics.mcap").unlink()
    text = report_of(folder)
    assert '<script type="application/json">' not in text
    assert not {"The object", "Contours", "Effects"} & sections(text).keys()
    assert {"What was found", "What accuracy cost"} <= sections(text).keys()
    launch.write_text(plain)
    for section in (*none_simulated, sections(report_of(folder))["Effects"]):
        assert "gaussian_noise" not in section and "cast" not in section


@pytest.mark.slow
def test_texts_of_users_are_no_markup_and_log_shows_warnings(folder):
    summary = json.loads((folder / "summary.json").read_text())
    summary |= {"scene": "<b>& \ud800 vase", "reason": "<script>alert(1)</script>"}
    (folder / "summary.json").write_text(json.dumps(summary | {"missed": ["<i>"]}))
    (folder / "scene.yaml").write_bytes(b"\xff")
    line = '{{"level": "{0}", "node": "filter", "text": "a {0} of mine"}}\n'
    text = "".join(map(line.format, ("info", "warning", "error")))
    (folder / "log.jsonl").write_text(text)
    text = report_of(folder)
    assert "&lt;b&gt;&amp; ? vase" in text
    assert "<script>alert" not in text and "<i>" not in text
    assert "a warning of mine" in text and "a error of mine" in text
    assert "a info of mine" not in text


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
def test_folder_that_is_no_run_is_refused(folder, name, content, why):
    (folder / name).unlink(missing_ok=True)
    if content is not None:
        (folder / name).write_bytes(content)
    with pytest.raises(InputError, match=why):
        write_report([folder], folder.parent / "report.html")
    assert not (folder.parent / "report.html").exists()


@pytest.mark.slow
def test_two_runs_stand_side_by_side_with_ratios(run_folder, folder):
    summary = json.loads((folder / "summary.json").read_text())
    changed = {"rms_m": 0.5 * summary["rms_m"], "touches": 3 * summary["touches"]}
    (folder / "summary.json").write_text(json.dumps(summary | changed | {"open_share": None}))
    text = report_of(run_folder, folder)
    side = sections(text)["Side by side"]
    rows = {
        row[0]: row[1:]
        for row in (re.findall(r"<t[dh][^>]*>([^<]*)</t[dh]>", one) for one in side.split("<tr>"))
        if row
    }
    assert rows["rms error"][-1] == "0.50"
    assert rows["touches"] == [str(summary["touches"]), str(3 * summary["touches"]), "3.00"]
    assert rows["robot time"][-1] == "1.00" and "unknown share" not in rows
    assert re.findall(r'id="(view\d)"', text) == ["view0", "view1"]


def test_program_of_the_view_is_built_from_its_source():
    viewer = Path(palpate.tools.report.__file__).parent / "viewer"
    bundle = (viewer / "viewer.min.js").read_text("utf-8")
    stamp = sha256((viewer / "viewer.js").read_bytes()).hexdigest()
    assert bundle.startswith(f"// viewer.js {stamp}"), "npm run build in tools/report/viewer"
    assert "Three.js Authors" in bundle and "</script" not in bundle


def faulty(messages):
    """The messages of a run with a fault of each kind."""
    contours = patches = 0
    last = max(m.number for _, m in messages if isinstance(m, ShapeModel))
    first = next(m.id for _, m in messages if isinstance(m, Contour))
    for topic, message in messages:
        if isinstance(message, Contour):
            contours += 1
            ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.02, 0.0]])
            gap = {"gap_starts": ends[:1], "gap_ends": ends[1:], "gap_reasons": ("bridged",)}
            message = replace(message, **(gap if contours == 1 else {"status": "stuck"}))
            yield topic, message
            if contours == 1:
                yield topic, replace(message, id=99, status="stuck")
            continue
        if isinstance(message, SurfacePatch):
            patches += 1
            fault = {4: {"residual": 1.0}, 6: {"kind": "insufficient"}, 8: {"outcome": "bottomed"}}
            message = replace(message, **fault.get(patches, {}))
        if isinstance(message, ShapeModel) and message.number == last:
            left_out = {"dropped": (first,), "dropped_reasons": ("it crosses itself",)}
            message = replace(message, **left_out, openings=np.zeros((1, 3)))
        yield topic, message


@pytest.mark.slow
def test_diagnostics_lead_to_places_and_times(folder):
    kept = open_decoded(folder)
    messages = [(one.topic, one.message) for one in kept.published()]
    write_recording(folder / "topics.mcap", [*faulty(messages)], about=kept.recording.about)
    summary = json.loads((folder / "summary.json").read_text())
    places = {"open_places_m": [[0.01, 0, 0.02]]}
    (folder / "summary.json").write_text(json.dumps(summary | places))
    text = report_of(folder)
    section, shown = sections(text)["Diagnostics of the fit"], Packed(text).described["places"]
    buttons = re.findall(r'data-place="(\d+)">([^<]*)</button>', section)
    by_text = {text: shown[int(number)] for number, text in buttons}
    line = read_timeline(folder)
    first = line.contours[0]
    gap = by_text[f"contour {first.id}: 20.000 mm bridged"]
    assert (gap["point"], gap["time"]) == ([0.0, 0.01, 0.0], first.robot_time)
    stuck = by_text["contour 99: stuck"]
    assert stuck["point"] == pytest.approx(first.points[-1].tolist())
    assert f"contour {first.id}: it crosses itself" in by_text
    assert by_text["1: the widest"] == {"time": line.end, "point": [0.01, 0, 0.02]}
    assert "a pad touched nothing there" in by_text
    for number, words in ((3, "residual 1000"), (5, "insufficient"), (7, "bottomed")):
        (place,) = (place for text, place in by_text.items() if words in text)
        assert place["time"] == pytest.approx(line.touches[number].time)
    for kind in ("gaps in contours", "contours that did not close", "touches that fit badly"):
        assert kind in section


@pytest.mark.slow
def test_report_is_written_into_the_run_folder(folder, call, monkeypatch):
    monkeypatch.chdir(folder.parent)
    assert call("report run").out == "run/report.html: written\n"
    assert (folder / "report.html").read_text().count('class="view3d"') == 1
    (folder / "topics.mcap").rename(folder.parent / "topics.mcap")  # it takes long to draw
    out = call("report run run --json").out
    assert json.loads(out) == {"written": ["report.html"]}
    assert call("report run -o one.html").out == "one.html: written\n"
    assert (folder.parent / "report.html").is_file() and (folder.parent / "one.html").is_file()


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("", "Missing argument 'RUNS...'"),
        ("run run run", "at most two runs side by side, got 3"),
        ("nowhere", "nowhere: is no directory of a run"),
        pytest.param("run -o nowhere/report.html", "nowhere", marks=pytest.mark.slow),
    ],
)
def test_bad_report_arguments_are_refused(folder, refusal, monkeypatch, words, why):
    monkeypatch.chdir(folder.parent)
    before = sorted(folder.parent.rglob("*"))
    assert why in refusal(f"report {words}")
    assert sorted(folder.parent.rglob("*")) == before
