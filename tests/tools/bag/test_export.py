"""Exports to CSV, NPZ and PLY, and recordings as tables: every field comes back."""

import csv
import json
import re
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import pytest

import palpate
from palpate.launch.files.mesh_file import read_mesh
from palpate.launch.files.source_map import InputError
from palpate.messages import Array, schema, schema_hash
from palpate.messages.fields import Floats, Unit
from palpate.messages.types import PlanDone, SurfacePatch
from palpate.nodes.runtime.testing import example
from palpate.tools.bag.export import export_bag
from tests.tools.recordings import WORLD, frame, log

COUNTS = {
    "csv": "13 files of 12 topics",
    "ply": "2 meshes of 2 topics",
    "npz": r"\d+ arrays of 14 topics",
    "foxglove": r"\d+ messages of 14 topics",
}
LEFT_OUT = "\nleft to --format ply, as meshes: /model/shape, /truth"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Own:
    force: Annotated[float, Unit("N")]
    places: Annotated[Floats, Array("<f8", (None, 3), "m")]
    name: str
    table: dict[str, float]


def own(force: float, count: int, name: str, **table: float) -> Own:
    return Own(force=force, places=np.full((count, 3), force), name=name, table=table)


OWN = [own(1.0, 2, "a", x=1.5, y=2.0), own(2.5, 5, "longer", y=3.0, z=-1.0)]


@pytest.fixture
def messages(explored_messages):
    """A message of most kinds, and two of a type that palpate does not have."""
    return [*explored_messages, *(("/own", one) for one in OWN)]


@pytest.fixture
def recorded(record, messages):
    return record(messages, schemas={"Own": json.dumps(schema(Own))})


@pytest.mark.parametrize("kind", COUNTS)
def test_each_format_is_written_whole_reported_and_not_overwritten(explored, tmp_path, kind, call):
    out = tmp_path / "out"
    code, text, _ = call("bag export", explored, "--format", kind, "-o", out)
    assert code == 0
    assert re.fullmatch(rf"{out}: {COUNTS[kind]}\n", text.replace(LEFT_OUT, ""))
    assert (LEFT_OUT in text) == (kind == "csv")
    assert sorted(one.name for one in tmp_path.iterdir()) == ["out", "topics.mcap"]
    (tmp_path / "file").write_text("mine")
    for name in ("out", "file"):
        with pytest.raises(InputError, match=f"{name}: exists already; it is not overwritten"):
            export_bag(explored, kind, tmp_path / name)
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("kind", ["csv", "npz", "foxglove"])
def test_undecodable_message_is_refused_without_leftovers(record, tmp_path, kind):
    how = {"types": {"/world": "World"}, "schema": schema_hash(type(WORLD))}
    path = record([("/world", WORLD), ("/world", b"\x80")], **how)
    with pytest.raises(InputError, match=r"topics.mcap: /world 1: not a World: missing field plat"):
        export_bag(path, kind, tmp_path / "out")
    assert [one.name for one in tmp_path.iterdir()] == ["topics.mcap"]


def cells_of(row: dict[str, str], name: str, value: Any) -> Any:
    """A field of a row, as the value that was written."""
    if isinstance(value, dict):
        return {key: float(row[f"{name}.{key}"]) for key in value}
    if isinstance(value, np.ndarray | tuple) and name in row:
        return json.loads(row[name])
    if isinstance(value, np.ndarray):
        places = [".".join([name, *map(str, one)]) for one in np.ndindex(value.shape)]
        return np.array([float(row[one]) for one in places]).reshape(value.shape).tolist()
    if isinstance(value, bool):
        return {"1": True, "0": False}[row[name]]
    if value is None:
        return None if row[name] == "" else row[name]
    return type(value)(row[name])


def plain(value: Any) -> Any:
    """Arrays and tuples as lists."""
    return value.tolist() if isinstance(value, np.ndarray) else json.loads(json.dumps(value))


