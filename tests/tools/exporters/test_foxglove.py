"""The MCAP file for Foxglove, read by the stock reader and checked against its schemas."""

import base64
import json
from collections import defaultdict
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from mcap.reader import make_reader

from palpate.tools.bag.export import export_bag
from palpate.tools.drawables import LAYERS

CLOUDS = ("/touched", "/free", "/unknown", "/untouched")


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
    text = export_bag(bag, "foxglove", path, topics)
    by_topic: dict[str, list[Shown]] = defaultdict(list)
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            assert message.log_time == message.publish_time
            content = json.loads(schema.data), json.loads(message.data)
            by_topic[channel.topic].append(Shown(schema.name, *content, message.log_time))
    assert f": {sum(map(len, by_topic.values()))} messages of" in text
    return by_topic


KINDS: dict[str, set[type]] = {"object": {dict}, "array": {list}, "string": {str}}
KINDS |= {"boolean": {bool}, "integer": {int}, "number": {int, float}, "null": {type(None)}}


def follows(value: Any, schema: dict[str, Any]) -> bool:
    """Whether a value follows a JSON schema, of the keywords that are used here."""
    if "anyOf" in schema:
        return any(follows(value, one) for one in schema["anyOf"])
    allowed = [one["const"] for one in schema.get("oneOf", ())] or schema.get("enum")
    if allowed:
        return value in allowed
    kind = schema["type"]
    if type(value) not in KINDS[kind]:
        return False
    if kind == "object":
        known, present = schema.get("properties", {}), {*value}
        closed = schema.get("additionalProperties") is False or "title" in schema
        if not {*schema.get("required", ())} <= present or (closed and not present <= {*known}):
            return False
        return all(follows(value[name], known[name]) for name in known.keys() & present)
    if kind == "array":
        sized = schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value))
        return sized and all(follows(one, schema["items"]) for one in value)
    return kind != "integer" or (
        schema.get("minimum", value) <= value <= schema.get("maximum", value)
    )


def primitive(shown, kind):
    """The only primitive of a kind in a scene."""
    ((only,),) = (entity[kind] for entity in shown.content["entities"])
    return only


def test_every_message_follows_the_schema_foxglove_knows_in_its_colour(explored):
    by_topic = export(explored)
    for topic, messages in by_topic.items():
        assert all(follows(one.content, one.schema) for one in messages), topic
    shown = {topic: (messages[0].kind, len(messages)) for topic, messages in by_topic.items()}
    assert shown == {
        "/world": ("World", 1),
        "/truth": ("foxglove.SceneUpdate", 1),
        "/touch/info": ("SensorInfo", 1),
        "/hand/contacts": ("GraspContacts", 1),
        "/hand/contacts/touched": ("foxglove.PointCloud", 1),
        "/touch/raw": ("TactileFrame", 1),
        "/touch/raw/pose": ("foxglove.PoseInFrame", 1),
        "/touch/raw/finger": ("foxglove.SceneUpdate", 1),
        "/tf": ("foxglove.FrameTransforms", 1),
        "/touch/image": ("TactileImage", 1),
        "/touch/image/compression": ("foxglove.RawImage", 1),
        "/touch/patch": ("SurfacePatch", 1),
        "/touch/patch/touched": ("foxglove.PointCloud", 1),
        "/contour/traced": ("Contour", 4),
        "/contour/traced/contours": ("foxglove.SceneUpdate", 4),
        "/model/shape": ("foxglove.SceneUpdate", 4),
        "/model/space": ("SpaceMap", 1),
        "/model/space/free": ("foxglove.PointCloud", 1),
        "/model/space/unknown": ("foxglove.PointCloud", 1),
        "/score": ("Score", 1),
        "/plan/estimate": ("PlanEstimate", 2),
        "/log": ("foxglove.Log", 1),
        "/plan/done": ("PlanDone", 1),
        "/plan/done/untouched": ("foxglove.PointCloud", 1),
    }
    scenes = [one.content for one in by_topic["/model/shape"]]
    for part in ("entities", "deletions"):
        assert [one["id"] for scene in scenes for one in scene[part]] == ["solid", "lattice"]

    clouds = {topic: by_topic[topic][0].content for topic in by_topic if topic.endswith(CLOUDS)}
    assert len(clouds) == 5
    for topic, cloud in clouds.items():
        cells = np.frombuffer(base64.b64decode(cloud["data"], validate=True), np.uint8)
        colours = cells.reshape(-1, cloud["point_stride"])[:, 12:]
        assert len(colours) and (colours == (*LAYERS[topic.rpartition("/")[2]].rgb, 255)).all()
    for topic, kind, layer in (
        ("/contour/traced/contours", "lines", "contours"),
        ("/touch/raw/finger", "cubes", "finger"),
        ("/truth", "triangles", "truth"),
    ):
        colour = [*primitive(by_topic[topic][0], kind)["color"].values()]
        wanted = [*(one / 255.0 for one in LAYERS[layer].rgb), LAYERS[layer].opacity]
        assert colour == pytest.approx(wanted, abs=1e-4)


