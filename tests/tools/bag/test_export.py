import csv
import errno
import json
import os
import re
from dataclasses import dataclass

import numpy as np
import pytest

from palpate.launch.files import file_access as new_file
from palpate.launch.files.file_access import write_new
from palpate.launch.files.mesh_file import read_mesh
from palpate.launch.files.source_map import InputError
from palpate.messages.codec import Header, encode, schema, schema_hash
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types.world import World
from palpate.tools.bag.decoding import file_stems, open_decoded
from palpate.tools.bag.export import export_bag, write_csv, write_npz
from palpate.tools.cli import command_line as cli

WORLD = World(platform=0.0, reach=0.3, fingers=1, seed=3)
EVERY = pytest.mark.parametrize("kind", ["csv", "ply", "npz", "foxglove"])


COUNTS = {
    "csv": "8 files of 7 topics",
    "ply": "2 meshes of 2 topics",
    "npz": r"\d+ arrays of 9 topics",
    "foxglove": r"\d+ messages of 9 topics",
}
LEFT_OUT = "left to --format ply, as meshes: /model/shape, /truth\n"


@dataclass(frozen=True)
class Strange:
    value: float


@EVERY
def test_each_format_is_written_whole_and_reported(explored, tmp_path, kind, capsys):
    out = tmp_path / "out"
    assert cli.run(["bag", "export", str(explored), "--format", kind, "-o", str(out)]) == 0
    assert re.fullmatch(rf"{out}: {COUNTS[kind]}\n", capsys.readouterr().out.replace(LEFT_OUT, ""))
    assert sorted(one.name for one in tmp_path.iterdir()) == ["out", "topics.mcap"]


@EVERY
def test_nothing_is_overwritten(explored, tmp_path, kind):
    (tmp_path / "out").mkdir()
    (tmp_path / "file").write_text("mine")
    for name in ("out", "file"):
        with pytest.raises(InputError, match=f"{name}: exists already; it is not overwritten"):
            export_bag(explored, kind, tmp_path / name)
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("kind", ["csv", "npz", "foxglove"])
def test_a_message_that_cannot_be_decoded_leaves_nothing_behind(record, tmp_path, kind):
    path = tmp_path / "topics.mcap"
    writer = RecordingWriter(path, {"/world": "World"}, {}, {})
    for seq, body in enumerate([encode(WORLD), b"\x80"]):
        writer.write("/world", Header(0, 0, seq, 0, 0.0, schema_hash(World)), body)
    writer.close()
    with pytest.raises(
        InputError, match=r"topics.mcap: /world 1: not a World: missing field platform"
    ):
        export_bag(path, kind, tmp_path / "out")
    assert [one.name for one in tmp_path.iterdir()] == ["topics.mcap"]


def test_another_version_of_a_message_is_refused(tmp_path):
    path = tmp_path / "topics.mcap"
    writer = RecordingWriter(path, {"/world": "World"}, {}, {})
    writer.write("/world", Header(0, 0, 0, 0, 0.0, 7), encode(WORLD))
    writer.close()
    with pytest.raises(InputError, match=r"/world was recorded with another version of World"):
        export_bag(path, "npz", tmp_path / "out")


def strange(path, text):
    """A recording of a type that nobody has, with this text as its schema."""
    writer = RecordingWriter(path, {"/a": "Strange"}, {}, {}, schemas={"Strange": text})
    for seq, value in enumerate([1.0, 2.5]):
        writer.write("/a", Header(0, 0, seq, 0, 0.0, schema_hash(Strange)), encode(Strange(value)))
    writer.close()
    return path


def test_a_type_that_nobody_has_is_read_by_the_schema_that_was_recorded(tmp_path):
    path = strange(tmp_path / "topics.mcap", json.dumps(schema(Strange)))
    export_bag(path, "csv", tmp_path / "out")
    assert (tmp_path / "out" / "a.csv").read_text().splitlines()[1:] == [
        "0,0.000000000,1.0",
        "1,0.000000000,2.5",
    ]
    export_bag(path, "npz", tmp_path / "out.npz")
    assert np.load(tmp_path / "out.npz")["a.value"].tolist() == [1.0, 2.5]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{}", "/a holds Strange: this is no schema of a message type"),
        (json.dumps(schema(World)), "/a was recorded with another version of Strange"),
    ],
)
def test_a_schema_that_is_not_that_of_the_messages_is_refused(tmp_path, text, words):
    path = strange(tmp_path / "topics.mcap", text)
    with pytest.raises(InputError, match=words):
        export_bag(path, "csv", tmp_path / "out")


