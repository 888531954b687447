"""Messages published now beside those recorded: what has changed, field by field."""

import json
from dataclasses import replace

import msgpack
import numpy as np
import pytest

from palpate.core.poses import IDENTITY_POSE
from palpate.messages import encode, schema_hash
from palpate.messages.types import LogRecord, PlanDone, TactileImage
from palpate.nodes.runtime.node import Node
from palpate.nodes.runtime.testing import example
from palpate.tools.replay.rerun import replay
from tests.tools.recordings import frame, log, write_recording

from .conftest import NoParams, describe, wiring


@pytest.fixture
def compare(tmp_path, module):
    """Replays a node that publishes messages now where others were recorded."""

    def do(then, now, *, as_json=True):
        kind = type(now[0])
        node = Node(
            params=NoParams,
            start=lambda params: (0, []),
            inputs={"/in": (LogRecord, lambda params, k, _: (k + 1, [("/out", now[k])]))},
            outputs={"/out": kind},
        )
        module("speaker", node)
        speaker = wiring("speaker", "speaker", NoParams(), [("s", "/in", "LogRecord")], out="/out")
        pairs = [[("/in", log(0.0)), ("/out", one)] for one in then]
        messages = [one for pair in pairs for one in pair]
        types = {"/in": "LogRecord", "/out": kind.__name__}
        hashes = {"/in": schema_hash(LogRecord), "/out": schema_hash(kind)}
        path = tmp_path / "topics.mcap"
        write_recording(path, messages, types=types, about=describe(speaker), hashes=hashes)
        lines: list[str] = []
        replay(path, ["speaker"], lines.append, as_json=as_json)
        if not as_json:
            return lines
        return json.loads(lines[0])["nodes"]["speaker"]["topics"]["/out"]["fields"]

    return do


@pytest.fixture
def changed(compare):
    """The fields that change if these of one message have."""
    return lambda message, **fields: compare([message], [replace(message, **fields)])


IMAGE = example(TactileImage, compression=np.zeros((2, 2)), mask=np.zeros((2, 2), np.bool_),
                pose=IDENTITY_POSE, robot_time=1.0)  # fmt: skip
DONE = example(PlanDone, contours=(1, 2), reached=True, rms_bound_95=1e-3)


def note(count, then, now):
    return {"count": count, "then": then, "now": now}


def test_numbers_are_measured_in_their_unit(changed):
    found = changed(IMAGE, compression=np.array([[0.0, 3e-5], [0.0, -4e-5]]), impulses=2)
    assert list(found) == ["compression", "impulses"]
    assert found["compression"] == {
        "unit": "m", "differ": 1, "first": 0, "largest": 4e-5, "notes": {},
        "rms": pytest.approx(2.5e-5, rel=1e-12),
    }  # fmt: skip
    assert [found["impulses"][key] for key in ("unit", "largest", "rms")] == ["#", 2.0, 2.0]


def test_several_messages_add_up_to_one_change(compare):
    now = [replace(IMAGE, robot_time=time) for time in (1.0, 4.0, 1.0, -3.0)]
    found = compare([IMAGE] * 4, now)["robot_time"]
    assert (found["differ"], found["first"], found["largest"]) == (2, 1, 4.0)
    assert found["rms"] == pytest.approx(np.sqrt((9 + 16) / 2), rel=1e-12)


def test_parts_with_units_of_their_own_are_kept_apart(changed):
    touched = frame(0, pose=IDENTITY_POSE, move=np.zeros(5))
    pose = IDENTITY_POSE + np.array([0, 0, 0.1, 0, 0.2, 0, 0])
    found = changed(touched, pose=pose, move=np.array([1.0, 0, 2.0, 3.0, 4.0]))
    assert {name: (one["unit"], one["largest"]) for name, one in found.items()} == {
        "pose[0:3]": ("m", 0.1),
        "pose[3:7]": ("1", 0.2),
        "move[0]": ("s", 1.0),
        "move[2]": ("rad", 2.0),
        "move[3:5]": ("m", 4.0),
    }


@pytest.mark.parametrize(
    ("message", "field", "value", "notes"),
    [
        (IMAGE, "mask", np.array([[False, True], [True, True]]),
         {"element": note(3, "False", "True")}),
        (IMAGE, "outcome", "miss", {"value": note(1, "'hit'", "'miss'")}),
        (IMAGE, "compression", np.zeros((2, 3)), {"shape": note(1, "(2, 2)", "(2, 3)")}),
        (DONE, "contours", (1, 3), {"value": note(1, "(1, 2)", "(1, 3)")}),
        (DONE, "reached", False, {"value": note(1, "True", "False")}),
        (DONE, "rms_bound_95", None, {"value": note(1, "0.001", "None")}),
    ],
)  # fmt: skip
def test_changes_without_a_size_are_counted(changed, message, field, value, notes):
    found = changed(message, **{field: value})
    assert found == {field: {"unit": "", "first": 0, "differ": 1, "largest": None, "rms": None,
                             "notes": notes}}  # fmt: skip


def test_first_of_many_changes_is_shown(compare):
    then = [replace(DONE, rms_bound_95=one) for one in (None, None, 0.5, 0.5)]
    now = [replace(DONE, rms_bound_95=one, number=2) for one in (0.5, None, None, 0.25)]
    bound = compare(then, now)["rms_bound_95"]
    assert bound["notes"] == {"value": note(2, "None", "0.5")}
    found = [bound[key] for key in ("differ", "first", "largest", "unit")]
    assert found == [3, 0, 0.25, "m"]


def test_tables_are_compared_by_their_keys(changed, tetrahedron):
    found = changed(tetrahedron, health={"condition": 4.0, "folds": 0.0})
    assert list(found) == ["health", "health['condition']"]
    assert found["health"]["notes"] == {"keys": note(1, "['fallbacks']", "['folds']")}
    assert found["health['condition']"]["largest"] == 0.5


def test_extreme_numbers_are_measured(compare, changed):
    found = changed(IMAGE, compression=-IMAGE.compression)  # zeros that change their sign
    assert (found["compression"]["differ"], found["compression"]["largest"]) == (1, 0.0)
    far = replace(IMAGE, compression=np.full((2, 2), 1e308))
    opposite = replace(far, compression=-far.compression)
    assert compare([far], [opposite])["compression"]["largest"] is None
    assert " inf  inf  m" in compare([far], [opposite], as_json=False)[-1]


def test_bodies_that_differ_in_their_bytes_alone_are_counted(compare):
    body = encode(IMAGE)
    turned = msgpack.packb(dict(reversed(msgpack.unpackb(body).items())))
    assert compare([turned], [IMAGE])["bytes"]["notes"]["byte"]["count"] == 1
    found = compare([b"\x80"], [IMAGE])["bytes"]["notes"]["byte"]
    assert found["then"] == "1 bytes"
    assert found["now"].startswith("not a TactileImage: missing field goal")


def test_table_shows_sizes_units_and_notes(compare):
    shape = replace(IMAGE, compression=np.zeros((2, 3)))
    moved = replace(IMAGE, compression=IMAGE.compression + 0.5)
    now = [replace(shape, outcome="miss"), moved, replace(IMAGE, impulses=2)]
    _, *rows = compare([IMAGE, IMAGE, IMAGE], now, as_json=False)
    assert " ".join(" ".join(rows).split()) == (
        "topic field compared differ first largest rms unit "
        "/out outcome 3 1 0 1 changed, first 'hit' -> 'miss' "
        "/out compression 3 2 0 0.5 0.5 m 1 of another shape, first (2, 2) -> (2, 3) "
        "/out impulses 3 1 2 2 2 count"
    )
