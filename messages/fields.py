"""Field types of messages: unit, dtype and shape, with their packing, checks and schemas.

A message is a frozen dataclass with fields of these types. The codec uses them to check values at
both ends, and to write the JSON schema that recordings contain.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

Shape = tuple[int | None, ...]
Floats = NDArray[np.float64]
MAX_TEXT = 4096  # of a text [characters]
MAX_ITEMS = 4096  # of a tuple
MAX_MESSAGE_BYTES = 256 << 20  # of any body: for codec, writer and reader of recordings
MAX_FIELDS = 64  # of a table
LARGEST = f"{sys.float_info.max!r}"  # finite number
Convert = Callable[[Any], Any]


@dataclass(frozen=True, slots=True)
class Unit:
    """The unit of a number: ``"1"`` for a ratio, ``"#"`` for a count."""

    symbol: str


@dataclass(frozen=True, slots=True)
class Array:
    """An array: dtype on the wire, shape with None for any length, unit."""

    dtype: str
    shape: Shape
    unit: str


class CodecError(ValueError):
    """A value is no valid message."""


class FieldRule(NamedTuple):
    """Conversion of one field to the wire and back."""

    wire: Any  # type on the wire, with its checks
    schema: dict[str, Any]  # JSON schema of the field
    pack: Convert | None = None  # converts an array to the wire
    unpack: Convert | None = None  # checks and converts an array from the wire


def field_rule(hint: Any) -> FieldRule:
    """The rule for a field of this type."""
    marks = getattr(hint, "__metadata__", ())
    for mark in marks:
        if isinstance(mark, Array):
            return _array_rule(mark)
    plain = get_args(hint)[0] if marks else hint
    unit = next(({"unit": mark.symbol} for mark in marks if isinstance(mark, Unit)), {})
    plain_rules = {
        float: FieldRule(_FLOAT, {"type": "number", **unit}),
        int: FieldRule(_INT, {"type": "integer", **unit}),
        bool: FieldRule(bool, {"type": "boolean"}),
        str: FieldRule(_TEXT, {"type": "string", "maxLength": MAX_TEXT}),
    }
    return plain_rules[plain] if plain in plain_rules else _compound_rule(plain)


@cache
def _array_rule(array: Array) -> FieldRule:
    dtype = np.dtype(array.dtype)
    floating, boolean = dtype.kind == "f", dtype.kind == "b"
    lengths: Any = tuple(_LENGTH if length is None else Literal[length] for length in array.shape)
    fields: Any = ("dtype", Literal[array.dtype]), ("shape", tuple[lengths]), ("data", bytes)
    wire = msgspec.defstruct("Array", fields, forbid_unknown_fields=True, gc=False)

    def pack(value: Any) -> dict[str, Any]:
        if not isinstance(value, np.ndarray):
            raise CodecError(f"must be an array of {dtype}, got a {type(value).__name__}")
        if floating and not _is_finite(value):
            raise CodecError("must be finite")
        return {"dtype": value.dtype.str, "shape": value.shape, "data": value.tobytes()}

    def unpack(packed: Any) -> np.ndarray[Any, Any]:
        shape, data = packed.shape, packed.data
        try:
            value = np.ndarray(shape, dtype, data)
        except (ValueError, TypeError):
            value = None  # too few bytes, or an empty array with a huge axis
        if value is None or value.nbytes != len(data):
            raise CodecError(f"has {len(data)} bytes, which do not fill shape {shape_text(shape)}")
        if floating and not _is_finite(value):
            raise CodecError("must be finite")
        if boolean and data.strip(b"\0\1"):
            raise CodecError("must hold 0 or 1 only")
        return value

    described = {"type": "object", "dtype": array.dtype, "shape": array.shape, "unit": array.unit}
    return FieldRule(wire, described, pack, unpack)


def shape_text(shape: Shape) -> str:
    """A shape in words of errors."""
    return "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"


def _is_finite(value: np.ndarray[Any, Any], max_listed: int = 16) -> bool:
    """Whether no element is NaN or infinite.

    A sum, or a sum of squares, is finite only if all elements are; it is checked first because it
    is fast, up to `max_listed` elements as a list. If it overflows, all elements are checked.
    """
    is_small = value.size <= max_listed
    total = sum(value.ravel().tolist()) if is_small else np.vdot(value, value)
    return math.isfinite(total) or bool(np.isfinite(value).all())


def _compound_rule(plain: Any) -> FieldRule:
    origin, args = get_origin(plain), get_args(plain)
    schema: dict[str, Any]
    if origin in (Union, UnionType) and len(args) == 2 and args[1] is NoneType:
        rule: Any = field_rule(args[0])
        schema = {"anyOf": [rule.schema, {"type": "null"}]}
        return FieldRule(rule.wire | None, schema, _or_none(rule.pack), _or_none(rule.unpack))
    if origin is Literal:
        return FieldRule(plain, {"enum": list(args)})
    if origin is tuple and len(args) == 2 and args[1] is ...:
        item: Any = field_rule(args[0])
        if item.pack is None:
            schema = {"type": "array", "items": item.schema, "maxItems": MAX_ITEMS}
            return FieldRule(Annotated[tuple[item.wire, ...], Meta(max_length=MAX_ITEMS)], schema)
    if origin is dict and args == (str, float):
        schema = {"type": "object", "additionalProperties": {"type": "number"}}
        return FieldRule(Annotated[dict[_TEXT, _FLOAT], Meta(max_length=MAX_FIELDS)], schema)
    raise CodecError(f"no message field can be a {plain!r}")


def _or_none(convert: Convert | None) -> Convert | None:
    if convert is None:
        return None
    return lambda value: None if value is None else convert(value)


# Types on the wire.
_LENGTH = Annotated[int, Meta(ge=0, le=(1 << 63) - 1)]
_INT = Annotated[int, Meta(ge=-(1 << 63), le=(1 << 63) - 1)]
_FLOAT = Annotated[float, Meta(ge=-sys.float_info.max, le=sys.float_info.max)]
_TEXT = Annotated[str, Meta(max_length=MAX_TEXT)]

Metres = Annotated[float, Unit("m")]
Seconds = Annotated[float, Unit("s")]
PerMetre = Annotated[float, Unit("1/m")]
MetresPerSecond = Annotated[float, Unit("m/s")]
NewtonsPerMetre = Annotated[float, Unit("N/m")]
Radians = Annotated[float, Unit("rad")]
Degrees = Annotated[float, Unit("deg")]
Ratio = Annotated[float, Unit("1")]
Count = Annotated[int, Unit("#")]
# Position x, y, z in m, then a unit quaternion x, y, z, w.
Pose = Annotated[Floats, Array("<f8", (7,), "m, 1")]
Poses = Annotated[Floats, Array("<f8", (None, 7), "m, 1")]
Vector = Annotated[Floats, Array("<f8", (3,), "m")]
Direction = Annotated[Floats, Array("<f8", (3,), "1")]
PlanarPoint = Annotated[Floats, Array("<f8", (2,), "m")]
Points = Annotated[Floats, Array("<f8", (None, 3), "m")]
Directions = Annotated[Floats, Array("<f8", (None, 3), "1")]
Triangles = Annotated[NDArray[np.int32], Array("<i4", (None, 3), "#")]
Lengths = Annotated[Floats, Array("<f8", (None,), "m")]
Numbers = Annotated[Floats, Array("<f8", (None,), "1")]
FingerNumbers = Annotated[NDArray[np.int32], Array("<i4", (None,), "#")]
# Parts of a move: waiting time, path and turn from the last start pose, approach, and path from the
# last contact along the surface, -1 if there is none.
MoveParts = Annotated[Floats, Array("<f8", (5,), "s, m, rad, m, m")]
# Speed and acceleration of a robot's travel, speeds of turning, of approach to the surface and of
# retreat from it; then the time in contact and the overhead of a command. Empty if unknown.
RobotSpeeds = Annotated[Floats, Array("<f8", (None,), "m/s, m/s2, rad/s, m/s, m/s, s, s")]
Curvatures = Annotated[Floats, Array("<f8", (None,), "1/m")]
# Times of flight or forces, as in SensorInfo.
SignalImage = Annotated[Floats, Array("<f8", (None, None), "s or N")]
RatioImage = Annotated[Floats, Array("<f8", (None, None), "1")]
LengthImage = Annotated[Floats, Array("<f8", (None, None), "m")]
Mask = Annotated[NDArray[np.bool_], Array("|b1", (None, None), "1")]
Voxels = Annotated[NDArray[np.uint8], Array("|u1", (None, None, None), "1")]
ControlPoints = Annotated[Floats, Array("<f8", (None, None, None, 3), "m")]
# Bytes in a format of the publisher.
PackedBytes = Annotated[NDArray[np.uint8], Array("|u1", (None,), "1")]