@pytest.mark.parametrize("topics", [(), ["/model/shape"]])
def test_model_mesh_is_coloured_by_first_known_scalar(topics, explored, tetrahedron):
    by_topic = export(explored, topics)
    if topics:  # the truth counts even where it is not exported
        assert [*by_topic] == topics
    shown = by_topic["/model/shape"][0]
    mesh, (entity,) = primitive(shown, "triangles"), shown.content["entities"]
    assert mesh["indices"] == tetrahedron.faces.ravel().tolist()
    assert [list(one.values()) for one in mesh["points"]] == tetrahedron.vertices.tolist()
    assert entity["timestamp"]["sec"] * 10**9 + entity["timestamp"]["nsec"] == shown.time
    facts = {one["key"]: one["value"] for one in entity["metadata"]}
    assert (entity["frame_id"], facts["touches"], facts["coloured_by"]) == (
        *("world", "40", "deviation"),
    )
    assert float(facts["colours_end_m"]) == pytest.approx(0.001, rel=0.1)
    colours = [[round(255 * one[name]) for name in "rgb"] for one in mesh["colors"]]
    # The truth begins 1 mm beside the first corner; on it lies the second.
    assert colours[:2] == [[0x44, 0x01, 0x54], [0xFD, 0xE7, 0x25]]


def test_model_without_truth_has_the_colours_of_its_uncertainty(record, tetrahedron):
    silent = replace(tetrahedron, uncertainty=np.zeros(0), uncertainty_height=np.zeros(0))
    stated, _, plain, _ = export(record([("/m", tetrahedron), ("/m", silent)]))["/m"]
    colours = [[*one.values()] for one in primitive(stated, "triangles")["colors"]]
    assert colours == [pytest.approx([0x44 / 255, 0x01 / 255, 0x54 / 255, 1.0], abs=1e-4)] * 4
    facts = stated.content["entities"][0]["metadata"]
    assert {"key": "coloured_by", "value": "uncertainty"} in facts
    assert primitive(plain, "triangles")["colors"] == []


def test_clouds_images_lines_and_poses_have_recorded_values(explored, patch):
    by_topic = export(explored)
    (cloud,) = (one.content for one in by_topic["/touch/patch/touched"])
    fields = [(one["name"], one["offset"], one["type"]) for one in cloud["fields"]]
    colours = [("red", 12, 1), ("green", 13, 1), ("blue", 14, 1), ("alpha", 15, 1)]
    assert fields == [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), *colours]
    data = np.frombuffer(base64.b64decode(cloud["data"], validate=True), "<f4").reshape(-1, 4)
    # Single precision of centimetres.
    assert data[:, :3] == pytest.approx(patch.points, abs=1e-8)
    lines = [primitive(one, "lines")["points"] for one in by_topic["/contour/traced/contours"][2:]]
    assert [[*one.values()] for one in lines[0]] == np.arange(9.0).reshape(3, 3).tolist()
    assert [len(one) for one in lines] == [3, 4]  # an open one, and a closed one
    (placed,) = (one.content for one in by_topic["/touch/raw/pose"])
    assert placed["pose"]["position"] == {"x": 0.01, "y": 0.02, "z": 0.03}
    (transform,) = by_topic["/tf"][0].content["transforms"]
    assert (transform["parent_frame_id"], transform["child_frame_id"]) == ("world", "finger_2")
    assert transform["translation"] == placed["pose"]["position"]
    assert transform["rotation"] == placed["pose"]["orientation"]
    plate = primitive(by_topic["/touch/raw/finger"][0], "cubes")
    assert plate["size"] == {"x": 0.003, "y": 0.002, "z": 0.003}
    (image,) = (one.content for one in by_topic["/touch/image/compression"])
    pressed = np.frombuffer(base64.b64decode(image["data"]), "<f4")
    assert pressed.reshape(image["height"], image["width"])[0] == pytest.approx([0.0, 1e-4, 1e-4])
    (line,) = (one.content for one in by_topic["/log"])
    assert (line["level"], line["name"], line["message"]) == (3, "filter", "a, b\n=c")
    # Other messages are JSON with nested lists.
    shown = by_topic["/touch/raw"][0]
    assert shown.content["array"] == [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]
    assert shown.schema["properties"]["array"]["unit"] == "s or N"
    assert shown.schema["properties"]["pose"]["maxItems"] == 7
    assert by_topic["/plan/done"][0].content["rms_bound_95"] is None
    assert by_topic["/touch/patch"][0].content["mask"][0] == [False, True, True]
