"""What is known of one end, and what the rule answers: a touch to make, or that it is enough.

All in the slicing frame. The rule itself thinks of upper ends alone: `turned_over` makes one of
a lower end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Floats, finite_array, not_negative, positive
from palpate.core.poses import FACING_DOWN, compose_poses, pose_of
from palpate.core.touch import HITS, TouchOutcome

End = Literal["upper", "lower"]
# What a touch is for: to find the end, to touch the face that closes it, or that one's edge.
ProbeReason = Literal["search", "face", "edge"]
OVER: Floats = pose_of(np.zeros(3), FACING_DOWN)  # The slicing frame, half a turn about its x axis
OVER.setflags(write=False)
LEAST_POINTS = 3


class SideContour(NamedTuple):
    """The usable contour nearest to the end."""

    points: Floats  # (n, 3), m, in order
    normals: Floats  # Outward unit normals, (n, 3)
    contact_low: Floats  # Lowest height touched below each point without a break, (n,), m
    contact_high: Floats  # Highest height touched above it


class ProbeCommand(NamedTuple):
    """A touch to make."""

    pose: Floats  # From which the pad moves along its z axis, (7,)
    reach: float  # Longest way, m
    reason: ProbeReason  # What it is for
    target: Floats  # Where the surface is expected, (3,), m


class StopProbing(NamedTuple):
    """No touch is worth its time."""

    reason: str  # Why, in a few words
    # Width of the largest stretch of the end that nobody touched, m; 0 where that is unknown.
    untouched: float


class ProbeResult(NamedTuple):
    """A touch that was made, and what came of it."""

    probing: ProbeCommand  # What was asked for
    outcome: TouchOutcome  # How it ended
    point: Floats  # Deepest point touched, (3,), m; of no meaning unless something was touched
    normal: Floats  # Outward normal at the middle of the contact, (3,)

    @property
    def touched(self) -> bool:
        """Whether it tells where the surface is."""
        return self.outcome in HITS


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class EndObservation:
    """All that the next touch of one end may depend on; lengths in m."""

    height: float  # Where the end is expected along the slicing axis
    deviation: float  # Standard deviation of that
    other: float  # Where the object's other end is
    radius: float  # Largest distance of the surface from the slicing axis that is expected
    width: float  # Of the pad
    tolerance: float  # What two heights may differ by and still be as good as one
    noise: float = 0.0  # Standard deviation of a touch's place
    # Whether the object stands on this end: nothing can be touched from beyond it.
    standing: bool = False
    contour: SideContour | None = None  # The contour nearest to it; None while there is none
    probes: tuple[ProbeResult, ...] = ()  # Touches made of this end, in their order

    def __post_init__(self) -> None:
        for name in ("radius", "width", "tolerance"):
            positive(name, getattr(self, name), "m")
        for name in ("deviation", "noise"):
            not_negative(name, getattr(self, name), "m")
        if not (math.isfinite(self.height) and math.isfinite(self.other)) or (
            self.height == self.other
        ):
            raise ValueError(
                f"height must be finite and differ from that of the other end {self.other} m, "
                f"got {self.height} m"
            )
        if self.contour is not None:
            _check_wall(self.contour)

    @property
    def hits(self) -> tuple[ProbeResult, ...]:
        """Touches that tell where the surface is."""
        return tuple(one for one in self.probes if one.touched)

    @property
    def allowed(self) -> float:
        """What two touched heights may differ by if the surface has but one."""
        return self.tolerance + NOISES * self.noise


NOISES = 3.0  # Standard deviations by which touches may differ


def turned_over(observation: EndObservation) -> EndObservation:
    """What is known of a lower end, as if it were an upper one."""
    contour = observation.contour
    if contour is not None:
        contour = SideContour(
            contour.points @ FACING_DOWN,
            contour.normals @ FACING_DOWN,
            -contour.contact_high,
            -contour.contact_low,
        )
    return replace(
        observation,
        height=-observation.height,
        other=-observation.other,
        contour=contour,
        probes=tuple(
            one._replace(
                probing=turned_command(one.probing),
                point=one.point @ FACING_DOWN,
                normal=one.normal @ FACING_DOWN,
            )
            for one in observation.probes
        ),
    )


def turned_command(probing: ProbeCommand) -> ProbeCommand:
    """A touch of the one end as one of the other."""
    return probing._replace(
        pose=compose_poses(OVER, probing.pose), target=probing.target @ FACING_DOWN
    )


def _check_wall(contour: SideContour) -> None:
    count = len(finite_array("contour.points", contour.points, (None, 3)))
    if count < LEAST_POINTS:
        raise ValueError(f"contour.points must be at least {LEAST_POINTS}, got {count}")
    finite_array("contour.normals", contour.normals, (count, 3))
    for name in ("contact_low", "contact_high"):
        finite_array(f"contour.{name}", getattr(contour, name), (count,))
