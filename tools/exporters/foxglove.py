"""A recording as an MCAP file in JSON that Foxglove shows.

Models, contours, touched points, the finger and the log become its own messages; models are
coloured by how good they are. Schemas are those of foxglove-sdk, as far as they are used.
"""

from __future__ import annotations

import base64
import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.writer import CompressionType, Writer

from palpate import __version__
from palpate.core.arrays import Floats
from palpate.launch.colours import rgb
from palpate.messages import schema, types
from palpate.nodes.specs.sensors import pad_of_info
from palpate.tools.bag.decoding import DecodedMessage, DecodedRecording
from palpate.tools.bag.export_format import ExportFormat
from palpate.tools.surfaces import TruthSurface, vertex_colours, vertex_scalars

SCENE = "foxglove.SceneUpdate"
WORLD_FRAME = "world"
FRAMES_TOPIC = "/tf"  # Topic of the frames of the fingers
LEVELS = {"debug": 1, "info": 2, "warning": 3, "error": 4}
LINE_STRIP, LINE_LOOP, ALL, FLOAT32 = 0, 1, 1, 7
LINE_PIXELS = 3.0  # Width of a contour
TRUTH_OPACITY = 0.3
INSTEAD = (types.ShapeModel, types.Truth, types.LogRecord)  # Shown as Foxglove's messages alone
# Types that are read though their topics are not wanted: others are drawn by what they say.
ALSO_READ = frozenset(kind.__name__ for kind in (types.SensorInfo, types.Truth))
IDENTITY = {
    "position": {"x": 0.0, "y": 0.0, "z": 0.0},
    "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
}
PRIMITIVES = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
Schema = dict[str, Any]


def write_foxglove(source: DecodedRecording, path: Path) -> int:
    """Write a new file; returns the number of messages.

    Models, the truth and log lines become Foxglove's own messages; contours, patches and the poses
    of fingers have them beside what was recorded. All else is JSON, arrays as lists.
    """
    with path.open("xb") as file:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start(library=f"palpate {__version__}")
        views, schemas, channels = FoxgloveConverter(), dict[str, int](), dict[Any, int]()
        count = 0
        for decoded in source.published(also=ALSO_READ):
            shown = views.of(decoded)
            if decoded.topic not in source.topics:
                continue
            cls = type(decoded.message)
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


class FoxgloveConverter:
    """Turns messages into views; remembers the sensor, without which a patch has no size.

    It remembers the truth as well, from which models deviate.
    """

    def __init__(self) -> None:
        self._sensor: types.SensorInfo | None = None
        self._truth: TruthSurface | None = None

    def of(self, decoded: DecodedMessage) -> list[FoxgloveMessage]:
        """What Foxglove shall draw of a message; nothing of most."""
        match decoded.message:
            case types.SensorInfo() as info:
                self._sensor = info
            case types.ShapeModel():
                return [_model(decoded, self._truth)]
            case types.Truth() as truth:
                self._truth = TruthSurface(truth)
                return [_truth(decoded)]
            case types.LogRecord():
                return [_log(decoded)]
            case types.Contour():
                return [_contour(decoded)]
            case types.SurfacePatch() as patch if self._sensor is not None:
                grid = (self._sensor.rows, self._sensor.cols)
                fits = patch.mask.shape == patch.height.shape == grid
                return [_patch(decoded, self._sensor)] if fits else []
            case types.TactileFrame():
                return _finger(decoded)
        return []


def _contour(decoded: DecodedMessage) -> FoxgloveMessage:
    contour: types.Contour = decoded.message
    line = {
        "type": LINE_LOOP if contour.status == "closed" else LINE_STRIP,
        "pose": IDENTITY,
        "thickness": LINE_PIXELS,
        "scale_invariant": True,
        "points": _points(contour.points),
        "color": _colour("contour"),
        "colors": [],
        "indices": [],
    }
    told = {"status": contour.status, "height_m": contour.height, "touches": contour.touches}
    entity = _entity(decoded, f"contour {contour.id}", {"lines": [line]}, told)
    return FoxgloveMessage(f"{decoded.topic}/lines", SCENE, {"deletions": [], "entities": [entity]})


def _patch(decoded: DecodedMessage, sensor: types.SensorInfo) -> FoxgloveMessage:
    """Touched taxels in the frame of the pad, whose pose the cloud carries."""
    patch: types.SurfacePatch = decoded.message
    x, y = pad_of_info(sensor).grid()
    cells = [x[patch.mask], y[patch.mask], patch.height[patch.mask]]
    data = np.column_stack(cells).astype("<f4").tobytes()
    content = {
        "timestamp": foxglove_time(decoded.sent_ns),
        "frame_id": WORLD_FRAME,
        "pose": foxglove_pose(patch.pose),
        "point_stride": 12,
        "fields": [
            {"name": name, "offset": 4 * number, "type": FLOAT32}
            for number, name in enumerate("xyz")
        ],
        "data": base64.b64encode(data).decode(),
    }
    return FoxgloveMessage(f"{decoded.topic}/points", "foxglove.PointCloud", content)