def rows_of(path: Path) -> list[dict[str, str]]:
    csv.field_size_limit(1 << 24)
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def by_topic(messages):
    messages_of: dict[str, list[Any]] = {}
    for topic, message in messages:
        messages_of.setdefault(topic, []).append(message)
    return messages_of


def test_csv_holds_every_field_of_every_message(recorded, messages, tmp_path):
    export_bag(recorded, "csv", tmp_path / "out")
    known = by_topic(messages)
    times = [(topic, f"0.{7 * place:03}000000") for place, (topic, _) in enumerate(messages)]
    units = json.loads((tmp_path / "out" / "units.json").read_text())
    names = {topic: topic.strip("/").replace("/", "_") + ".csv" for topic in known}
    written = {names[topic] for topic in known if topic not in ("/truth", "/model/shape")}
    assert {field.name for field in (tmp_path / "out").glob("*.csv")} == units.keys() == written
    for topic in known.keys() - {"/truth", "/model/shape"}:
        sent = known[topic]
        rows = rows_of(tmp_path / "out" / names[topic])
        assert list(rows[0])[:2] == ["seq", "sent_s"]
        assert not hasattr(sent[0], "robot_time") or list(rows[0])[2] == "robot_time"
        assert [row["seq"] for row in rows] == [str(place) for place in range(len(sent))]
        assert [row["sent_s"] for row in rows] == [time for field, time in times if field == topic]
        for row, message in zip(rows, sent, strict=True):
            for field in fields(message):
                value = getattr(message, field.name)
                assert cells_of(row, field.name, value) == plain(value), (topic, field.name)
    rows = rows_of(tmp_path / "out" / "own.csv")
    assert (rows[0]["table.z"], rows[1]["table.x"]) == ("", "")
    wanted = {"sent_s": "s", "direction": "1", "pose": "m, 1", "array": "s or N"}
    assert units["touch_raw.csv"] == wanted | {"move": "s, m, rad, m, m", "robot_time": "s"}
    assert units["plan_done.csv"]["rms_bound_95"] == "m"


def test_csv_spreads_arrays_of_one_shape_over_columns(explored, record, tmp_path):
    export_bag(explored, "csv", tmp_path / "out")
    frames = rows_of(tmp_path / "out" / "touch_raw.csv")[0]
    assert "array.1.2" in frames and "array" not in frames and "array.2.0" not in frames
    assert "points" in rows_of(tmp_path / "out" / "contour_traced.csv")[0]  # shapes vary
    large = frame(0, array=np.arange(65.0 * 65.0).reshape(65, 65))  # too many columns
    path = record([("/touch/raw", large)], name="large.mcap")
    export_bag(path, "csv", tmp_path / "large")
    (row,) = rows_of(tmp_path / "large" / "touch_raw.csv")
    assert json.loads(row["array"]) == large.array.tolist() and "pose.6" in row


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{}", "/own holds Own: this is no schema of a message type"),
        (json.dumps(schema(type(WORLD))), "/own was recorded with another version of Own"),
    ],
)
def test_schema_of_another_type_is_refused(record, tmp_path, text, words):
    with pytest.raises(InputError, match=words):
        export_bag(record([("/own", OWN[0])], schemas={"Own": text}), "csv", tmp_path / "out")


