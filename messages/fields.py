"""Field types of messages: unit, dtype and shape, and how each is packed, unpacked and described.

A message is a frozen dataclass whose fields use the names of this module. The codec reads them
to check values at both ends, and to write the JSON schema that recordings carry.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

Shape = tuple[int | None, ...]
Floats = NDArray[np.float64]
MAX_TEXT = 4096  # Longest text, bytes of UTF-8
MAX_ITEMS = 4096  # Longest tuple
FEW_ELEMENTS = 16  # Elements up to which an array is summed up faster without numpy
MAX_FIELDS = 64  # Most fields of a message, and entries of a table
MAX_NESTED = 2 * MAX_FIELDS + 1  # Lists and maps of a message: an array is a map with a list
Convert = Callable[[Any], Any]


@dataclass(frozen=True, slots=True)
class Unit:
    """The unit of a number; ``"1"`` for a pure one, ``"#"`` for a count."""

    symbol: str


@dataclass(frozen=True, slots=True)
class Array:
    """An array: dtype on the wire, shape with None where any length will do, unit."""

    dtype: str
    shape: Shape
    unit: str


class CodecError(ValueError):
    """A value is not the message that it should be."""


class FieldRule(NamedTuple):
    """One field's way onto the wire and back."""

    pack: Convert  # Checks a value and turns it into what msgpack can write
    unpack: Convert  # Checks what msgpack read and turns it into the value
    schema: dict[str, Any]  # JSON schema of the field


def field_rule(hint: Any) -> FieldRule:
    """Rule for a field of this type."""
    marks = getattr(hint, "__metadata__", ())
    for mark in marks:
        if isinstance(mark, Array):
            return _array_rule(mark)
    plain = get_args(hint)[0] if marks else hint
    unit = next(({"unit": mark.symbol} for mark in marks if isinstance(mark, Unit)), {})
    plain_rules = {
        float: FieldRule(_pack_float, _unpack_float, {"type": "number", **unit}),
        int: FieldRule(_pack_int, _pack_int, {"type": "integer", **unit}),
        bool: FieldRule(_pack_bool, _pack_bool, {"type": "boolean"}),
        str: FieldRule(_pack_text, _pack_text, {"type": "string", "maxLength": MAX_TEXT}),
    }
    return plain_rules[plain] if plain in plain_rules else _compound_rule(plain)


def _array_rule(array: Array) -> FieldRule:
    dtype = np.dtype(array.dtype)
    floating, itemsize = dtype.kind == "f", dtype.itemsize
    fixed = [(axis, length) for axis, length in enumerate(array.shape) if length is not None]

    def check(value: np.ndarray[Any, Any]) -> None:
        shape = value.shape
        fits = len(shape) == len(array.shape)
        for axis, length in fixed:
            fits = fits and shape[axis] == length
        if not fits:
            raise CodecError(f"must have shape {_shape_text(array)}, got {shape}")
        if floating and not _is_finite(value):
            raise CodecError("must be finite")

    def pack(value: Any) -> dict[str, Any]:
        if not isinstance(value, np.ndarray) or value.dtype != dtype:
            raise CodecError(f"must be an array of {dtype}, got {_shown(value)}")
        check(value)
        return {"dtype": array.dtype, "shape": value.shape, "data": value.tobytes()}

    def unpack(value: Any) -> np.ndarray[Any, Any]:
        if type(value) is not dict or len(value) != 3 or value.get("dtype") != array.dtype:
            raise CodecError(f"must be a map of dtype {array.dtype}, shape and data")
        shape, data = value.get("shape"), value.get("data")
        if type(shape) is not list or type(data) is not bytes or len(shape) != len(array.shape):
            raise CodecError(f"must have shape {_shape_text(array)} and bytes as data")
        size = itemsize
        for length in shape:
            if type(length) is not int or length < 0:
                raise CodecError("must have a shape of whole numbers, none below 0")
            size *= length
        if size != len(data):
            raise CodecError(f"has {len(data)} bytes, which do not fill shape {shape}")
        if dtype.kind == "b" and data.strip(b"\0\1"):
            raise CodecError("must hold 0 or 1 only")
        try:
            result = np.ndarray(shape, dtype, data)
        except (ValueError, TypeError):  # an empty array with an absurd length along another axis
            raise CodecError(f"has {len(data)} bytes, which do not fill shape {shape}") from None
        check(result)
        return result

    described = {"type": "object", "dtype": array.dtype, "shape": array.shape, "unit": array.unit}
    return FieldRule(pack, unpack, described)


def _shape_text(array: Array) -> str:
    return "(" + ", ".join("any" if n is None else str(n) for n in array.shape) + ")"


def _is_finite(value: np.ndarray[Any, Any]) -> bool:
    """Whether no element is a NaN or infinite.

    A sum, or a sum of squares, is finite only if all that is summed is: it is looked at first, for
    it is cheap. If it overflows, elements are looked at one by one.
    """
    few = value.size <= FEW_ELEMENTS
    total = sum(value.ravel().tolist()) if few else np.vdot(value, value)
    return math.isfinite(total) or bool(np.isfinite(value).all())


def _pack_int(value: Any) -> int:
    if type(value) is not int and not isinstance(value, np.integer):
        raise CodecError(f"must be an integer, got {_shown(value)}")
    number = int(value)
    if not -(1 << 63) <= number < 1 << 63:
        raise CodecError("must fit into 64 bits")
    return number


def _pack_bool(value: Any) -> bool:
    if type(value) is not bool and not isinstance(value, np.bool_):
        raise CodecError(f"must be true or false, got {_shown(value)}")
    return bool(value)


