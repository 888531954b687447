"""A recording as an MCAP file in JSON that Foxglove shows.

Drawables become messages of Foxglove in the colours of their layers; models are coloured by their
deviation or uncertainty. Schemas are those of foxglove-sdk, as far as they are used.
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
FRAMES, FRAMES_TOPIC = "foxglove.FrameTransforms", "/tf"  # of the fingers
LEVELS = {"debug": 1, "info": 2, "warning": 3, "error": 4}
LINE_STRIP, MATCHING_ID, UINT8, FLOAT32 = 0, 0, 1, 7
LEAVES = {"foxglove.PoseInFrame": "pose"}  # last parts of topics that are not a layer's name
CELL = np.dtype(  # of a point of a cloud
    [
        *((name, "<f4") for name in "xyz"),
        *((name, "u1") for name in ("red", "green", "blue", "alpha")),
    ]
)
REPLACED = (types.ShapeModel, types.Truth, types.LogRecord)  # written as Foxglove's messages only
IDENTITY = {
    "position": {"x": 0.0, "y": 0.0, "z": 0.0},
    "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
}
PRIMITIVES = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
Schema = dict[str, Any]


def write_foxglove(source: DecodedRecording, path: Path) -> int:
    """Write a new file; returns the number of messages.

    Models, the truth and log lines become Foxglove's own messages. Other messages become JSON with
    arrays as lists; if they are drawn, Foxglove's messages are added.
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
            if cls not in REPLACED:
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
    """Fields of a message as JSON values, arrays as nested lists."""
    values = {field.name: getattr(message, field.name) for field in dataclasses.fields(message)}
    return {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in values.items()}


def plain_schema(cls: type) -> dict[str, Any]:
    """JSON schema of what `plain_json` returns for a message."""
    described = schema(cls)
    fields = {name: _plain_field(rule) for name, rule in described["properties"].items()}
    return {**described, "properties": fields}


def _plain_field(described: dict[str, Any]) -> dict[str, Any]:
    """Schema of a field whose arrays are lists instead of bytes."""
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
    """Foxglove's messages of a message: on its topic if they replace it, else on topics below."""
    below = not isinstance(decoded.message, REPLACED)
    for drawable in drawables(decoded.message, known):
        write = WRITERS[type(drawable.shape)]
        for name, content in write(drawable, drawable.shape, foxglove_time(decoded.sent_ns)):
            leaf = LEAVES.get(name, drawable.layer)
            topic = f"{decoded.topic}/{leaf}" if below else decoded.topic
            yield FoxgloveMessage(FRAMES_TOPIC if name == FRAMES else topic, name, content)


Stamp = dict[str, int]
Written = Iterator[tuple[str, dict[str, Any]]]  # names of schemas, and contents


def _nothing(drawable: Drawable, _: Nothing, stamp: Stamp) -> Written:
    """Remove the entity that was shown before."""
    removed = {"timestamp": stamp, "type": MATCHING_ID, "id": drawable.path}
    yield SCENE, {"deletions": [removed], "entities": []}


def _mesh(drawable: Drawable, mesh: Mesh, stamp: Stamp) -> Written:
    """A mesh in the colour of its layer, or coloured by a scalar of its vertices."""
    facts, colours, coloured = dict(drawable.facts), [], vertex_colours(mesh.scalars())
    if coloured is not None:
        facts |= {"coloured_by": coloured.name, "colours_end_m": coloured.top}
        shares = (coloured.colours / 255.0).round(4).tolist()
        colours = [{"r": r, "g": g, "b": b, "a": 1.0} for r, g, b in shares]
    triangles = {
        "pose": IDENTITY,
        "points": _points(mesh.vertices),
        "color": _colour(drawable.layer),
        "colors": colours,
        "indices": mesh.faces.ravel().tolist(),
    }
    yield _entity(drawable, stamp, facts, triangles=[triangles])


def _lines(drawable: Drawable, lines: Lines, stamp: Stamp, width: float = 3.0) -> Written:
    """Line strips; `width` [pixels]."""
    shared = {"pose": IDENTITY, "thickness": width, "scale_invariant": True, "indices": []}
    shared |= {"type": LINE_STRIP, "color": _colour(drawable.layer), "colors": []}
    strips = [{**shared, "points": _points(strip)} for strip in lines.strips]
    yield _entity(drawable, stamp, drawable.facts, lines=strips)


