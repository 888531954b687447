"""A recording as an MCAP file in JSON that Foxglove shows.

What is drawn becomes its own messages, in the colours of its layers; models are coloured by how
good they are. Schemas are those of foxglove-sdk, as far as they are used.
"""

from __future__ import annotations

import base64
import dataclasses
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.writer import CompressionType, Writer

from palpate import __version__
from palpate.core.arrays import Floats
from palpate.messages import schema, types
from palpate.tools.bag.decoding import DecodedMessage, DecodedRecording
from palpate.tools.bag.export_format import ExportFormat
from palpate.tools.drawables import (
    LAYERS,
    TYPES_NEEDED,
    Drawable,
    Finger,
    Image,
    Known,
    Lines,
    Mesh,
    Nothing,
    Number,
    Points,
    Text,
    drawables,
    pad_size,
)
from palpate.tools.surfaces import vertex_colours

SCENE = "foxglove.SceneUpdate"
WORLD_FRAME = "world"
FRAMES, FRAMES_TOPIC = "foxglove.FrameTransforms", "/tf"  # Of the fingers
LEVELS = {"debug": 1, "info": 2, "warning": 3, "error": 4}
LINE_STRIP, MATCHING_ID, UINT8, FLOAT32 = 0, 0, 1, 7
LEAVES = {"foxglove.PoseInFrame": "pose"}  # Of topics that are not named by their layer
LINE_PIXELS = 3.0  # Width of a contour
CELL = np.dtype(  # A point of a cloud
    [
        *((name, "<f4") for name in "xyz"),
        *((name, "u1") for name in ("red", "green", "blue", "alpha")),
    ]
)
INSTEAD = (types.ShapeModel, types.Truth, types.LogRecord)  # Shown as Foxglove's messages alone
IDENTITY = {
    "position": {"x": 0.0, "y": 0.0, "z": 0.0},
    "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
}
PRIMITIVES = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
Schema = dict[str, Any]


def write_foxglove(source: DecodedRecording, path: Path) -> int:
    """Write a new file; returns the number of messages.

    Models, the truth and log lines become Foxglove's own messages; what else is drawn has them
    beside what was recorded. All else is JSON, arrays as lists.
    """
    with path.open("xb") as file:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start(library=f"palpate {__version__}")
        known, schemas, channels = Known(), dict[str, int](), dict[Any, int]()
        count = 0
        for decoded in source.published(also=TYPES_NEEDED):
            known.take(decoded.message)
            if decoded.topic not in source.topics:
                continue
            shown, cls = [*foxglove_messages(decoded, known)], type(decoded.message)
            if cls not in INSTEAD:
                whole = FoxgloveMessage(decoded.topic, cls.__name__, plain_json(decoded.message))
                shown = [whole, *shown]
            for topic, name, content in shown:
                if name not in schemas:
                    text = json.dumps(SCHEMAS.get(name) or plain_schema(cls)).encode()
                    schemas[name] = writer.register_schema(name, "jsonschema", text)
                if (topic, name) not in channels:
                    number = writer.register_channel(topic, "json", schemas[name])
                    channels[topic, name] = number
                data = json.dumps(content, allow_nan=False, ensure_ascii=False).encode()
                time = decoded.sent_ns
                writer.add_message(channels[topic, name], time, data, time, decoded.seq)
            count += len(shown)
        writer.finish()  # type: ignore[no-untyped-call]
    return count


def plain_json(message: Any) -> dict[str, Any]:
    """A message as JSON has it, its arrays as lists within lists."""
    found = {field.name: getattr(message, field.name) for field in dataclasses.fields(message)}
    return {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in found.items()}


def plain_schema(cls: type) -> dict[str, Any]:
    """JSON schema of a message as `plain_json` gives it."""
    described = schema(cls)
    fields = {name: _plain_field(one) for name, one in described["properties"].items()}
    return {**described, "properties": fields}


