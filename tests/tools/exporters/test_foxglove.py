"""The MCAP file for Foxglove, read by the stock reader and checked against its schemas."""

import base64
import json
from collections import defaultdict
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from mcap.reader import make_reader

from palpate.messages.types import Truth
from palpate.nodes.specs.sensors import pad_of_info
from palpate.tools.bag.export import export_bag


class Shown(NamedTuple):
    """One message of the exported file."""

    kind: str  # Name of its schema
    schema: dict[str, Any]
    content: dict[str, Any]
    time: int  # [ns]


def export(bag, topics=()):
    """What the exported file holds, by topic."""
    path = bag.with_name("foxglove.mcap")
    path.unlink(missing_ok=True)
    told = export_bag(bag, "foxglove", path, topics)
    found: dict[str, list[Shown]] = defaultdict(list)
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            assert message.log_time == message.publish_time
            content = json.loads(schema.data), json.loads(message.data)
            found[channel.topic].append(Shown(schema.name, *content, message.log_time))
    assert f": {sum(map(len, found.values()))} messages of" in told
    return found


KINDS: dict[str, Any] = {
    "object": dict,
    "array": list,
    "string": str,
    "boolean": bool,
    "integer": int,
    "number": (int, float),
    "null": type(None),
}


def faults(value: Any, schema: dict[str, Any], place: str = "") -> list[str]:
    """Where a value does not follow a JSON schema, of the keywords that are used here."""
    if "anyOf" in schema:
        return min((faults(value, one, place) for one in schema["anyOf"]), key=len)
    allowed = [one["const"] for one in schema.get("oneOf", ())] or schema.get("enum")
    if allowed:
        return [] if value in allowed else [f"{place}: {value!r} is none of {allowed}"]
    kind = schema["type"]
    if not isinstance(value, KINDS[kind]) or (kind != "boolean" and isinstance(value, bool)):
        return [f"{place}: {value!r:.40} is no {kind}"]
    found = []
    if kind == "object":
        known = schema.get("properties", {})
        found += [f"{place}: lacks {one}" for one in schema.get("required", ()) if one not in value]
        if schema.get("additionalProperties") is False or "title" in schema:
            found += [f"{place}: has {one}" for one in value if one not in known]
        for name in known.keys() & value.keys():
            found += faults(value[name], known[name], f"{place}.{name}")
    if kind == "array":
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            found.append(f"{place}: {len(value)} items")
        for number, one in enumerate(value):
            found += faults(one, schema["items"], f"{place}[{number}]")
    if kind == "integer" and not (
        schema.get("minimum", value) <= value <= schema.get("maximum", value)
    ):
        found.append(f"{place}: {value} is out of range")
    return found


