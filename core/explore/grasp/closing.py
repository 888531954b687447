"""The hand closes: every finger moves until it touches, and what that tells is put together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.grasp.contact import contact_of
from palpate.core.explore.grasp.hand import Hand, fingertips
from palpate.core.shapes.protocol import Shape
from palpate.core.touch.pipeline import Pipeline, States
from palpate.core.touch.touch import Touch

PRESS = 1.0e-3
"""Compression at which a finger stops, m."""


class Grasp(NamedTuple):
    """What a closing hand felt."""

    points: Floats
    """Contacts (n, 3), m."""
    normals: Floats
    """Outward unit normals, (n, 3)."""
    fingers: tuple[int, ...]
    """Which finger made each contact, from 0; the palm is the last."""
    missed: int
    """Fingers that closed on nothing, or that could not say what they touched."""
    blocked: int
    """Fingers that did not move, as the platform or the object was in their way."""
    advance: float
    """Longest way that a fingertip went, m."""


class Closing(NamedTuple):
    """When a hand closes, and how often it has done so before."""

    number: int
    """Counts the hand's closings from 0; chooses the random draws."""
    begun: float
    """Robot time at which it begins to close, s."""
    previous: float
    """Robot time at which it had opened before, s."""


def close_hand(
    shape: Shape,
    fingers: Sequence[Pipeline],
    remembered: Sequence[States],
    hand: Hand,
    pose: Floats,
    platform: float,
    closing: Closing,
) -> tuple[Grasp, tuple[States, ...]]:
    """Close every finger until it touches.

    Parameters
    ----------
    shape : Shape
        What stands there.
    fingers, remembered : sequences
        Fingertips with the scene's effects, the palm last, and what each remembers.
    hand, pose, platform : Hand, (7,) array, float
        How wide it opens, where it is, and the platform's height, m.
    closing : Closing
        When, and for which time.

    Returns
    -------
    The grasp, and what the fingertips remember next.
    """
    starts = fingertips(hand, pose, platform)
    reaches = starts.reach.tolist()
    touches = [
        _touch(shape, start, reach, closing) if reach > 0.0 else None
        for start, reach in zip(starts.poses, reaches, strict=True)
    ]
    following = [
        states if touch is None else pipeline.feel(touch, states)
        for pipeline, states, touch in zip(fingers, remembered, touches, strict=True)
    ]
    return _together(fingers, touches), tuple(following)


def _touch(shape: Shape, start: Floats, reach: float, closing: Closing) -> Touch:
    return Touch(
        shape=shape,
        number=closing.number,
        believed=start,
        actual=start,
        reach=reach,
        depth=PRESS,
        begun=closing.begun,
        previous=closing.previous,
    )


def _together(fingers: Sequence[Pipeline], touches: Sequence[Touch | None]) -> Grasp:
    contacts, which, missed, blocked, advance = [], [], 0, 0, 0.0
    for i, (pipeline, touch) in enumerate(zip(fingers, touches, strict=True)):
        if touch is None or touch.outcome == "inside":
            blocked += 1
            continue
        advance = max(advance, touch.advance)
        found = None
        if touch.outcome != "miss":
            pad = pipeline.finger.pad
            found = contact_of(pad, touch.believed, touch.reading, pipeline.noise)
        if found is None:
            missed += 1
            continue
        contacts.append(found)
        which.append(i)
    points = np.array([contact.point for contact in contacts]).reshape(-1, 3)
    normals = np.array([contact.normal for contact in contacts]).reshape(-1, 3)
    return Grasp(points, normals, tuple(which), missed, blocked, advance)