def _plain_field(described: dict[str, Any]) -> dict[str, Any]:
    """Schema of a field, whose arrays are lists and no longer bytes."""
    if "dtype" not in described:
        return described
    kind = np.dtype(described["dtype"]).kind
    items: dict[str, Any] = {"type": {"f": "number", "b": "boolean"}.get(kind, "integer")}
    for length in reversed(described["shape"]):
        items = {"type": "array", "items": items}
        if length is not None:
            items |= {"minItems": length, "maxItems": length}
    return {**items, "unit": described["unit"]}


class FoxgloveMessage(NamedTuple):
    """One message for Foxglove."""

    topic: str
    schema: str
    content: dict[str, Any]


def foxglove_messages(decoded: DecodedMessage, known: Known) -> Iterator[FoxgloveMessage]:
    """What Foxglove draws of a message: on its own topic if it is shown `INSTEAD`, or below it."""
    below = not isinstance(decoded.message, INSTEAD)
    for one in drawables(decoded.message, known):
        write = WRITERS[type(one.shape)]
        for name, content in write(one, one.shape, foxglove_time(decoded.sent_ns)):
            topic = f"{decoded.topic}/{LEAVES.get(name, one.layer)}" if below else decoded.topic
            yield FoxgloveMessage(FRAMES_TOPIC if name == FRAMES else topic, name, content)


Stamp = dict[str, int]
Written = Iterator[tuple[str, dict[str, Any]]]  # Name of a schema, and the content


def _nothing(one: Drawable, _: Nothing, stamp: Stamp) -> Written:
    """What was there before must go."""
    gone = {"timestamp": stamp, "type": MATCHING_ID, "id": one.path}
    yield SCENE, {"deletions": [gone], "entities": []}


def _mesh(one: Drawable, mesh: Mesh, stamp: Stamp) -> Written:
    """A mesh in the colour of its layer, or by what is known of its vertices."""
    facts, colours, coloured = dict(one.facts), [], vertex_colours(mesh.scalars())
    if coloured is not None:
        facts |= {"coloured_by": coloured.name, "colours_end_m": coloured.top}
        shares = (coloured.colours / 255.0).round(4).tolist()
        colours = [{"r": r, "g": g, "b": b, "a": 1.0} for r, g, b in shares]
    triangles = {
        "pose": IDENTITY,
        "points": _points(mesh.vertices),
        "color": _colour(one.layer),
        "colors": colours,
        "indices": mesh.faces.ravel().tolist(),
    }
    yield _entity(one, stamp, facts, triangles=[triangles])


def _lines(one: Drawable, lines: Lines, stamp: Stamp) -> Written:
    shared = {"pose": IDENTITY, "thickness": LINE_PIXELS, "scale_invariant": True, "indices": []}
    shared |= {"type": LINE_STRIP, "color": _colour(one.layer), "colors": []}
    strips = [{**shared, "points": _points(strip)} for strip in lines.strips]
    yield _entity(one, stamp, one.facts, lines=strips)


def _cloud(one: Drawable, points: Points, stamp: Stamp) -> Written:
    """Points in the colour of their layer."""
    cells = np.zeros(len(points.points), CELL)
    values = (*points.points.T, *LAYERS[one.layer].rgb, 255)
    for name, value in zip(CELL.names or (), values, strict=True):
        cells[name] = value
    fields = [
        {"name": name, "offset": offset, "type": FLOAT32 if kind.kind == "f" else UINT8}
        for name, (kind, offset, *_) in (CELL.fields or {}).items()
    ]
    yield (
        "foxglove.PointCloud",
        {
            "timestamp": stamp,
            "frame_id": WORLD_FRAME,
            "pose": IDENTITY,
            "point_stride": CELL.itemsize,
            "fields": fields,
            "data": base64.b64encode(cells.tobytes()).decode(),
        },
    )


def _finger(one: Drawable, finger: Finger, stamp: Stamp) -> Written:
    """The pose, the frame, and the pad as a plate once the sensor is known."""
    pose = foxglove_pose(finger.pose)
    transform = {
        "timestamp": stamp,
        "parent_frame_id": WORLD_FRAME,
        "child_frame_id": f"finger_{finger.number}",
        "translation": pose["position"],
        "rotation": pose["orientation"],
    }
    yield "foxglove.PoseInFrame", {"timestamp": stamp, "frame_id": WORLD_FRAME, "pose": pose}
    yield FRAMES, {"transforms": [transform]}
    if finger.pad is not None:
        size = dict(zip("xyz", pad_size(finger.pad), strict=True))
        cube = {"pose": pose, "size": size, "color": _colour(one.layer)}
        yield _entity(one, stamp, one.facts, cubes=[cube])


