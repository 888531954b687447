"""The world, the sensor and the truth, published once at the start; and the map of space."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from palpate.messages.fields import (
    MAX_MESSAGE_BYTES,
    Count,
    LengthImage,
    Metres,
    MetresPerSecond,
    NewtonsPerMetre,
    PerMetre,
    PlanarPoint,
    Points,
    Ratio,
    RatioImage,
    RobotSpeeds,
    Triangles,
    Vector,
    Voxels,
)
from palpate.reprs import readable


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class World:
    """Facts that a robot knows before it touches anything. Latched on ``/world``."""

    platform: Metres  # Height of the pedestal on which the object stands
    # Whether the object is held and does not stand; then `platform` is only where reach begins
    held: bool = False
    # Reach of the finger, sideways from an upright axis and upwards from the platform
    reach: Metres
    # Position of this axis, x and y
    centre: PlanarPoint = field(default_factory=lambda: np.zeros(2))
    fingers: Count  # Number of fingers
    seed: Count  # The run's seed
    # Speeds of the robot, to keep within a limit of time; empty if unknown
    robot: RobotSpeeds = field(default_factory=lambda: np.zeros(0))


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Truth:
    """The true shape. Latched on ``/truth``, for the evaluator and viewers alone."""

    MAX_BYTES = MAX_MESSAGE_BYTES

    vertices: Points  # Vertices of the true surface, world frame
    faces: Triangles  # Triangles of the true surface, counter-clockwise seen from outside
    # A second, coarser tessellation of the same shape, for the sampling floor
    floor_vertices: Points
    floor_faces: Triangles  # Triangles of the second tessellation
    height: Metres  # True height of the object
    platform: Metres | None = None  # Height on which it stands; null if it is held


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SpaceMap:
    """Map of the space around the object. Latched on ``/model/space``."""

    MAX_BYTES = 16 << 20  # of `palpate.core.explore.MAX_VOXELS` voxels, and the other fields

    number: Count  # Number of its model
    low: Vector  # Middle of the first voxel, world frame
    step: Metres  # Edge of a voxel
    states: Voxels  # 0: unknown, 1: free, since a finger has swept it, 2: touched


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SensorInfo:
    """The fingertip's array, pad and calibration. Latched on ``/touch/info``.

    It describes tactile frames, as CameraInfo of ROS describes images.
    """

    rows: Count  # Rows of taxels
    cols: Count  # Columns of taxels
    pitch: Metres  # Distance between neighbouring taxels
    thickness: Metres  # Thickness of the elastic pad over the transducers
    dome: PerMetre  # Curvature of the domed pad's face at its middle; 0 for a flat pad
    # Signal of a taxel: the time of flight of its echo, or the force on it
    signal: Literal["time", "force"]
    sound_speed: MetresPerSecond  # Speed of sound in the pad
    taxel_stiffness: NewtonsPerMetre  # Force on one taxel for each metre of compression
    # Factor that corrects each taxel's compression; all 1 if there is nothing to correct
    gain: RatioImage
    offset: LengthImage  # Added to the compression after that; all 0 if there is nothing to correct
    saturation: Ratio  # Largest compression as a share of the thickness
    # Shape of the pad's face beside a contact: flat, or sloping back like a membrane on springs, or
    # like the surface of a deep elastic body
    face: Literal["springs", "membrane", "half_space"]
    face_decay: Metres  # Length in which a membrane falls to 1/e; 0 for the others
    noise: Metres  # Standard deviation of one taxel's compression; 0 if it is ideal
