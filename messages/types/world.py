"""What the simulator says once, at the start: the world, the sensor, and the truth."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.messages.quantity import (
    Count,
    Metres,
    MetresPerSecond,
    PerMetre,
    Points,
    Ratio,
    Triangles,
)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class World:
    """What a robot knows before it touches anything. Latched on ``/world``."""

    platform: Metres
    """Height of the pedestal on which the object stands."""
    reach: Metres
    """The finger reaches this far sideways from the world's axis and up from the platform."""
    fingers: Count
    """Number of fingers."""
    seed: Count
    """The run's seed."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Truth:
    """The true shape. Latched on ``/truth``, for the evaluator and viewers alone."""

    MAX_BYTES = 256 << 20

    vertices: Points
    """Vertices of the true surface, world frame."""
    faces: Triangles
    """Triangles of the true surface, counter-clockwise seen from outside."""
    floor_vertices: Points
    """A second, coarser tessellation of the same shape, for the sampling floor."""
    floor_faces: Triangles
    """Triangles of the second tessellation."""
    height: Metres
    """True height of the object."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SensorInfo:
    """The fingertip's array, pad and calibration. Latched on ``/touch/info``.

    To a tactile frame what CameraInfo is to an image.
    """

    rows: Count
    """Rows of taxels."""
    cols: Count
    """Columns of taxels."""
    pitch: Metres
    """Distance between neighbouring taxels."""
    thickness: Metres
    """Thickness of the elastic pad over the transducers."""
    dome: PerMetre
    """Curvature of the domed pad's face at its middle; 0 for a flat pad."""
    sound_speed: MetresPerSecond
    """Speed of sound in the pad."""
    saturation: Ratio
    """Largest compression as a share of the thickness."""
    noise: Metres
    """Standard deviation of one taxel's compression; 0 if it is ideal."""
