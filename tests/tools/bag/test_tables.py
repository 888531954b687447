"""Topics of a recording as structured arrays and as frames."""

import json
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import pandas as pd
import pytest

import palpate
from palpate.launch.files.source_map import InputError
from palpate.messages.codec import Header, encode, schema, schema_hash
from palpate.messages.fields import Array, Floats, Unit
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types import PlanDone, SurfacePatch
from palpate.messages.types.catalogue import LogRecord
from palpate.nodes.runtime.testing import example


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Own:
    force: Annotated[float, Unit("N")]
    places: Annotated[Floats, Array("<f8", (None, 3), "m")]
    name: str


def patch(k1):
    return "/touch/patch", example(SurfacePatch, k1=k1, pose=np.arange(7.0), mask=np.eye(4) > 0)


def test_a_topic_is_a_table_with_a_row_for_each_message(record):
    log = "/log", LogRecord(node="me", level="info", text="hello", robot_time=0.5)
    recording = palpate.open_recording(record([patch(1.0), log, patch(2.0)]))
    assert list(recording) == ["/log", "/touch/patch"] and len(recording) == 2
    table = recording["/touch/patch"]
    assert table["seq"].tolist() == [0, 1]
    assert table["sent_s"] == pytest.approx([0.0, 0.014])
    assert table["k1"].tolist() == [1.0, 2.0]
    assert table["pose"].shape == (2, 7) and table["mask"].dtype == bool
    assert recording["/log"]["text"].tolist() == ["hello"]
    assert recording["/log"].dtype.names[:3] == ("seq", "sent_s", "robot_time")
    assert recording.units("/touch/patch")["k1"] == "1/m"
    assert repr(recording).endswith("/log 1, /touch/patch 2>")


def test_a_type_of_ones_own_is_read_by_its_schema_whatever_its_shapes(tmp_path):
    path, text = tmp_path / "topics.mcap", json.dumps(schema(Own))
    writer = RecordingWriter(path, {"/own": "Own"}, {}, {}, schemas={"Own": text})
    for seq, (force, count, name) in enumerate([(1.0, 2, "a"), (2.0, 5, "longer")]):
        message = Own(force=force, places=np.full((count, 3), force), name=name)
        writer.write("/own", Header(0, 0, seq, 0, 0.0, schema_hash(Own)), encode(message))
    writer.close()
    table = palpate.open_recording(path)["/own"]
    assert table["force"].tolist() == [1.0, 2.0]
    assert [one.shape for one in table["places"]] == [(2, 3), (5, 3)]
    assert table["name"].tolist() == ["a", "longer"]


def test_a_number_that_is_missing_is_nan(record):
    known = example(PlanDone, rms_bound_95=1e-4)
    messages = [("/plan/done", known), ("/plan/done", example(PlanDone, rms_bound_95=None))]
    bounds = palpate.open_recording(record(messages))["/plan/done"]["rms_bound_95"]
    assert bounds[0] == 1e-4 and np.isnan(bounds[1])


def test_a_frame_has_a_column_for_each_element(record):
    frame = palpate.open_recording(record([patch(1.0), patch(2.0)])).frame("/touch/patch")
    assert isinstance(frame, pd.DataFrame) and len(frame) == 2
    assert frame["pose.3"].tolist() == [3.0, 3.0] and frame["mask.1.1"].all()


def test_without_pandas_one_sentence_says_what_to_install(record, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(InputError, match="frames need pandas: pip install pandas"):
        palpate.open_recording(record([patch(1.0)])).frame("/touch/patch")


def test_an_unknown_topic_and_an_unknown_file_are_one_sentence(record, tmp_path):
    recording = palpate.open_recording(record([patch(1.0)]))
    assert "/touch/path" not in recording
    with pytest.raises(InputError, match="has no topic '/touch/path'; did you mean '/touch/patch'"):
        recording["/touch/path"]
    with pytest.raises(InputError, match=r"none.mcap"):
        palpate.open_recording(tmp_path / "none.mcap")


def test_reprs_of_a_recording_and_its_tables_are_short(run_folder):
    recording = palpate.open_recording(run_folder)
    assert is_short(recording)
    for topic, table in recording.items():
        assert is_short(table), topic
        assert all(is_short(table[name]) for name in table.dtype.names), topic
        assert is_short(table[:1])


def is_short(value):
    return repr(value).count("\n") < 9 and len(repr(value)) < 1000
