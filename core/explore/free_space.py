"""What is known of the space about an object: free, touched, or nothing.

A map of even voxels over all that a finger reaches. A guarded move frees what the face of the pad
has swept; where it touched, the voxels are touched, and what was touched once is never freed again,
for poses err. The rest is unknown, the inside of the object with it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Bools, Floats
from palpate.core.poses import Pose
from palpate.core.touch import Pad

UNKNOWN, FREE, TOUCHED = 0, 1, 2  # States of a voxel
VOXEL = 2.5e-3  # Edge of one, m: a sixth of a pad
MAX_VOXELS = 8 << 20  # Of a map: each takes a byte in a message, and 50 while free ones are listed
MARGIN = 1.5  # Voxels before a contact that stay unknown: poses err, and pads are pressed
PRESSED = 1.5e-3  # By how much, m
VALLEY = math.radians(20.0)  # Between normals to both sides of what holds a pad off as a valley
STEEPEST = 0.9  # Sine of half the largest angle between them that is taken at its word
EVERY = 2  # Taxels along rows and columns: places of the face that are swept
States = NDArray[np.uint8]
Longs = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class SpaceMap:
    """A three-state map."""

    low: Floats  # Place of the first voxel's middle, (3,), m
    step: float  # Edge of a voxel, m
    states: States  # (a, b, c)

    def numbers(self, places: Floats) -> Longs:
        """Numbers (k,) of the voxels that hold places (n, 3), each once; none beyond the map."""
        at = np.round((places - self.low) / self.step).astype(np.int64)
        at = at[((at >= 0) & (at < self.states.shape)).all(axis=1)]
        return np.unique(np.ravel_multi_index(tuple(at.T), self.states.shape))

    def marked(self, free: Longs, touched: Longs) -> SpaceMap:
        """With voxels, by their numbers, that are free or touched; touched is what was both."""
        states = self.states.copy()
        flat = states.reshape(-1)
        flat[free] = np.maximum(flat[free], FREE)
        flat[touched] = TOUCHED
        return replace(self, states=states)

    def free_places(self) -> Floats:
        """Middles of the free voxels, (k, 3), m."""
        return np.argwhere(self.states == FREE) * self.step + self.low


def empty_map(
    reach: float, platform: float, centre: Sequence[float] = (0.0, 0.0), step: float = VOXEL
) -> SpaceMap:
    """A map of all that a finger reaches, so far sideways of `centre` and up from platform, m.

    Voxels are larger than `step` where the map would have more than `MAX_VOXELS`.
    """
    step = max(step, reach * (4.0 / MAX_VOXELS) ** (1.0 / 3.0))
    low = np.array([centre[0] - reach, centre[1] - reach, platform])
    shape = [int(np.ceil(side / step)) + 1 for side in (2.0 * reach, 2.0 * reach, reach)]
    return SpaceMap(low, step, np.zeros(shape, np.uint8))


def swept_places(pad: Pad, start: Pose, pose: Pose, step: float, *, touched: bool) -> Floats:
    """Places (n, 3) that the face of a pad has passed on its way, so close together, m.

    `start` and `pose`: before and after the move. `touched`: whether it met something.
    """
    position, axes = start
    length = float((pose.position - position) @ axes[:, 2])
    if touched:
        length -= MARGIN * step + PRESSED
    if length <= 0.0:
        return np.zeros((0, 3))
    ways = np.arange(0.0, length, 0.5 * step)
    x, y = (axis[::EVERY, ::EVERY].ravel() for axis in pad.grid())
    face = np.column_stack([x, y, -pad.sag()[::EVERY, ::EVERY].ravel()]) @ axes.T + position
    return np.asarray((face + ways[:, None, None] * axes[:, 2]).reshape(-1, 3))


def spanned_places(pad: Pad, pose: Pose, touched: Bools) -> Floats:
    """Places (n, 3) on the face of a pad that nothing touched, between others that were, m.

    What lies there behind the face is hollow. `pose`: of the pad. `touched` (rows, cols).
    """
    spanned = np.any([_before_and_after(touched, axis)[0] >= 0 for axis in (0, 1)], axis=0)
    return pose.to_outer(_face(pad)[spanned.ravel()])


class SpannedPlaces(NamedTuple):
    """Places on the face of a pad that nothing touched, between others that were, m."""

    openings: Floats  # Under which anything may be, (k, 3)
    valleys: Floats  # Between sides that lean towards each other and hold the pad off, (l, 3)
    # How deep the surface lies there if the sides go on, over the distance from them, (l,)
    slopes: Floats


def sorted_spans(
    pad: Pad, pose: Pose, touched: Bools, points: Floats, normals: Floats
) -> SpannedPlaces:
    """The spanned places of a touch, as `spanned_places`, by what may be under them.

    `points`, `normals` (k, 3): where the pad touched, m, and outwards there. To both sides of a
    valley normals lean towards each other, by over `VALLEY` in the mean of all its taxels, along
    rows or columns; what was touched all around is none.
    """
    from scipy.ndimage import binary_fill_holes, label, mean

    face = pose.to_outer(_face(pad))
    spanned, leaning = np.zeros_like(touched), np.zeros(touched.shape)
    for axis in (0, 1):
        before, after = _before_and_after(touched, axis)
        along = before >= 0
        found = _leaning(face[before[along]], face[after[along]], points, normals)
        leaning[along] = np.minimum(leaning[along], found)
        spanned |= along
    regions, count = label(spanned, np.ones((3, 3)))
    numbers = np.arange(1, count + 1)
    enclosed = mean(binary_fill_holes(touched) & ~touched, regions, numbers)
    sines = np.append(0.0, -0.5 * np.asarray(mean(leaning, regions, numbers)))  # of half the angle
    is_valley = (sines > math.sin(0.5 * VALLEY)) & (np.append(0.0, enclosed) == 0.0)
    valley = is_valley[regions]
    slopes = np.tan(np.arcsin(np.minimum(sines, STEEPEST)))[regions[valley]]
    return SpannedPlaces(face[(spanned & ~valley).ravel()], face[valley.ravel()], slopes)


def _before_and_after(touched: Bools, axis: int) -> tuple[Longs, Longs]:
    """Numbers (rows, cols) of the nearest touched taxels to both sides of those that are not.

    -1 for touched taxels, and where there is none to a side.
    """
    numbers = np.arange(touched.size).reshape(touched.shape)
    before = np.maximum.accumulate(np.where(touched, numbers, -1), axis=axis)
    flipped = np.flip(np.where(touched, numbers, touched.size), axis)
    after = np.flip(np.minimum.accumulate(flipped, axis=axis), axis)
    none = touched | (before < 0) | (after == touched.size)
    return np.where(none, -1, before), np.where(none, -1, after)


def _face(pad: Pad) -> Floats:
    """Places (rows * cols, 3) of the taxels, in the pad's frame, m."""
    x, y = pad.grid()
    return np.column_stack([x.ravel(), y.ravel(), -pad.sag().ravel()])


def _leaning(before: Floats, after: Floats, points: Floats, normals: Floats) -> Floats:
    """How far normals nearest to places to both sides, (n, 3) each, lean apart; to each other: < 0.

    As the difference of unit vectors along the way between the places, (n,).
    """
    if not len(before) or not len(points):
        return np.zeros(len(before))
    one, other = (
        normals[np.linalg.norm(side[:, None] - points, axis=2).argmin(axis=1)]
        for side in (before, after)
    )
    across = after - before
    along = np.einsum("ni,ni->n", other - one, across)
    return np.asarray(along / np.linalg.norm(across, axis=1))
