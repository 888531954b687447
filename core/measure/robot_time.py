"""What a touch costs a robot: the time of one guarded move."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

from palpate.core.arrays import positive


@dataclass(frozen=True, slots=True, kw_only=True)
class Preset:
    """How fast an arm is.

    Raises
    ------
    ValueError
        If a speed or the acceleration is not positive, or a duration is negative.
    """

    speed: float
    """Of free travel, m/s."""
    acceleration: float
    """Of free travel, m/s2."""
    turning: float
    """Speed of reorientation, rad/s."""
    approach: float
    """Speed towards the surface, m/s."""
    retract: float
    """Speed away from it, m/s."""
    dwell: float
    """Rest in contact, s."""
    overhead: float
    """Of each of the two commands of a touch, s."""

    def __post_init__(self) -> None:
        units = {"acceleration": "m/s2", "turning": "rad/s", "dwell": "s", "overhead": "s"}
        for field in fields(self):
            value, unit = getattr(self, field.name), units.get(field.name, "m/s")
            if unit != "s":
                positive(field.name, value, unit)
            elif not 0.0 <= value < math.inf:
                raise ValueError(f"{field.name} must be finite and not negative, got {value} s")


PRESETS: Mapping[str, Preset] = {
    "modern": Preset(
        speed=0.1,
        acceleration=1.0,
        turning=math.radians(60),
        approach=0.01,
        retract=0.05,
        dwell=0.1,
        overhead=0.05,
    ),
    "puma": Preset(
        speed=0.05,
        acceleration=0.5,
        turning=math.radians(30),
        approach=0.005,
        retract=0.02,
        dwell=0.5,
        overhead=0.25,
    ),
}
"""``modern``: a collaborative arm. ``puma``: an arm of the 1990s. Both are assumptions."""


def touch_seconds(preset: Preset, travel: float, turn: float, approach: float) -> float:
    """Robot time of one guarded move: `free_seconds` and then `contact_seconds`."""
    return free_seconds(preset, travel, turn) + contact_seconds(preset, approach)


def free_seconds(preset: Preset, travel: float, turn: float) -> float:
    """Robot time from one start pose to the next, travelling and turning together.

    Parameters
    ----------
    preset : Preset
        The arm.
    travel : float
        Way from the last start pose to this one, m.
    turn : float
        Angle between the two, rad.

    Raises
    ------
    ValueError
        If the way or the angle is negative or not finite.
    """
    _check("travel", travel, "m")
    _check("turn", turn, "rad")
    return max(_travel_seconds(preset, travel), turn / preset.turning)


def contact_seconds(preset: Preset, approach: float) -> float:
    """Robot time of a move to the surface and back: approach, rest, retreat, two commands.

    Parameters
    ----------
    preset : Preset
        The arm.
    approach : float
        Way from the start pose to the end of the touch, m; the finger goes back as far.

    Raises
    ------
    ValueError
        If the way is negative or not finite.
    """
    _check("approach", approach, "m")
    there_and_back = approach / preset.approach + approach / preset.retract
    return there_and_back + preset.dwell + 2.0 * preset.overhead


def _check(name: str, value: float, unit: str) -> None:
    if not 0.0 <= value < math.inf:
        raise ValueError(f"{name} must be finite and not negative, got {value} {unit}")


def _travel_seconds(preset: Preset, distance: float) -> float:
    """From rest to rest, with a trapezoid of speed, or a triangle if it is short."""
    if distance >= preset.speed**2 / preset.acceleration:
        return distance / preset.speed + preset.speed / preset.acceleration
    return 2.0 * math.sqrt(distance / preset.acceleration)