def test_a_damaged_recording_is_to_be_recovered_first(explored, tmp_path):
    explored.write_bytes(explored.read_bytes()[:-30])
    with pytest.raises(InputError, match=r"cut off at byte \d+; `palpate bag recover` saves what"):
        export_bag(explored, "csv", tmp_path / "out")


def test_a_recording_that_was_never_closed_is_exported_and_reported_to_be(record, tmp_path):
    path = record([("/world", WORLD)] * 3, close=False)
    assert "never closed" in export_bag(path, "npz", tmp_path / "out.npz")


def test_unknown_topics_and_empty_recordings_are_refused(record, tmp_path):
    with pytest.raises(InputError, match="has no topic '/wrold'; did you mean '/world'"):
        open_decoded(record([("/world", WORLD)]), ["/wrold"])
    with pytest.raises(InputError, match="holds no message"):
        open_decoded(record([], name="empty.mcap"))


def test_times_count_from_the_first_message_of_all(record, tmp_path):
    path = record([("/a", WORLD), ("/b", WORLD)])
    export_bag(path, "npz", tmp_path / "out.npz", ["/b"])
    with np.load(tmp_path / "out.npz") as found:
        assert found["b.sent_s"] == pytest.approx([0.007])


@pytest.mark.parametrize("number", [errno.EPERM, errno.EEXIST, errno.ENOSPC])
def test_a_file_is_moved_though_there_are_no_links_but_never_onto_another(
    tmp_path, monkeypatch, number
):
    def link(source, target):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(new_file.os, "link", link)
    path = tmp_path / "a"
    if number == errno.EPERM:
        write_new(path, lambda part: part.write_text("whole"))
        assert path.read_text() == "whole"
    else:
        with pytest.raises(InputError, match=r"not overwritten|cannot be written: No space"):
            write_new(path, lambda part: part.write_text("whole"))
    assert len(list(tmp_path.iterdir())) == (number == errno.EPERM)


def test_what_came_meanwhile_is_not_overwritten(tmp_path):
    path = tmp_path / "a"

    def slow(part):
        part.mkdir()
        path.write_text("mine")

    with pytest.raises(InputError, match="a: exists already"):
        write_new(path, slow)
    assert path.read_text() == "mine"
    assert [one.name for one in tmp_path.iterdir()] == ["a"]


@pytest.fixture
def folder(explored, tmp_path):
    write_csv(open_decoded(explored), tmp_path / "tables")
    return tmp_path / "tables"


def rows(path):
    csv.field_size_limit(1 << 24)
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_each_topic_has_a_table_with_a_row_for_each_message(folder):
    names = {path.name: len(rows(path)) for path in folder.glob("*.csv")}
    assert names == {
        "contour_traced.csv": 2,
        "log.csv": 1,
        "model_shape.csv": 2,
        "plan_done.csv": 1,
        "score.csv": 1,
        "touch_info.csv": 1,
        "touch_patch.csv": 1,
        "touch_raw.csv": 3,
        "truth.csv": 1,
    }


def test_a_row_begins_with_number_and_times(folder):
    found = rows(folder / "touch_raw.csv")
    assert list(found[0])[:4] == ["seq", "sent_s", "robot_time", "goal"]
    assert [row["seq"] for row in found] == ["0", "1", "2"]
    # The first message of the recording was the truth, the second the sensor: 7 ms apart.
    assert [row["sent_s"] for row in found] == ["0.014000000", "0.021000000", "0.028000000"]
    assert [float(row["robot_time"]) for row in found] == [0.0, 0.5, 1.0]