def test_every_message_follows_the_schema_foxglove_knows(explored):
    found = export(explored)
    wrong = [
        f"{topic} {fault}"
        for topic, messages in found.items()
        for one in messages
        for fault in faults(one.content, one.schema)
    ]
    assert wrong == []
    assert {topic: messages[0].kind for topic, messages in found.items()} == {
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


def test_model_is_a_mesh_with_its_triangles(explored, tetrahedron):
    shown = export(explored)["/model/shape"][0]
    (entity,) = shown.content["entities"]
    (mesh,) = entity["triangles"]
    assert mesh["indices"] == tetrahedron.faces.ravel().tolist()
    assert [list(one.values()) for one in mesh["points"]] == tetrahedron.vertices.tolist()
    assert entity["frame_id"] == "world"
    assert entity["timestamp"]["sec"] * 10**9 + entity["timestamp"]["nsec"] == shown.time
    assert {"key": "touches", "value": "40"} in entity["metadata"]


def colours_of(update):
    (entity,) = update["entities"]
    metadata = {one["key"]: one["value"] for one in entity["metadata"]}
    colours = entity["triangles"][0]["colors"]
    return metadata, [[round(255 * one[name]) for name in "rgb"] for one in colours]


@pytest.mark.parametrize("topics", [(), ["/model/shape"]])
def test_model_has_the_colours_of_its_deviation(record, tetrahedron, topics):
    moved = tetrahedron.vertices + np.array([0.0, 0.0, -0.001])
    faces = {"faces": tetrahedron.faces, "floor_faces": tetrahedron.faces}
    truth = Truth(vertices=moved, floor_vertices=moved, **faces, height=0.03)
    found = export(record([("/truth", truth), ("/model/shape", tetrahedron)]), topics)
    assert ("/truth" in found) == (not topics)  # the truth counts even where it is not exported
    metadata, colours = colours_of(found["/model/shape"][0].content)
    assert metadata["coloured_by"] == "deviation"
    assert float(metadata["colours_end_m"]) == pytest.approx(0.001, rel=0.1)
    # One corner lies on an edge of the truth, the last sticks out by nearly 1 mm.
    assert (colours[0], colours[3]) == ([0xFD, 0xE7, 0x25], [0x44, 0x01, 0x54])


def test_model_without_truth_has_the_colours_of_its_uncertainty(record, tetrahedron):
    silent = replace(tetrahedron, uncertainty=np.zeros(0), uncertainty_height=np.zeros(0))
    models = export(record([("/m", tetrahedron), ("/m", silent)]))["/m"]
    metadata, colours = colours_of(models[0].content)
    assert metadata["coloured_by"] == "uncertainty" and colours == [[0x44, 0x01, 0x54]] * 4
    assert "coloured_by" not in colours_of(models[1].content)[0]


def test_patch_is_a_cloud_of_the_touching_taxels(explored, sensor, patch):
    found = export(explored)
    (cloud,) = (one.content for one in found["/touch/patch/points"])
    data = base64.b64decode(cloud["data"], validate=True)
    fields = [(one["name"], one["offset"], one["type"]) for one in cloud["fields"]]
    assert fields == [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]
    assert len(data) == 4 * cloud["point_stride"]
    x, y = pad_of_info(sensor).grid()
    wanted = np.column_stack([x[patch.mask], y[patch.mask], patch.height[patch.mask]])
    # Single precision of millimetres.
    assert np.frombuffer(data, "<f4").reshape(-1, 3) == pytest.approx(wanted, abs=1e-9)
    assert cloud["pose"]["position"] == {"x": 0.01, "y": 0.02, "z": 0.03}
    assert export(explored, ["/touch/patch"]).keys() == {"/touch/patch", "/touch/patch/points"}


@pytest.mark.parametrize("field", ["mask", "height"])
def test_patch_of_another_sensor_is_no_cloud(record, sensor, patch, field):
    other = replace(patch, **{field: np.zeros((3, 3), getattr(patch, field).dtype)})
    messages = [("/touch/patch", patch), ("/touch/info", sensor), ("/touch/patch", other)]
    assert export(record(messages)).keys() == {"/touch/patch", "/touch/info"}


def test_contours_fingers_and_log_are_drawn(explored, contour):
    found = export(explored)
    lines = [one.content["entities"][0]["lines"][0] for one in found["/contour/traced/lines"]]
    assert [list(one.values()) for one in lines[-1]["points"]] == [
        [0.0, 1.0, 2.0],
        [3.0, 4.0, 5.0],
        [6.0, 7.0, 8.0],
    ]
    assert lines[-1]["type"] == 0  # an open strip: the contour is occluded
    poses = [one.content["pose"] for one in found["/touch/raw/pose"]]
    assert [pose["position"]["x"] for pose in poses] == [0.01, 0.011, 0.012]
    (transform,) = found["/tf"][2].content["transforms"]
    assert (transform["parent_frame_id"], transform["child_frame_id"]) == ("world", "finger_2")
    assert transform["translation"] == poses[2]["position"]
    assert transform["rotation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    (line,) = (one.content for one in found["/log"])
    assert (line["level"], line["name"], line["message"]) == (3, "filter", "a, b\n=c")


def test_other_messages_are_json_with_nested_lists(explored):
    found = export(explored)
    shown = found["/touch/raw"][1]
    assert shown.content["array"] == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert shown.schema["properties"]["array"] == {
        "type": "array",
        "items": {"type": "array", "items": {"type": "number"}},
        "unit": "s or N",
    }
    assert shown.schema["properties"]["pose"]["maxItems"] == 7
    assert found["/plan/done"][0].content["rms_bound_95"] is None
    assert found["/touch/patch"][0].content["mask"][0] == [False, True, True]