def check_arrays(arrays, stem: str, name: str, values: list[Any]) -> None:
    """One field of all messages of a topic, against the arrays that hold it."""
    key = f"{stem}.{name}"
    if isinstance(values[0], dict):
        for part in {part for value in values for part in value}:
            wanted = [value.get(part, np.nan) for value in values]
            np.testing.assert_array_equal(arrays[f"{key}.{part}"], wanted)
    elif f"{key}.shapes" in arrays:
        shapes = arrays[f"{key}.shapes"]
        ends = np.cumsum(shapes.prod(axis=1))[:-1]
        for part, shape, value in zip(np.split(arrays[key], ends), shapes, values, strict=True):
            np.testing.assert_array_equal(part.reshape(shape), value)
    elif f"{key}.lengths" in arrays:
        lengths = arrays[f"{key}.lengths"]
        assert lengths.tolist() == [len(value) for value in values]
        for part, value in zip(np.split(arrays[key], np.cumsum(lengths)[:-1]), values, strict=True):
            assert plain(part) == plain(value)
    else:
        array = arrays[key]
        if isinstance(values[0], np.ndarray):
            assert array.dtype == values[0].dtype
        if any(value is None for value in values):
            np.testing.assert_array_equal(array, np.array(values, float))
        else:
            assert plain(array) == [plain(value) for value in values]