def test_an_array_of_one_shape_has_a_column_for_each_element(folder):
    row = rows(folder / "touch_raw.csv")[1]
    assert [float(row[f"pose.{i}"]) for i in range(7)] == [0.011, 0.02, 0.03, 0, 0, 0, 1]
    values = [float(row[f"array.{i}.{j}"]) for i in range(2) for j in range(3)]
    assert values == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert "array" not in row and "array.2.0" not in row


def test_an_array_whose_shape_varies_and_a_list_are_json(folder):
    one, other = rows(folder / "contour_traced.csv")
    assert json.loads(one["points"]) == [[0.0, 0.0, 0.0]]
    assert json.loads(other["points"]) == [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0], [6.0, 7.0, 8.0]]
    assert (one["gap_reasons"], other["gap_reasons"]) == ("[]", '["missed"]')
    assert json.loads(rows(folder / "model_shape.csv")[1]["dropped_reasons"])[1] == 'Lücke, "offen"'


def test_a_table_has_a_column_for_each_name_that_occurs(folder):
    one, other = rows(folder / "model_shape.csv")
    names = ("health.condition", "health.fallbacks", "health.folds")
    assert [one[name] for name in names] == ["3.5", "0.0", ""]
    assert [other[name] for name in names] == ["1.5", "", "2.0"]


def test_truth_is_one_nothing_is_empty_and_texts_are_whole(folder):
    (done,) = rows(folder / "plan_done.csv")
    (patch,) = rows(folder / "touch_patch.csv")
    (log,) = rows(folder / "log.csv")
    assert (done["reached"], done["rms_bound_95"]) == ("1", "")
    assert done["reason"] == "within, all of it"
    assert [patch[f"mask.0.{j}"] for j in range(3)] == ["0", "1", "1"]
    assert patch["umbilic"] == "0"
    assert log["text"] == "a, b\n=c"


def test_an_array_too_large_for_columns_is_json(explored, tmp_path, monkeypatch):
    monkeypatch.setattr("palpate.tools.bag.export.MAX_COLUMNS", 6)
    write_csv(open_decoded(explored, ["/touch/raw"]), tmp_path / "tables")
    row = rows(tmp_path / "tables" / "touch_raw.csv")[0]
    assert json.loads(row["pose"])[:3] == [0.01, 0.02, 0.03]
    assert float(row["array.1.2"]) == 5.0


def test_the_units_lie_beside_the_tables(folder):
    units = json.loads((folder / "units.json").read_text())
    assert units["touch_raw.csv"] == {
        "sent_s": "s",
        "direction": "1",
        "pose": "m, 1",
        "array": "s or N",
        "move": "s, m, rad, m, m",
        "robot_time": "s",
    }
    assert units["plan_done.csv"]["rms_bound_95"] == "m"
    assert units.keys() == {path.name for path in folder.glob("*.csv")}


def test_topics_that_are_not_wanted_are_left_out(explored, tmp_path):
    assert write_csv(open_decoded(explored, ["/score", "/log"]), tmp_path / "tables") == 3
    written = sorted(os.listdir(tmp_path / "tables"))
    assert written == ["log.csv", "score.csv", "units.json"]
    assert rows(tmp_path / "tables" / "score.csv")[0]["sent_s"] == "0.070000000"


def test_meshes_are_left_to_ply_and_it_is_told_how(explored, tmp_path, tetrahedron):
    assert LEFT_OUT.rstrip() in export_bag(explored, "csv", tmp_path / "tables")
    assert not {"model_shape.csv", "truth.csv"} & set(os.listdir(tmp_path / "tables"))
    export_bag(explored, "ply", tmp_path / "meshes")
    # The second model has no triangles.
    assert sorted(os.listdir(tmp_path / "meshes")) == ["model_shape.0.ply", "truth.0.ply"]
    vertices, faces, _ = read_mesh(tmp_path / "meshes" / "model_shape.0.ply", "m")
    assert np.allclose(np.sort(vertices, axis=0), np.sort(tetrahedron.vertices, axis=0))
    assert len(faces) == len(tetrahedron.faces)


