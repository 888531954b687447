"""Those of Foxglove's message schemas that an export needs, as they are published.

Names, fields, constants and what is required are those of ``schemas/jsonschema`` in
https://github.com/foxglove/foxglove-sdk (MIT licence), without the prose and the optional fields.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Described = dict[str, Any]

NUMBER: Described = {"type": "number"}
TEXT: Described = {"type": "string"}
BOOLEAN: Described = {"type": "boolean"}
NATURAL: Described = {"type": "integer", "minimum": 0}
BASE64: Described = {"type": "string", "contentEncoding": "base64"}
NANOSECONDS: Described = {**NATURAL, "maximum": 999_999_999}


def _object(title: str, **fields: Described) -> Described:
    return {"title": title, "type": "object", "properties": fields, "required": list(fields)}


def _list(items: Described) -> Described:
    return {"type": "array", "items": items}


def _choice(title: str, *names: str) -> Described:
    options = [{"title": name, "const": number} for number, name in enumerate(names)]
    return {"title": f"foxglove.{title}", "oneOf": options}


def _numbers(title: str, names: str) -> Described:
    return _object(f"foxglove.{title}", **dict.fromkeys(names, NUMBER))


def _timed(title: str, seconds: Described) -> Described:
    """A time or a duration; neither field is required."""
    fields = {"sec": seconds, "nsec": NANOSECONDS}
    return {"title": title, "type": "object", "properties": fields}


TIME = _timed("time", NATURAL)
DURATION = _timed("duration", {"type": "integer"})
VECTOR = _numbers("Vector3", "xyz")
POINT = _numbers("Point3", "xyz")
QUATERNION = _numbers("Quaternion", "xyzw")
COLOR = _numbers("Color", "rgba")
POSE = _object("foxglove.Pose", position=VECTOR, orientation=QUATERNION)

_CORNERS = {
    "points": _list(POINT),
    "color": COLOR,
    "colors": _list(COLOR),
    "indices": _list(NATURAL),
}
ARROW = _object(
    "foxglove.ArrowPrimitive",
    pose=POSE,
    shaft_length=NUMBER,
    shaft_diameter=NUMBER,
    head_length=NUMBER,
    head_diameter=NUMBER,
    color=COLOR,
)
CUBE = _object("foxglove.CubePrimitive", pose=POSE, size=VECTOR, color=COLOR)
SPHERE = _object("foxglove.SpherePrimitive", pose=POSE, size=VECTOR, color=COLOR)
CYLINDER = _object(
    "foxglove.CylinderPrimitive",
    pose=POSE,
    size=VECTOR,
    bottom_scale=NUMBER,
    top_scale=NUMBER,
    color=COLOR,
)
LINE = _object(
    "foxglove.LinePrimitive",
    type=_choice("LineType", "LINE_STRIP", "LINE_LOOP", "LINE_LIST"),
    pose=POSE,
    thickness=NUMBER,
    scale_invariant=BOOLEAN,
    **_CORNERS,
)
TRIANGLES = _object("foxglove.TriangleListPrimitive", pose=POSE, **_CORNERS)
LABEL = _object(
    "foxglove.TextPrimitive",
    pose=POSE,
    billboard=BOOLEAN,
    font_size=NUMBER,
    scale_invariant=BOOLEAN,
    color=COLOR,
    text=TEXT,
)
MODEL = _object(
    "foxglove.ModelPrimitive",
    pose=POSE,
    scale=VECTOR,
    color=COLOR,
    override_color=BOOLEAN,
    url=TEXT,
    media_type=TEXT,
    data=BASE64,
)
ENTITY = _object(
    "foxglove.SceneEntity",
    timestamp=TIME,
    frame_id=TEXT,
    id=TEXT,
    lifetime=DURATION,
    frame_locked=BOOLEAN,
    metadata=_list(_object("foxglove.KeyValuePair", key=TEXT, value=TEXT)),
    arrows=_list(ARROW),
    cubes=_list(CUBE),
    spheres=_list(SPHERE),
    cylinders=_list(CYLINDER),
    lines=_list(LINE),
    triangles=_list(TRIANGLES),
    texts=_list(LABEL),
    models=_list(MODEL),
)
DELETION = _object(
    "foxglove.SceneEntityDeletion",
    timestamp=TIME,
    type=_choice("SceneEntityDeletionType", "MATCHING_ID", "ALL"),
    id=TEXT,
)
FIELD = _object(
    "foxglove.PackedElementField",
    name=TEXT,
    offset=NATURAL,
    type=_choice(
        "NumericType",
        *("UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64"),
    ),
)
TRANSFORM = _object(
    "foxglove.FrameTransform",
    timestamp=TIME,
    parent_frame_id=TEXT,
    child_frame_id=TEXT,
    translation=VECTOR,
    rotation=QUATERNION,
)

SCHEMAS: Mapping[str, Described] = {
    one["title"]: one
    for one in (
        _object("foxglove.SceneUpdate", deletions=_list(DELETION), entities=_list(ENTITY)),
        _object(
            "foxglove.PointCloud",
            timestamp=TIME,
            frame_id=TEXT,
            pose=POSE,
            point_stride=NATURAL,
            fields=_list(FIELD),
            data=BASE64,
        ),
        _object("foxglove.PoseInFrame", timestamp=TIME, frame_id=TEXT, pose=POSE),
        _object("foxglove.FrameTransforms", transforms=_list(TRANSFORM)),
        _object(
            "foxglove.Log",
            timestamp=TIME,
            level=_choice("LogLevel", "UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"),
            message=TEXT,
            name=TEXT,
            file=TEXT,
            line=NATURAL,
        ),
    )
}
"""Schemas of whole messages, by their names."""
