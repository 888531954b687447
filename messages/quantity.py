"""Field types of messages: what a field holds, in which unit and shape.

A message is a frozen dataclass whose fields use the names of this module. The codec
reads them to check values at both ends, and to write the schema that recordings carry.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

Shape = tuple[int | None, ...]


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


Metres = Annotated[float, Unit("m")]
Seconds = Annotated[float, Unit("s")]
PerMetre = Annotated[float, Unit("1/m")]
MetresPerSecond = Annotated[float, Unit("m/s")]
NewtonsPerMetre = Annotated[float, Unit("N/m")]
Radians = Annotated[float, Unit("rad")]
Degrees = Annotated[float, Unit("deg")]
Ratio = Annotated[float, Unit("1")]
Count = Annotated[int, Unit("#")]

Floats = NDArray[np.float64]
Pose = Annotated[Floats, Array("<f8", (7,), "m, 1")]
"""Position x, y, z in m, then a unit quaternion x, y, z, w."""
Vector = Annotated[Floats, Array("<f8", (3,), "m")]
Direction = Annotated[Floats, Array("<f8", (3,), "1")]
Place = Annotated[Floats, Array("<f8", (2,), "m")]
Points = Annotated[Floats, Array("<f8", (None, 3), "m")]
Directions = Annotated[Floats, Array("<f8", (None, 3), "1")]
Triangles = Annotated[NDArray[np.int32], Array("<i4", (None, 3), "#")]
Lengths = Annotated[Floats, Array("<f8", (None,), "m")]
Numbers = Annotated[Floats, Array("<f8", (None,), "1")]
Fingers = Annotated[NDArray[np.int32], Array("<i4", (None,), "#")]
Move = Annotated[Floats, Array("<f8", (5,), "s, m, rad, m, m")]
"""What the time of a move was made of: the wait, the way from the last start pose and the turn, the
approach, and the way from the last contact along the surface, -1 where there was none."""
Curvatures = Annotated[Floats, Array("<f8", (None,), "1/m")]
SignalImage = Annotated[Floats, Array("<f8", (None, None), "s or N")]
"""Times of flight or forces, as the SensorInfo says."""
RatioImage = Annotated[Floats, Array("<f8", (None, None), "1")]
LengthImage = Annotated[Floats, Array("<f8", (None, None), "m")]
Mask = Annotated[NDArray[np.bool_], Array("|b1", (None, None), "1")]
ControlPoints = Annotated[Floats, Array("<f8", (None, None, None, 3), "m")]
Packed = Annotated[NDArray[np.uint8], Array("|u1", (None,), "1")]
"""Bytes that mean something only to who packed them."""