@pytest.mark.parametrize(
    ("kind", "topic", "why"),
    [("csv", "/truth", "are meshes: take --format ply"), ("ply", "/score", "are no meshes, so")],
)
def test_a_format_for_which_nothing_is_left_is_refused(explored, tmp_path, kind, topic, why):
    with pytest.raises(InputError, match=f"{topic} {why}"):
        export_bag(explored, kind, tmp_path / "out", [topic])
    assert os.listdir(tmp_path) == ["topics.mcap"]


def test_names_of_files_are_harmless_and_differ():
    topics = ["/touch/raw", "/touch_raw", "/../../etc/passwd", "/", "/" + "x" * 300]
    found = file_stems(topics)
    assert list(found.values()) == ["touch_raw", "touch_raw_2", "______etc_passwd", "_", "x" * 100]


@pytest.fixture
def arrays(explored, tmp_path):
    count = write_npz(open_decoded(explored), tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz", allow_pickle=False) as file:
        found = dict(file)
    assert len(found) == count
    return found


def test_fields_become_arrays_with_the_messages_first(arrays):
    assert arrays["touch_raw.array"].shape == (3, 2, 3)
    assert arrays["touch_raw.array"][2].tolist() == [[2.0, 3.0, 4.0], [5.0, 6.0, 7.0]]
    assert arrays["touch_raw.pose"][:, 0] == pytest.approx([0.01, 0.011, 0.012])
    assert arrays["touch_raw.seq"].tolist() == [0, 1, 2]
    assert arrays["touch_raw.sent_s"] == pytest.approx([0.014, 0.021, 0.028], abs=1e-12)
    assert arrays["touch_raw.robot_time"].tolist() == [0.0, 0.5, 1.0]


def test_kinds_of_numbers_are_kept(arrays):
    kinds = {name: arrays[f"touch_patch.{name}"].dtype.str for name in ("mask", "umbilic", "goal")}
    assert kinds == {"mask": "|b1", "umbilic": "|b1", "goal": "<i8"}
    assert arrays["truth.faces"].dtype == np.int32
    assert arrays["truth.faces"].shape == (1, 4, 3)


def test_texts_are_unicode_of_one_width(arrays):
    assert arrays["log.text"].tolist() == ["a, b\n=c"]
    assert arrays["touch_raw.outcome"].dtype == "<U3"


def test_messages_of_several_lengths_are_joined(arrays):
    assert arrays["contour_traced.points"].shape == (4, 3)
    assert arrays["contour_traced.points.lengths"].tolist() == [1, 3]
    assert arrays["contour_traced.points"][1:].tolist() == np.arange(9.0).reshape(3, 3).tolist()
    assert arrays["contour_traced.gap_reasons"].tolist() == ["missed"]
    assert arrays["contour_traced.gap_reasons.lengths"].tolist() == [0, 1]


def test_arrays_that_differ_in_other_axes_are_flattened(arrays, tetrahedron):
    flat, shapes = arrays["model_shape.control"], arrays["model_shape.control.shapes"]
    assert shapes.tolist() == [[4, 4, 4, 3], [4, 4, 5, 3]]
    first, second = np.split(flat, np.cumsum(shapes.prod(axis=1))[:-1])
    assert np.array_equal(first.reshape(shapes[0]), tetrahedron.control)
    assert second.size == shapes[1].prod()


def test_lists_of_one_length_are_stacked(arrays):
    assert arrays["model_shape.contours"].tolist() == [[0, 1], [0, 1]]
    assert arrays["model_shape.probes"].shape == (2, 0)
    assert arrays["model_shape.probes"].dtype == np.int64


def test_tables_have_an_array_for_each_name_and_nan_where_it_is_missing(arrays):
    assert arrays["model_shape.health.condition"].tolist() == [3.5, 1.5]
    assert np.isnan(arrays["model_shape.health.folds"]).tolist() == [True, False]
    assert np.isnan(arrays["plan_done.rms_bound_95"]).all()


def test_the_same_recording_gives_the_same_file(explored, tmp_path):
    paths = tmp_path / "a.npz", tmp_path / "b.npz"
    for path in paths:
        write_npz(open_decoded(explored, ["/touch/raw"]), path)
    assert paths[0].read_bytes() == paths[1].read_bytes()