def test_npz_holds_every_field_of_every_message(recorded, messages, record, tmp_path):
    text = export_bag(recorded, "npz", tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as file:
        arrays = dict(file)
    assert f": {len(arrays)} arrays of" in text
    for topic, sent in by_topic(messages).items():
        stem = topic.strip("/").replace("/", "_")
        assert arrays[f"{stem}.seq"].tolist() == [*range(len(sent))]
        for field in fields(sent[0]):
            check_arrays(arrays, stem, field.name, [getattr(each, field.name) for each in sent])
    assert arrays["model_shape.sent_s"] == pytest.approx([0.077, 0.091], abs=1e-12)
    kinds = {name: arrays[f"touch_patch.{name}"].dtype.str for name in ("mask", "umbilic", "goal")}
    assert kinds == {"mask": "|b1", "umbilic": "|b1", "goal": "<i8"}
    assert arrays["touch_raw.outcome"].dtype == "<U3"
    export_bag(recorded, "npz", tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()

    # Times count from the first message of the recording, exported or not.
    path = record([("/a", WORLD), ("/b", WORLD)], name="two.mcap")
    export_bag(path, "npz", tmp_path / "out.npz", ["/b"])
    with np.load(tmp_path / "out.npz") as arrays:
        assert arrays["b.sent_s"] == pytest.approx([0.007])
        assert not any(name.startswith("a.") for name in arrays)


def test_meshes_are_written_as_ply(explored, tmp_path, tetrahedron):
    export_bag(explored, "ply", tmp_path / "meshes")
    names = sorted(one.name for one in (tmp_path / "meshes").iterdir())
    assert names == ["model_shape.0.ply", "truth.0.ply"]  # the second model has no triangles
    vertices, faces, _ = read_mesh(tmp_path / "meshes" / "model_shape.0.ply", "m")
    assert np.allclose(np.sort(vertices, axis=0), np.sort(tetrahedron.vertices, axis=0))
    assert len(faces) == len(tetrahedron.faces)


def test_files_of_topics_have_harmless_different_names(record, tmp_path):
    topics = ["/touch/raw", "/touch_raw", "/../../etc/passwd", "/", "/" + "x" * 120]
    export_bag(record([(one, log(0.0)) for one in topics]), "csv", tmp_path / "out")
    stems = ["touch_raw", "touch_raw_2", "______etc_passwd", "_", "x" * 100]
    assert {one.stem for one in (tmp_path / "out").glob("*.csv")} == {*stems}


def test_unsuitable_topics_and_recordings_are_refused(record, tmp_path, explored):
    out = tmp_path / "out"
    for kind, topic, words in (
        ("csv", "/truth", "/truth are meshes: take --format ply"),
        ("ply", "/score", "/score are no meshes, so"),
        ("npz", "/scroe", "has no topic '/scroe'; did you mean '/score'"),
    ):
        with pytest.raises(InputError, match=words):
            export_bag(explored, kind, out, [topic])
    assert [one.name for one in tmp_path.iterdir()] == ["topics.mcap"]
    explored.write_bytes(explored.read_bytes()[:-30])
    with pytest.raises(InputError, match=r"cut off at byte \d+; `palpate bag recover` saves its"):
        export_bag(explored, "csv", out)
    with pytest.raises(InputError, match="holds no message"):
        export_bag(record([], name="empty.mcap"), "csv", out)
    with pytest.raises(InputError, match=r"/world was recorded with another version of World"):
        export_bag(record([("/world", WORLD)], name="old.mcap", schema=7), "npz", out)
    path = record([("/world", WORLD)] * 3, name="open.mcap", closed=False)
    assert "never closed" in export_bag(path, "npz", out)


def test_topics_are_given_between_commas_or_one_by_one(explored, tmp_path, call):
    for number, topics in enumerate((["/score,/log"], ["/score", "/log"], [" /score, /log,"])):
        words, out = [("--topics", topic) for topic in topics], tmp_path / str(number)
        assert call("bag export", explored, "--format", "csv", "-o", out, *sum(words, ())).code == 0
        assert {one.name for one in out.iterdir()} == {"score.csv", "log.csv", "units.json"}


def patch_of(k1: float) -> tuple[str, Any]:
    return "/touch/patch", example(SurfacePatch, k1=k1, pose=np.arange(7.0), mask=np.eye(4) > 0)


def test_topic_is_a_table_with_a_row_for_each_message(record):
    messages = [patch_of(1.0), ("/log", log(0.5, "hi")), patch_of(2)]
    recording = palpate.open_recording(record(messages))
    assert list(recording) == ["/log", "/touch/patch"] and len(recording) == 2
    table = recording["/touch/patch"]
    assert table["seq"].tolist() == [0, 1]
    assert table["sent_s"] == pytest.approx([0.0, 0.014])
    assert table["k1"].tolist() == [1.0, 2.0]
    assert table["pose"].shape == (2, 7) and table["mask"].dtype == bool
    assert recording["/log"]["text"].tolist() == ["hi"]
    assert recording["/log"].dtype.names[:3] == ("seq", "sent_s", "robot_time")
    assert recording.units("/touch/patch")["k1"] == "1/m"
    assert recording.units("/touch/patch")["sent_s"] == "s"
    assert repr(recording).endswith("/log 1, /touch/patch 2>")
    data = recording.frame("/touch/patch")
    assert isinstance(data, pd.DataFrame) and len(data) == 2
    assert data["pose.3"].tolist() == [3.0, 3.0] and data["mask.1.1"].all()


def test_tables_hold_own_types_and_missing_numbers(recorded, record):
    table = palpate.open_recording(recorded)["/own"]
    assert table["force"].tolist() == [1.0, 2.5]
    assert [one.shape for one in table["places"]] == [(2, 3), (5, 3)]
    assert table["name"].tolist() == ["a", "longer"]
    bounds = [("/plan/done", example(PlanDone, rms_bound_95=one)) for one in (1e-4, None)]
    done = palpate.open_recording(record(bounds, name="done.mcap"))["/plan/done"]
    np.testing.assert_array_equal(done["rms_bound_95"], [1e-4, np.nan])


def test_tables_refuse_unknown_topics_files_and_missing_pandas(record, tmp_path, monkeypatch):
    recording = palpate.open_recording(record([patch_of(1.0)]))
    assert "/touch/path" not in recording
    with pytest.raises(InputError, match="has no topic '/touch/path'; did you mean '/touch/patch'"):
        recording["/touch/path"]
    with pytest.raises(InputError, match=r"none.mcap"):
        palpate.open_recording(tmp_path / "none.mcap")
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(InputError, match="frames need pandas: pip install pandas"):
        recording.frame("/touch/patch")


def test_reprs_of_recording_and_tables_are_short(run_folder):
    recording = palpate.open_recording(run_folder)
    shown = [recording, *recording.values(), *(table[:1] for table in recording.values())]
    shown += [table[name] for table in recording.values() for name in table.dtype.names]
    for text in shown:
        assert repr(text).count("\n") < 9 and len(repr(text)) < 1000