def _finger(decoded: DecodedMessage) -> list[FoxgloveMessage]:
    frame: types.TactileFrame = decoded.message
    time, pose = foxglove_time(decoded.sent_ns), foxglove_pose(frame.pose)
    transform = {
        "timestamp": time,
        "parent_frame_id": WORLD_FRAME,
        "child_frame_id": f"finger_{frame.finger}",
        "translation": pose["position"],
        "rotation": pose["orientation"],
    }
    placed = {"timestamp": time, "frame_id": WORLD_FRAME, "pose": pose}
    return [
        FoxgloveMessage(f"{decoded.topic}/pose", "foxglove.PoseInFrame", placed),
        FoxgloveMessage(FRAMES_TOPIC, "foxglove.FrameTransforms", {"transforms": [transform]}),
    ]


def foxglove_pose(pose: Floats) -> dict[str, Any]:
    """A pose as Foxglove has it."""
    x, y, z, *turn = pose.tolist()
    orientation = dict(zip("xyzw", turn, strict=True))
    return {"position": {"x": x, "y": y, "z": z}, "orientation": orientation}


def foxglove_time(ns: int) -> dict[str, int]:
    """A time as Foxglove has it."""
    sec, nsec = divmod(ns, 1_000_000_000)
    return {"sec": sec, "nsec": nsec}


def _model(decoded: DecodedMessage, truth: TruthSurface | None) -> FoxgloveMessage:
    """A model, coloured by its deviation from the truth, or else by its own uncertainty."""
    model: types.ShapeModel = decoded.message
    if len(model.faces) == 0:  # nothing could be rebuilt: what was there before must go
        gone = {"timestamp": foxglove_time(decoded.sent_ns), "type": ALL, "id": ""}
        return FoxgloveMessage(decoded.topic, SCENE, {"deletions": [gone], "entities": []})
    told: dict[str, object] = {
        "number": model.number,
        "touches": model.touches,
        "deviation_m": model.deviation,
        "final": str(model.final).lower(),
    }
    shown, colours = vertex_colours(vertex_scalars(model, truth)), []
    if shown is not None:
        told |= {"coloured_by": shown.name, "colours_end_m": shown.top}
        shares = (shown.colours / 255.0).round(4).tolist()
        colours = [{"r": r, "g": g, "b": b, "a": 1.0} for r, g, b in shares]
    return _mesh(decoded, _colour("solid"), colours, told)


def _truth(decoded: DecodedMessage) -> FoxgloveMessage:
    return _mesh(decoded, _colour("truth", TRUTH_OPACITY), [], {"height_m": decoded.message.height})


def _colour(quantity: str, opacity: float = 1.0) -> Mapping[str, float]:
    """The colour of a quantity, 0 to 1."""
    shares = (round(one / 255.0, 4) for one in rgb(quantity))
    return {**dict(zip("rgb", shares, strict=True)), "a": opacity}


def _mesh(
    decoded: DecodedMessage,
    colour: Mapping[str, float],
    colours: list[dict[str, float]],
    told: Mapping[str, object],
) -> FoxgloveMessage:
    """A mesh in one colour, or in one for each vertex."""
    triangles = {
        "pose": IDENTITY,
        "points": _points(decoded.message.vertices),
        "color": colour,
        "colors": colours,
        "indices": decoded.message.faces.ravel().tolist(),
    }
    entity = _entity(decoded, decoded.topic, {"triangles": [triangles]}, told)
    return FoxgloveMessage(decoded.topic, SCENE, {"deletions": [], "entities": [entity]})


def _points(points: Floats) -> list[dict[str, float]]:
    return [{"x": x, "y": y, "z": z} for x, y, z in points.tolist()]


def _entity(
    decoded: DecodedMessage, name: str, primitives: Mapping[str, object], told: Mapping[str, object]
) -> dict[str, Any]:
    return {
        "timestamp": foxglove_time(decoded.sent_ns),
        "frame_id": WORLD_FRAME,
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": False,
        "metadata": [{"key": key, "value": str(value)} for key, value in told.items()],
        **{kind: primitives.get(kind, []) for kind in PRIMITIVES},
    }


def _log(decoded: DecodedMessage) -> FoxgloveMessage:
    record: types.LogRecord = decoded.message
    content = {
        "timestamp": foxglove_time(decoded.sent_ns),
        "level": LEVELS[record.level],
        "message": record.text,
        "name": record.node,
        "file": "",
        "line": 0,
    }
    return FoxgloveMessage(decoded.topic, "foxglove.Log", content)


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
