"""Our messages as those that Foxglove draws."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.launch.bag.decoded import Said
from palpate.messages.types import (
    Contour,
    LogRecord,
    SensorInfo,
    ShapeModel,
    SurfacePatch,
    TactileFrame,
    Truth,
)
from palpate.nodes.sensor import pad_of_info

WORLD = "world"
FRAMES = "/tf"
"""Topic of the frames of the fingers."""
LEVELS = {"debug": 1, "info": 2, "warning": 3, "error": 4}
LINE_STRIP, LINE_LOOP, ALL, FLOAT32 = 0, 1, 1, 7
PIXELS = 3.0
"""Width of a contour."""
MODEL_COLOUR = {"r": 0.36, "g": 0.55, "b": 0.84, "a": 1.0}
TRUTH_COLOUR = {"r": 0.6, "g": 0.6, "b": 0.6, "a": 0.3}
CONTOUR_COLOUR = {"r": 0.9, "g": 0.45, "b": 0.1, "a": 1.0}
IDENTITY = {
    "position": {"x": 0.0, "y": 0.0, "z": 0.0},
    "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
}
PRIMITIVES = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")


class View(NamedTuple):
    """One message for Foxglove."""

    topic: str
    schema: str
    content: dict[str, Any]


class Views:
    """Turns messages into views; remembers the sensor, without which a patch has no size."""

    def __init__(self) -> None:
        self._sensor: SensorInfo | None = None

    def of(self, said: Said) -> list[View]:
        """What Foxglove shall draw of a message; nothing of most."""
        match said.message:
            case SensorInfo() as info:
                self._sensor = info
            case ShapeModel() | Truth() | LogRecord():
                return [_INSTEAD[type(said.message)](said)]
            case Contour():
                return [_contour(said)]
            case SurfacePatch() as patch if self._sensor is not None:
                grid = (self._sensor.rows, self._sensor.cols)
                fits = patch.mask.shape == patch.height.shape == grid
                return [_patch(said, self._sensor)] if fits else []
            case TactileFrame():
                return _finger(said)
        return []


def replaced(cls: type) -> bool:
    """Whether a view stands for the message, which is not exported beside it."""
    return cls in _INSTEAD


def time_of(ns: int) -> dict[str, int]:
    """A time as Foxglove has it."""
    sec, nsec = divmod(ns, 1_000_000_000)
    return {"sec": sec, "nsec": nsec}


def pose_of(pose: Floats) -> dict[str, Any]:
    """A pose as Foxglove has it."""
    values = pose.tolist()
    return {"position": _named("xyz", values[:3]), "orientation": _named("xyzw", values[3:])}


def _model(said: Said) -> View:
    model: ShapeModel = said.message
    told = {
        "number": model.number,
        "touches": model.touches,
        "deviation_m": model.deviation,
        "final": str(model.final).lower(),
    }
    return _mesh(said, model.vertices, model.faces, MODEL_COLOUR, told)


def _truth(said: Said) -> View:
    truth: Truth = said.message
    return _mesh(said, truth.vertices, truth.faces, TRUTH_COLOUR, {"height_m": truth.height})


def _mesh(
    said: Said,
    vertices: Floats,
    faces: np.ndarray[Any, Any],
    colour: Mapping[str, float],
    told: Mapping[str, object],
) -> View:
    if len(faces) == 0:  # nothing could be rebuilt: what was there before must go
        gone = {"timestamp": time_of(said.sent_ns), "type": ALL, "id": ""}
        return _update(said.topic, {"deletions": [gone], "entities": []})
    triangles = {
        "pose": IDENTITY,
        "points": _points(vertices),
        "color": colour,
        "colors": [],
        "indices": faces.ravel().tolist(),
    }
    entity = _entity(said, said.topic, {"triangles": [triangles]}, told)
    return _update(said.topic, {"deletions": [], "entities": [entity]})


def _contour(said: Said) -> View:
    contour: Contour = said.message
    line = {
        "type": LINE_LOOP if contour.status == "closed" else LINE_STRIP,
        "pose": IDENTITY,
        "thickness": PIXELS,
        "scale_invariant": True,
        "points": _points(contour.points),
        "color": CONTOUR_COLOUR,
        "colors": [],
        "indices": [],
    }
    told = {"status": contour.status, "height_m": contour.height, "touches": contour.touches}
    entity = _entity(said, f"contour {contour.id}", {"lines": [line]}, told)
    return _update(f"{said.topic}/lines", {"deletions": [], "entities": [entity]})


def _patch(said: Said, sensor: SensorInfo) -> View:
    """Touched taxels in the frame of the pad, whose pose the cloud carries."""
    patch: SurfacePatch = said.message
    x, y = pad_of_info(sensor).grid()
    cells = [x[patch.mask], y[patch.mask], patch.height[patch.mask]]
    data = np.column_stack(cells).astype("<f4").tobytes()
    content = {
        "timestamp": time_of(said.sent_ns),
        "frame_id": WORLD,
        "pose": pose_of(patch.pose),
        "point_stride": 12,
        "fields": [
            {"name": name, "offset": 4 * number, "type": FLOAT32}
            for number, name in enumerate("xyz")
        ],
        "data": base64.b64encode(data).decode(),
    }
    return View(f"{said.topic}/points", "foxglove.PointCloud", content)


def _finger(said: Said) -> list[View]:
    frame: TactileFrame = said.message
    time, pose = time_of(said.sent_ns), pose_of(frame.pose)
    transform = {
        "timestamp": time,
        "parent_frame_id": WORLD,
        "child_frame_id": f"finger_{frame.finger}",
        "translation": pose["position"],
        "rotation": pose["orientation"],
    }
    placed = {"timestamp": time, "frame_id": WORLD, "pose": pose}
    return [
        View(f"{said.topic}/pose", "foxglove.PoseInFrame", placed),
        View(FRAMES, "foxglove.FrameTransforms", {"transforms": [transform]}),
    ]


def _log(said: Said) -> View:
    record: LogRecord = said.message
    content = {
        "timestamp": time_of(said.sent_ns),
        "level": LEVELS[record.level],
        "message": record.text,
        "name": record.node,
        "file": "",
        "line": 0,
    }
    return View(said.topic, "foxglove.Log", content)


_INSTEAD: Mapping[type, Callable[[Said], View]] = {
    ShapeModel: _model,
    Truth: _truth,
    LogRecord: _log,
}


def _entity(
    said: Said, name: str, primitives: Mapping[str, object], told: Mapping[str, object]
) -> dict[str, Any]:
    return {
        "timestamp": time_of(said.sent_ns),
        "frame_id": WORLD,
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": False,
        "metadata": [{"key": key, "value": str(value)} for key, value in told.items()],
        **{kind: primitives.get(kind, []) for kind in PRIMITIVES},
    }


def _update(topic: str, content: dict[str, Any]) -> View:
    return View(topic, "foxglove.SceneUpdate", content)


def _points(points: Floats) -> list[dict[str, float]]:
    return [{"x": x, "y": y, "z": z} for x, y, z in points.tolist()]


def _named(names: str, values: list[float]) -> dict[str, float]:
    return dict(zip(names, values, strict=True))
