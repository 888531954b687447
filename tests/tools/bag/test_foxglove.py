import base64
import json
from collections import defaultdict
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from palpate.core.touch.pad import Pad
from palpate.messages.types.world import Truth
from palpate.nodes.specs.sensors import pad_of_info
from palpate.tools.bag.decoding import open_decoded
from palpate.tools.exporters.foxglove import write_foxglove

# By topic: name of the schema, the schema, the message, and its time.
Found = dict[str, list[tuple[str, dict[str, Any], dict[str, Any], int]]]


def read(path):
    found: Found = defaultdict(list)
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            assert message.log_time == message.publish_time
            found[channel.topic].append(
                (schema.name, json.loads(schema.data), json.loads(message.data), message.log_time)
            )
    return found


def export(bag, topics=()):
    path = bag.with_name("foxglove.mcap")
    count = write_foxglove(open_decoded(bag, topics), path)
    found = read(path)
    assert sum(map(len, found.values())) == count
    return found


@pytest.fixture
def found(explored):
    return export(explored)


KINDS: dict[str, Any] = {
    "object": dict,
    "array": list,
    "string": str,
    "boolean": bool,
    "integer": int,
    "number": (int, float),
    "null": type(None),
}


def faults(value, schema, place=""):
    """Where a value does not follow a JSON schema, in the words of one that are used here."""
    if "anyOf" in schema:
        return min((faults(value, one, place) for one in schema["anyOf"]), key=len)
    if "oneOf" in schema:
        known = [one["const"] for one in schema["oneOf"]]
        return [] if value in known else [f"{place}: {value} is none of {known}"]
    if "enum" in schema:
        return [] if value in schema["enum"] else [f"{place}: {value!r}"]
    kind = schema["type"]
    if not isinstance(value, KINDS[kind]) or (kind != "boolean" and isinstance(value, bool)):
        return [f"{place}: {value!r:.40} is no {kind}"]
    found = []
    if kind == "object":
        found += [
            f"{place}: lacks {name}" for name in schema.get("required", ()) if name not in value
        ]
        known = schema.get("properties", {})
        if schema.get("additionalProperties") is False or "title" in schema:
            found += [f"{place}: has {name}" for name in value if name not in known]
        for name in known.keys() & value.keys():
            found += faults(value[name], known[name], f"{place}.{name}")
    if kind == "array":
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            found.append(f"{place}: {len(value)} items")
        for number, one in enumerate(value):
            found += faults(one, schema["items"], f"{place}[{number}]")
    if kind == "integer" and not schema.get("minimum", value) <= value <= schema.get(
        "maximum", value
    ):
        found.append(f"{place}: {value}")
    return found


@pytest.mark.parametrize(
    ("value", "schema"),
    [
        ("1", {"type": "number"}),
        (True, {"type": "integer"}),
        (-1, {"type": "integer", "minimum": 0}),
        (3, {"oneOf": [{"const": 0}]}),
        ({}, {"type": "object", "properties": {}, "required": ["x"]}),
        ({"y": 1}, {"title": "a", "type": "object", "properties": {}}),
        ([[1.0], [2.0, 3.0]], {"type": "array", "items": {"type": "array", "maxItems": 1}}),
        ([None], {"type": "array", "items": {"anyOf": [{"type": "string"}, {"type": "number"}]}}),
    ],
)
def test_what_does_not_follow_its_schema_is_found(value, schema):
    if "items" in schema and "anyOf" not in schema["items"]:
        schema["items"]["items"] = {"type": "number"}
    assert len(faults(value, schema)) == 1


def test_every_message_follows_its_schema(found):
    wrong = [
        f"{topic} {fault}"
        for topic, published in found.items()
        for _, schema, message, _ in published
        for fault in faults(message, schema)
    ]
    assert wrong == []


def test_each_topic_has_the_schema_that_foxglove_knows(found):
    assert {topic: published[0][0] for topic, published in found.items()} == {
        "/truth": "foxglove.SceneUpdate",
        "/touch/info": "SensorInfo",
        "/touch/raw": "TactileFrame",
        "/touch/raw/pose": "foxglove.PoseInFrame",
        "/tf": "foxglove.FrameTransforms",
        "/touch/patch": "SurfacePatch",
        "/touch/patch/points": "foxglove.PointCloud",
        "/contour/traced": "Contour",
        "/contour/traced/lines": "foxglove.SceneUpdate",
        "/model/shape": "foxglove.SceneUpdate",
        "/score": "Score",
        "/log": "foxglove.Log",
        "/plan/done": "PlanDone",
    }


def test_a_model_is_a_mesh_with_its_triangles(found):
    _, _, update, time = found["/model/shape"][0]
    (entity,) = update["entities"]
    (mesh,) = entity["triangles"]
    assert mesh["indices"] == [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]
    assert mesh["points"][3] == {"x": 0.0, "y": 0.0, "z": 0.03}
    assert len(mesh["points"]) == 4
    assert entity["frame_id"] == "world"
    assert entity["timestamp"]["sec"] * 10**9 + entity["timestamp"]["nsec"] == time
    assert {"key": "touches", "value": "40"} in entity["metadata"]


def colours_of(update):
    (entity,) = update["entities"]
    told = {one["key"]: one["value"] for one in entity["metadata"]}
    colours = entity["triangles"][0]["colors"]
    return told, [[round(255 * one[name]) for name in "rgb"] for one in colours]