def _compound_rule(plain: Any) -> FieldRule:
    origin, args = get_origin(plain), get_args(plain)
    if origin in (Union, UnionType) and len(args) == 2 and args[1] is NoneType:
        pack, unpack, described = field_rule(args[0])
        return FieldRule(_or_none(pack), _or_none(unpack), {"anyOf": [described, {"type": "null"}]})
    if origin is Literal:
        one_of = _one_of(frozenset(args))
        return FieldRule(one_of, one_of, {"enum": list(args)})
    if origin is tuple and len(args) == 2 and args[1] is ...:
        pack, unpack, item = field_rule(args[0])
        described = {"type": "array", "items": item, "maxItems": MAX_ITEMS}
        return FieldRule(_tuple_of(pack, (tuple, list)), _tuple_of(unpack, (list,)), described)
    if origin is dict and args == (str, float):
        described = {"type": "object", "additionalProperties": {"type": "number"}}
        return FieldRule(_table(_pack_float), _table(_unpack_float), described)
    raise CodecError(f"no message field can be a {plain!r}")


def _or_none(convert: Convert) -> Convert:
    def convert_some(value: Any) -> Any:
        return None if value is None else convert(value)

    return convert_some


def _one_of(allowed: frozenset[str]) -> Convert:
    def check(value: Any) -> str:
        if type(value) is not str or value not in allowed:
            raise CodecError(f"must be one of {sorted(allowed)}, got {_shown(value)}")
        return value

    return check


def _tuple_of(item: Convert, kinds: tuple[type, ...]) -> Convert:
    def convert(value: Any) -> tuple[Any, ...]:
        if type(value) not in kinds or len(value) > MAX_ITEMS:
            raise CodecError(f"must be a list of at most {MAX_ITEMS}, got {_shown(value)}")
        return tuple(item(entry) for entry in value)

    return convert


def _table(number: Convert) -> Convert:
    def convert(value: Any) -> dict[str, float]:
        if type(value) is not dict or len(value) > MAX_FIELDS:
            raise CodecError(f"must be a table of at most {MAX_FIELDS}, got {_shown(value)}")
        return {_pack_text(key): number(entry) for key, entry in value.items()}

    return convert


def _pack_text(value: Any) -> str:
    if type(value) is not str:
        raise CodecError(f"must be text, got {_shown(value)}")
    try:
        size = len(value.encode())
    except UnicodeEncodeError:
        raise CodecError("must be Unicode that can be written, got half a character") from None
    if size > MAX_TEXT:
        raise CodecError(f"must be at most {MAX_TEXT} bytes long, got {size}")
    return value


def _pack_float(value: Any) -> float:
    if type(value) is float:
        return _unpack_float(value)
    if isinstance(value, bool) or not isinstance(value, (int, np.floating, np.integer)):
        raise CodecError(f"must be a number, got {_shown(value)}")
    try:
        return _unpack_float(float(value))
    except OverflowError:
        raise CodecError("must be finite, got an integer beyond all floats") from None


def _unpack_float(value: Any) -> float:
    if type(value) is not float:
        raise CodecError(f"must be a float, got {_shown(value)}")
    if not math.isfinite(value):
        raise CodecError(f"must be finite, got {value}")
    return value


def _shown(value: Any) -> str:
    """Name a wrong value without printing a large or hostile one."""
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype}"
    if type(value) is int and value.bit_length() > 64:
        return "an integer beyond 64 bits"
    if isinstance(value, (bool, int, float, str)):
        text = repr(value)
        return text if len(text) <= 40 else text[:37] + "..."
    return f"a {type(value).__name__}"


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
Vector = Annotated[Floats, Array("<f8", (3,), "m")]
Direction = Annotated[Floats, Array("<f8", (3,), "1")]
PlanarPoint = Annotated[Floats, Array("<f8", (2,), "m")]
Points = Annotated[Floats, Array("<f8", (None, 3), "m")]
Directions = Annotated[Floats, Array("<f8", (None, 3), "1")]
Triangles = Annotated[NDArray[np.int32], Array("<i4", (None, 3), "#")]
Lengths = Annotated[Floats, Array("<f8", (None,), "m")]
Numbers = Annotated[Floats, Array("<f8", (None,), "1")]
FingerNumbers = Annotated[NDArray[np.int32], Array("<i4", (None,), "#")]
# What the time of a move was made of: the wait, the way from the last start pose and the turn, the
# approach, and the way from the last contact along the surface, -1 where there was none.
MoveParts = Annotated[Floats, Array("<f8", (5,), "s, m, rad, m, m")]
# Speeds of a robot: of travel and its acceleration, of turning, towards the surface and away from
# it; then its rest in contact and the overhead of a command. None where they are not known.
RobotSpeeds = Annotated[Floats, Array("<f8", (None,), "m/s, m/s2, rad/s, m/s, m/s, s, s")]
Curvatures = Annotated[Floats, Array("<f8", (None,), "1/m")]
# Times of flight or forces, as the SensorInfo says.
SignalImage = Annotated[Floats, Array("<f8", (None, None), "s or N")]
RatioImage = Annotated[Floats, Array("<f8", (None, None), "1")]
LengthImage = Annotated[Floats, Array("<f8", (None, None), "m")]
Mask = Annotated[NDArray[np.bool_], Array("|b1", (None, None), "1")]
Voxels = Annotated[NDArray[np.uint8], Array("|u1", (None, None, None), "1")]
ControlPoints = Annotated[Floats, Array("<f8", (None, None, None, 3), "m")]
# Bytes that mean something only to who packed them.
PackedBytes = Annotated[NDArray[np.uint8], Array("|u1", (None,), "1")]
