"""The hand closes.

Every finger moves until it touches, and what their contacts tell is put together.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.grasp.hand import Hand, fingertip_starts
from palpate.core.poses import split_pose
from palpate.core.shapes import Shape
from palpate.core.touch import CONTACT, Pad, Pipeline, SimulatedTouch, StageStates, clean, fit_patch

GRASP_DEPTH = 1.0e-3  # Compression at which a finger stops, m
ACROSS: Floats = np.array([0.0, 1.0, 0.0])
ACROSS.setflags(write=False)


class Grasp(NamedTuple):
    """What a closing hand touched."""

    points: Floats  # Contacts (n, 3), m
    normals: Floats  # Outward unit normals, (n, 3)
    fingers: tuple[int, ...]  # Which finger made each contact, from 0; the palm is the last
    missed: int  # Fingers that closed on nothing, or that could not say what they touched
    blocked: int  # Fingers that did not move, as the platform or the object was in their way
    advance: float  # Longest way that a fingertip went, m


class Closing(NamedTuple):
    """When a hand closes, and how often it has done so before."""

    number: int  # Counts the hand's closings from 0; chooses the random draws
    begun: float  # Robot time at which it begins to close, s
    previous: float  # Robot time at which it had opened before, s


def close_hand(
    shape: Shape,
    fingers: Sequence[Pipeline],
    remembered: Sequence[StageStates],
    hand: Hand,
    pose: Floats,
    platform: float,
    closing: Closing,
) -> tuple[Grasp, tuple[StageStates, ...]]:
    """Close every finger until it touches.

    `fingers`, `remembered`: fingertips with the scene's effects, the palm last, and what each
    remembers. `hand`, `pose` (7,), `platform`: how wide it opens, where it is, and the platform's
    height, m. Returns the grasp, and what the fingertips remember next.
    """
    starts = fingertip_starts(hand, pose, platform)
    reaches = starts.reach.tolist()
    touches = [
        _touch(shape, start, reach, closing) if reach > 0.0 else None
        for start, reach in zip(starts.poses, reaches, strict=True)
    ]
    following = [
        states if touch is None else pipeline.simulate(touch, states)
        for pipeline, states, touch in zip(fingers, remembered, touches, strict=True)
    ]
    return _together(fingers, touches), tuple(following)


def _touch(shape: Shape, start: Floats, reach: float, closing: Closing) -> SimulatedTouch:
    return SimulatedTouch(
        shape=shape,
        number=closing.number,
        believed=start,
        actual=start,
        reach=reach,
        depth=GRASP_DEPTH,
        begun=closing.begun,
        previous=closing.previous,
    )


def _together(fingers: Sequence[Pipeline], touches: Sequence[SimulatedTouch | None]) -> Grasp:
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


def contact_of(pad: Pad, pose: Floats, compression: Floats, noise: float) -> Contact | None:
    """What a pressed fingertip tells of the surface, in the frame in which its pose is given.

    The deepest point, with the normal of the surface about it; None if nothing is touched.
    """
    cleaned = clean(pad, compression, noise, CONTACT, "auto")
    if not cleaned.touched.any():
        return None
    surface = pad.surface(cleaned.compression, cleaned.touched)
    patch = fit_patch(pad, surface, cleaned.touched, ACROSS, noise)
    position, axes = split_pose(pose)
    if patch.jet is not None and patch.kind == "smooth":
        return Contact(axes @ patch.place + position, axes @ patch.normal)
    x, y = pad.grid()
    row, col = np.unravel_index(
        int(np.where(cleaned.touched, cleaned.compression, -1.0).argmax()), surface.shape
    )
    deepest = np.array([x[row, col], y[row, col], surface[row, col]])
    return Contact(axes @ deepest + position, axes @ patch.normal)


class Contact(NamedTuple):
    """Where a fingertip touches."""

    point: Floats  # (3,), m
    normal: Floats  # Outward unit normal, (3,)