def _cloud(drawable: Drawable, points: Points, stamp: Stamp) -> Written:
    """Points in the colour of their layer."""
    cells = np.zeros(len(points.points), CELL)
    values = (*points.points.T, *LAYERS[drawable.layer].rgb, 255)
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


def _finger(drawable: Drawable, finger: Finger, stamp: Stamp) -> Written:
    """The pose, the frame and, once the sensor is known, the pad as a plate."""
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
        cube = {"pose": pose, "size": size, "color": _colour(drawable.layer)}
        yield _entity(drawable, stamp, drawable.facts, cubes=[cube])


def _image(drawable: Drawable, image: Image, stamp: Stamp) -> Written:
    """Compression [m]."""
    rows, columns = image.values.shape
    yield (
        "foxglove.RawImage",
        {
            "timestamp": stamp,
            "frame_id": drawable.path.replace("compression/", "finger_"),
            "width": columns,
            "height": rows,
            "encoding": "32FC1",
            "step": 4 * columns,
            "data": base64.b64encode(image.values.astype("<f4").tobytes()).decode(),
        },
    )


def _number(drawable: Drawable, number: Number, stamp: Stamp) -> Written:
    """Numbers are left out: Foxglove plots the fields of the messages themselves."""
    return iter(())


def _text(drawable: Drawable, line: Text, stamp: Stamp) -> Written:
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
    Number: _number,
}


def foxglove_pose(pose: Floats) -> dict[str, Any]:
    """A pose (7,) as Foxglove's message."""
    x, y, z, *turn = pose.tolist()
    orientation = dict(zip("xyzw", turn, strict=True))
    return {"position": {"x": x, "y": y, "z": z}, "orientation": orientation}


def foxglove_time(ns: int) -> dict[str, int]:
    """A time [ns] as Foxglove's message."""
    sec, nsec = divmod(ns, 1_000_000_000)
    return {"sec": sec, "nsec": nsec}


def _colour(layer: str) -> Mapping[str, float]:
    """Red, green, blue and opacity of a layer, 0 to 1."""
    shares = (round(level / 255.0, 4) for level in LAYERS[layer].rgb)
    return {**dict(zip("rgb", shares, strict=True)), "a": LAYERS[layer].opacity}


def _points(points: Floats) -> list[dict[str, float]]:
    return [{"x": x, "y": y, "z": z} for x, y, z in points.tolist()]


def _entity(
    drawable: Drawable, stamp: Stamp, facts: Mapping[str, object], **primitives: list[Any]
) -> tuple[str, dict[str, Any]]:
    entity = {
        "timestamp": stamp,
        "frame_id": WORLD_FRAME,
        "id": drawable.path,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": False,
        "metadata": [{"key": key, "value": str(value)} for key, value in facts.items()],
        **{kind: primitives.get(kind, []) for kind in PRIMITIVES},
    }
    return SCENE, {"deletions": [], "entities": [entity]}


def _schema(kind: Any) -> Schema:
    """JSON schema of a type named in `foxglove.json`; a list of one type stands for an array."""
    if isinstance(kind, list):
        return {"type": "array", "items": _schema(kind[0])}
    if kind in _DATA["base"]:
        return dict(_DATA["base"][kind])
    title, content = f"foxglove.{kind}", _DATA["types"][kind]
    if isinstance(content, list):
        options = [{"title": name, "const": number} for number, name in enumerate(content)]
        return {"title": title, "oneOf": options}
    fields = {name: _schema(field) for name, field in content.items()}
    return {"title": title, "type": "object", "properties": fields, "required": list(fields)}


_DATA: dict[str, Any] = json.loads(Path(__file__).with_name("foxglove.json").read_text("utf-8"))
# Schemas of whole messages, by their names.
SCHEMAS: Mapping[str, Schema] = {f"foxglove.{kind}": _schema(kind) for kind in _DATA["messages"]}

FORMAT = ExportFormat(write_foxglove, "messages")
