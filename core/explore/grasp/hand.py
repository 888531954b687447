"""A hand that closes: fingers towards its axis, and the palm along it.

The hand's own frame: its z axis points away from the palm, into what is grasped; the fingers
close towards the origin in the plane across it, evenly spread, and the palm comes from behind.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, positive
from palpate.core.frames import pad_rotation, pose_of, split_pose

MOST_FINGERS = 20
FINGERTIP = 8e-3
"""Half a fingertip's width, m: a finger stays this far above the platform."""
LEVEL = 1e-9
"""Slope below which a finger does not go down."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Hand:
    """How many fingers a hand has, and how wide it opens.

    Raises
    ------
    ValueError
        If it has no finger or more than 20, or the opening or the reach is not positive.
    """

    fingers: int = 5
    """Beside the palm."""
    opening: float = 0.12
    """Distance of fingertips and palm from the middle of the open hand, m."""
    reach: float = 0.12
    """Longest way of a fingertip, m."""

    def __post_init__(self) -> None:
        if not 1 <= self.fingers <= MOST_FINGERS:
            raise ValueError(f"fingers must be from 1 to {MOST_FINGERS}, got {self.fingers}")
        positive("opening", self.opening, "m")
        positive("reach", self.reach, "m")


class Paths(NamedTuple):
    """Ways of the fingertips of hands, and how far they may go."""

    starts: Floats
    """(hands, fingers + 1, 3), m; the palm is last."""
    along: Floats
    """Unit directions, (hands, fingers + 1, 3)."""
    reach: Floats
    """(hands, fingers + 1), m: 0 where the platform is in the way, and the finger stays open."""


class Starts(NamedTuple):
    """Where the fingertips of one hand start, and how far they may go."""

    poses: Floats
    """(fingers + 1, 7): each moves along its own z axis; the palm is last."""
    reach: Floats
    """(fingers + 1,), m: 0 where the platform is in the way, and the finger stays open."""


def paths(hand: Hand, places: Floats, axes: Floats, platform: float) -> Paths:
    """Ways of the fingertips of open hands.

    Parameters
    ----------
    hand : Hand
        Its geometry.
    places, axes : (hands, 3) and (hands, 3, 3) arrays
        Where hands are in the world, m, and how they are turned.
    platform : float
        Height of the platform, m: no fingertip starts or goes below it.
    """
    tips, turns = _in_hand(hand.fingers)
    starts = places[:, None] + hand.opening * np.einsum("hij,fj->hfi", axes, tips)
    along = np.einsum("hij,fj->hfi", axes, turns[:, :, 2])
    down = along[:, :, 2]
    room = starts[:, :, 2] - platform - FINGERTIP * np.sqrt(np.maximum(1.0 - down**2, 0.0))
    reach = np.where(down < -LEVEL, room / np.maximum(-down, LEVEL), math.inf)
    return Paths(starts, along, np.where(room > 0.0, np.clip(reach, 0.0, hand.reach), 0.0))


def fingertips(hand: Hand, pose: Floats, platform: float) -> Starts:
    """Fingertips of an open hand at a pose (7,): see `paths`."""
    place, axes = split_pose(pose)
    ways = paths(hand, place[None], axes[None], platform)
    turns = _in_hand(hand.fingers)[1]
    poses = [pose_of(at, axes @ turn) for at, turn in zip(ways.starts[0], turns, strict=True)]
    return Starts(np.stack(poses), ways.reach[0])


@cache
def _in_hand(fingers: int) -> tuple[Floats, Floats]:
    """Places (n, 3) of the fingertips in units of the opening, and how they are turned, (n, 3, 3).

    In the hand's frame; the palm is last.
    """
    around = 2.0 * math.pi * np.arange(fingers) / fingers
    places = np.column_stack([np.cos(around), np.sin(around), np.zeros(fingers)])
    turns = [pad_rotation(turn, 0.0) for turn in around.tolist()]
    return np.vstack([places, [[0.0, 0.0, -1.0]]]), np.stack([*turns, np.eye(3)])