@pytest.mark.parametrize("topics", [(), ["/model/shape"]])
def test_a_model_has_the_colours_of_its_deviation_from_the_truth(record, tetrahedron, topics):
    moved = tetrahedron.vertices + np.array([0.0, 0.0, -0.001])
    faces = {"faces": tetrahedron.faces, "floor_faces": tetrahedron.faces}
    truth = Truth(vertices=moved, floor_vertices=moved, **faces, height=0.03)
    found = export(record([("/truth", truth), ("/model/shape", tetrahedron)]), topics)
    assert ("/truth" in found) == (not topics)  # It counts though it is not wanted
    told, colours = colours_of(found["/model/shape"][0][2])
    assert told["coloured_by"] == "deviation"
    assert float(told["colours_end_m"]) == pytest.approx(0.001, rel=0.1)
    # One corner lies on an edge of the truth, the last sticks out by nearly 1 mm.
    assert (colours[0], colours[3]) == ([0xFD, 0xE7, 0x25], [0x44, 0x01, 0x54])


def test_a_model_without_truth_has_those_of_its_uncertainty_if_it_states_one(record, tetrahedron):
    silent = replace(tetrahedron, uncertainty=np.zeros(0), uncertainty_height=np.zeros(0))
    found = export(record([("/model/shape", tetrahedron), ("/model/shape", silent)]))
    told, colours = colours_of(found["/model/shape"][0][2])
    assert told["coloured_by"] == "uncertainty"
    assert colours == [[0x44, 0x01, 0x54]] * 4
    told, colours = colours_of(found["/model/shape"][1][2])
    assert "coloured_by" not in told
    assert colours == []


def test_a_model_without_a_surface_takes_the_last_one_away(found):
    update = found["/model/shape"][1][2]
    assert update["entities"] == []
    assert [one["type"] for one in update["deletions"]] == [1]


def test_contours_are_lines_that_stay_beside_each_other(found):
    entities = [update["entities"][0] for _, _, update, _ in found["/contour/traced/lines"]]
    assert [one["id"] for one in entities] == ["contour 0", "contour 1"]
    assert [one["lines"][0]["type"] for one in entities] == [1, 0]
    assert [len(one["lines"][0]["points"]) for one in entities] == [1, 3]
    assert entities[1]["lines"][0]["points"][2] == {"x": 6.0, "y": 7.0, "z": 8.0}


def test_a_patch_is_a_cloud_of_the_taxels_that_touch(found, sensor, patch):
    ((_, _, cloud, _),) = found["/touch/patch/points"]
    data = base64.b64decode(cloud["data"], validate=True)
    assert [(one["name"], one["offset"], one["type"]) for one in cloud["fields"]] == [
        ("x", 0, 7),
        ("y", 4, 7),
        ("z", 8, 7),
    ]
    assert len(data) == 4 * cloud["point_stride"]
    points = np.frombuffer(data, "<f4").reshape(-1, 3)
    pad: Pad = pad_of_info(sensor)
    x, y = pad.grid()
    wanted = np.column_stack([x[patch.mask], y[patch.mask], patch.height[patch.mask]])
    assert points == pytest.approx(wanted, abs=1e-9)  # single precision of millimetres
    assert cloud["pose"]["position"] == {"x": 0.01, "y": 0.02, "z": 0.03}


def test_fingers_have_poses_and_frames(found):
    poses, frames = found["/touch/raw/pose"], found["/tf"]
    assert [pose["pose"]["position"]["x"] for _, _, pose, _ in poses] == [0.01, 0.011, 0.012]
    (transform,) = frames[2][2]["transforms"]
    assert (transform["parent_frame_id"], transform["child_frame_id"]) == ("world", "finger_2")
    assert transform["translation"] == poses[2][2]["pose"]["position"]
    assert transform["rotation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


def test_log_lines_have_their_level(found):
    ((_, _, line, _),) = found["/log"]
    assert (line["level"], line["name"], line["message"]) == (3, "filter", "a, b\n=c")


def test_all_else_is_json_with_lists_within_lists(found):
    _, schema, frame, _ = found["/touch/raw"][1]
    assert frame["array"] == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert schema["properties"]["array"] == {
        "type": "array",
        "items": {"type": "array", "items": {"type": "number"}},
        "unit": "s or N",
    }
    assert schema["properties"]["pose"]["maxItems"] == 7
    assert found["/plan/done"][0][2]["rms_bound_95"] is None
    assert found["/touch/patch"][0][2]["mask"][0] == [False, True, True]


def test_a_patch_has_its_size_though_the_sensor_is_not_exported(explored):
    found = export(explored, ["/touch/patch"])
    assert found.keys() == {"/touch/patch", "/touch/patch/points"}


@pytest.mark.parametrize("field", ["mask", "height"])
def test_a_patch_that_is_not_of_the_sensor_is_no_cloud(record, sensor, patch, field):
    other = replace(patch, **{field: np.zeros((3, 3), getattr(patch, field).dtype)})
    found = export(
        record([("/touch/patch", patch), ("/touch/info", sensor), ("/touch/patch", other)])
    )
    assert found.keys() == {"/touch/patch", "/touch/info"}
