"""Messages of one touch: tactile frame, tactile image and surface patch."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from palpate.messages.fields import (
    Count,
    Direction,
    Directions,
    Floats,
    LengthImage,
    Mask,
    Metres,
    MoveParts,
    Numbers,
    PerMetre,
    Points,
    Pose,
    Radians,
    Ratio,
    Seconds,
    SignalImage,
)
from palpate.reprs import readable

# ``hit``: pressed to the requested depth. ``miss``: no contact within reach. ``inside``: the start
# pose is inside the object. ``bottomed``: the pad saturated before the requested depth
Outcome = Literal["hit", "miss", "inside", "bottomed"]


def no_move() -> Floats:
    """The move of a frame without a robot arm, as of a driver."""
    return np.array([0.0, 0.0, 0.0, 0.0, -1.0])


# Kind of the touched surface: smooth enough for curvatures, an edge, a corner, too few taxels, no
# contact, or an invalid frame that no surface can make
SurfaceKind = Literal["smooth", "edge", "corner", "insufficient", "miss", "invalid"]
# Fault of a frame: none; pressed without a signal; compression below 0 or above the pad's
# thickness; most taxels saturated; the frame of an earlier touch
FrameFault = Literal["none", "dead", "impossible", "saturated", "frozen"]


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TouchHeader:
    """Fields that all messages of one touch share, from the tactile frame to the patch."""

    goal: Count  # Number of the contour or probe that the touch belongs to
    touch: Count  # Counts up by one within the goal
    finger: Count  # The finger that touched, from 1
    placement: Count = 0  # Number of turns of the object before it
    direction: Direction  # Direction across the contour, world frame
    pose: Pose  # Believed pose of the pad: its z axis points into the object
    outcome: Outcome  # How the guarded move ended
    robot_time: Seconds  # Robot time at the end of the touch


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TactileFrame(TouchHeader):
    """One raw frame, taken at the end of a guarded move. On ``/touch/raw``."""

    # Times of flight or forces, as the SensorInfo says. Row i lies at y = (i - (rows - 1) / 2) *
    # pitch
    array: SignalImage
    move: MoveParts = field(default_factory=no_move)  # Parts of the move before it


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SequenceEnd:
    """No more frames will come. Driver to collector on ``/touch/end``."""

    frames: Count  # Frames published
    robot_time: Seconds  # Robot time of the last of them


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TactileImage(TouchHeader):
    """One calibrated and filtered frame. On ``/touch/image``."""

    advance: Metres = 0.0  # Length of the guarded move along the pad's z axis
    compression: LengthImage  # Compression of the pad under each taxel
    mask: Mask  # Where the pad touches
    impulses: Count  # Number of taxels with impulses, which were replaced or left out
    fault: FrameFault = "none"  # Fault of the frame; then no taxel is marked as touched


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SurfacePatch(TouchHeader):
    """The piece of surface under one touch. On ``/touch/patch``."""

    advance: Metres = 0.0  # Length of the guarded move along the pad's z axis
    height: LengthImage  # Surface over the plane of the pad's face, pad frame; 0 where untouched
    mask: Mask  # Where the pad touches
    # Surface under the touched taxels, world frame; those whose normal is unknown are left out
    points: Points
    normals: Directions  # Outward unit normals at these points
    # Coefficients of the local jet over x and y in units of `jet_scale`; m; maybe empty
    jet: Numbers
    jet_scale: Metres  # Length by which the jet's coordinates are divided
    normal: Direction  # Outward unit normal at the middle of the contact, world frame
    normal_error: Radians  # Its standard error
    k1: PerMetre  # Largest principal curvature; convex is positive. 0 unless `kind` is smooth
    k2: PerMetre  # Smallest principal curvature. 0 unless `kind` is smooth
    k1_error: PerMetre  # Standard error of `k1`; 0 unless `kind` is smooth
    k2_error: PerMetre  # Standard error of `k2`; 0 unless `kind` is smooth
    # Unit tangent in which the curvature is `k1`, world frame; its sign means nothing. 0 unless
    # `kind` is smooth
    principal_direction: Direction
    umbilic: bool  # Whether `k1` and `k2` are too similar for a principal direction
    curvature_across: PerMetre  # Normal curvature along `direction`. 0 unless `kind` is smooth
    curvature_across_error: PerMetre  # Its standard error; 0 unless `kind` is smooth
    kind: SurfaceKind  # Kind of the surface
    fault: FrameFault = "none"  # Reason why it is `invalid`; ``saturated`` if its top is cut off
    # From 0 to 1: share of the taxels that touch, damped by the misfit of the jet
    confidence: Ratio
    residual: Metres  # Root mean square misfit of the jet