def _image(one: Drawable, image: Image, stamp: Stamp) -> Written:
    """Compression in metres."""
    rows, columns = image.values.shape
    yield (
        "foxglove.RawImage",
        {
            "timestamp": stamp,
            "frame_id": one.path.replace("compression/", "finger_"),
            "width": columns,
            "height": rows,
            "encoding": "32FC1",
            "step": 4 * columns,
            "data": base64.b64encode(image.values.astype("<f4").tobytes()).decode(),
        },
    )


def _nowhere(one: Drawable, number: Number, stamp: Stamp) -> Written:
    """Numbers are left out: Foxglove plots the fields of the messages themselves."""
    return iter(())


def _text(one: Drawable, line: Text, stamp: Stamp) -> Written:
    content = {"timestamp": stamp, "level": LEVELS[line.level], "message": line.text}
    yield "foxglove.Log", {**content, "name": line.node, "file": "", "line": 0}


WRITERS: Mapping[type, Callable[[Drawable, Any, Stamp], Written]] = {
    Nothing: _nothing,
    Mesh: _mesh,
    Lines: _lines,
    Points: _cloud,
    Finger: _finger,
    Image: _image,
    Text: _text,
    Number: _nowhere,
}


def foxglove_pose(pose: Floats) -> dict[str, Any]:
    """A pose as Foxglove has it."""
    x, y, z, *turn = pose.tolist()
    orientation = dict(zip("xyzw", turn, strict=True))
    return {"position": {"x": x, "y": y, "z": z}, "orientation": orientation}


def foxglove_time(ns: int) -> dict[str, int]:
    """A time as Foxglove has it."""
    sec, nsec = divmod(ns, 1_000_000_000)
    return {"sec": sec, "nsec": nsec}


def _colour(layer: str) -> Mapping[str, float]:
    """The colour of a layer, 0 to 1."""
    shares = (round(one / 255.0, 4) for one in LAYERS[layer].rgb)
    return {**dict(zip("rgb", shares, strict=True)), "a": LAYERS[layer].opacity}


def _points(points: Floats) -> list[dict[str, float]]:
    return [{"x": x, "y": y, "z": z} for x, y, z in points.tolist()]


def _entity(
    one: Drawable, stamp: Stamp, facts: Mapping[str, object], **primitives: list[Any]
) -> tuple[str, dict[str, Any]]:
    entity = {
        "timestamp": stamp,
        "frame_id": WORLD_FRAME,
        "id": one.path,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": False,
        "metadata": [{"key": key, "value": str(value)} for key, value in facts.items()],
        **{kind: primitives.get(kind, []) for kind in PRIMITIVES},
    }
    return SCENE, {"deletions": [], "entities": [entity]}


def _schema(kind: Any) -> Schema:
    """JSON schema of a type as `foxglove.json` names it; a list of one holds many of it."""
    if isinstance(kind, list):
        return {"type": "array", "items": _schema(kind[0])}
    if kind in _DATA["base"]:
        return dict(_DATA["base"][kind])
    title, told = f"foxglove.{kind}", _DATA["types"][kind]
    if isinstance(told, list):
        options = [{"title": name, "const": number} for number, name in enumerate(told)]
        return {"title": title, "oneOf": options}
    fields = {name: _schema(one) for name, one in told.items()}
    return {"title": title, "type": "object", "properties": fields, "required": list(fields)}


_DATA: dict[str, Any] = json.loads(Path(__file__).with_name("foxglove.json").read_text("utf-8"))
# Schemas of whole messages, by their names.
SCHEMAS: Mapping[str, Schema] = {f"foxglove.{one}": _schema(one) for one in _DATA["messages"]}

FORMAT = ExportFormat(write_foxglove, "messages")
