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
from palpate.core.geometry import point_tree
from palpate.core.poses import Pose
from palpate.core.touch import Pad

UNKNOWN, FREE, TOUCHED = 0, 1, 2  # states of a voxel
MAX_VOXELS = 8 << 20  # of a map; one takes 1 byte in a message, and 50 while free ones are listed
States = NDArray[np.uint8]
Longs = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepSettings:
    """Which space a move of a pad frees."""

    voxel: float = 2.5e-3  # [m] edge of a voxel: a sixth of a pad
    below_margin: float = 10.0e-3  # [m] sideways around touched points, of places below the map
    contact_margin: float = 1.5  # [voxels] before a contact that stay unknown, as poses err
    max_indentation: float = 1.5e-3  # [m] the same, added: the pad is pressed by as much
    stride: int = 2  # [taxels] between the points of the face that sweep space


@dataclass(frozen=True, slots=True, eq=False)
class SpaceMap:
    """A three-state map."""

    low: Floats  # (3,) [m] middle of the first voxel
    step: float  # [m] edge of a voxel
    states: States  # (a, b, c)

    def numbers(self, places: Floats) -> Longs:
        """Numbers (k,) of the voxels that hold places (n, 3), each once; none beyond the map."""
        at = np.round((places - self.low) / self.step).astype(np.int64)
        at = at[((at >= 0) & (at < self.states.shape)).all(axis=1)]
        return np.unique(np.ravel_multi_index(tuple(at.T), self.states.shape))

    def marked(self, free: Longs, touched: Longs) -> SpaceMap:
        """The map with these voxels free or touched, by number; a voxel in both becomes touched."""
        states = self.states.copy()
        flat = states.reshape(-1)
        flat[free] = np.maximum(flat[free], FREE)
        flat[touched] = TOUCHED
        return replace(self, states=states)

    def below(self, points: Floats, settings: SweepSettings = SweepSettings()) -> Floats:
        """Places (k, 3) in two layers of voxels below the map, under points (n, 3) [m]."""
        margin = settings.below_margin
        low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
        x, y = (np.arange(low[axis], high[axis], self.step) for axis in (0, 1))
        heights = self.low[2] - self.step * np.array([1.0, 2.0])
        return np.stack(np.meshgrid(x, y, heights), axis=-1).reshape(-1, 3)

    def free_places(self) -> Floats:
        """Middles of the free voxels, (k, 3) [m]."""
        return np.argwhere(self.states == FREE) * self.step + self.low


def empty_map(
    reach: float,
    platform: float,
    centre: Sequence[float] = (0.0, 0.0),
    settings: SweepSettings = SweepSettings(),
) -> SpaceMap:
    """A map of all within `reach` [m]: to each side of `centre`, and up from the platform [m].

    Voxels are larger than `settings.voxel` where the map would have more than `MAX_VOXELS`.
    """
    step = max(settings.voxel, reach * (4.0 / MAX_VOXELS) ** (1.0 / 3.0))
    low = np.array([centre[0] - reach, centre[1] - reach, platform])
    shape = [int(np.ceil(side / step)) + 1 for side in (2.0 * reach, 2.0 * reach, reach)]
    return SpaceMap(low, step, np.zeros(shape, np.uint8))


def swept_places(
    pad: Pad,
    start: Pose,
    pose: Pose,
    step: float,
    *,
    touched: bool,
    settings: SweepSettings = SweepSettings(),
) -> Floats:
    """Places (n, 3) [m] that the face of a pad has passed in a move, half a `step` [m] apart.

    `start` and `pose`: before and after the move. `touched`: whether it ended in contact.
    """
    position, axes = start
    length = float((pose.position - position) @ axes[:, 2])
    if touched:
        length -= settings.contact_margin * step + settings.max_indentation
    if length <= 0.0:
        return np.zeros((0, 3))
    advances = np.arange(0.0, length, 0.5 * step)
    thinned = slice(None, None, settings.stride)
    x, y = (axis[thinned, thinned].ravel() for axis in pad.grid())
    face = np.column_stack([x, y, -pad.sag()[thinned, thinned].ravel()]) @ axes.T + position
    return np.asarray((face + advances[:, None, None] * axes[:, 2]).reshape(-1, 3))


def spanned_places(pad: Pad, pose: Pose, touched: Bools) -> Floats:
    """Places (n, 3) [m] of untouched taxels that lie between touched ones in a row or column.

    The surface is hollow there. `pose`: of the pad. `touched` (rows, cols): mask of taxels.
    """
    spanned = np.any([_before_and_after(touched, axis)[0] >= 0 for axis in (0, 1)], axis=0)
    return pose.to_outer(_face(pad)[spanned.ravel()])


@dataclass(frozen=True, slots=True)
class ValleySettings:
    """Which spanned places lie in a valley, by the angle between the normals on its two sides.

    That angle is 90 degrees at a right-angled step, and 0 around a bore in a plane.
    """

    min_angle: float = 20.0  # [deg] between the normals to both sides
    max_half_sine: float = 0.9  # largest sine of half that angle; larger ones are lowered to it
    reach: float = 3.0e-3  # [m] around spanned places, up to which a place is in the valley


class UntouchedPlaces(NamedTuple):
    """Places of untouched taxels of a pad whose other taxels touch; world frame [m]."""

    openings: Floats  # (k, 3) between touched taxels: the surface behind may have any depth
    valleys: Floats  # (l, 3) between two sides that lean towards each other and hold the pad off
    slopes: Floats  # (l,) depth of the valley if its sides continue, per distance from its sides
    hanging: Floats  # (h, 3) beside the contact: beyond an edge, or over the mouth of a hole

    def slopes_at(self, places: Floats, settings: ValleySettings = ValleySettings()) -> Floats:
        """Slopes (n,) of the nearest valleys at places (n, 3) [m]; 0 outside all valleys."""
        if not len(self.valleys):
            return np.zeros(len(places))
        distances, nearest = point_tree(self.valleys).query(places)
        return np.where(distances < settings.reach, self.slopes[nearest], 0.0)


def untouched_places(
    pad: Pad,
    pose: Pose,
    touched: Bools,
    points: Floats,
    normals: Floats,
    settings: ValleySettings = ValleySettings(),
    sweeps: SweepSettings = SweepSettings(),
) -> UntouchedPlaces:
    """Where a pad touched nothing: openings and valleys between contacts, and what hangs free.

    `points`, `normals` (k, 3): the contacts [m] and their outward normals. A connected region of
    spanned taxels is a valley if the mean angle between the normals to both sides of its taxels,
    along rows or columns, exceeds `min_angle`, and no part of it is enclosed by contact. Hanging
    taxels are thinned by the stride of `sweeps`.
    """
    from scipy.ndimage import binary_fill_holes, label, mean

    face = pose.to_outer(_face(pad))
    spanned, leaning = np.zeros_like(touched), np.zeros(touched.shape)
    for axis in (0, 1):
        before, after = _before_and_after(touched, axis)
        along = before >= 0
        sides = face[before[along]], face[after[along]]
        leaning[along] = np.minimum(leaning[along], _leaning(*sides, points, normals))
        spanned |= along
    regions, count = label(spanned, np.ones((3, 3)))
    numbers = np.arange(1, count + 1)
    enclosed = mean(binary_fill_holes(touched) & ~touched, regions, numbers)
    sines = np.append(0.0, -0.5 * np.asarray(mean(leaning, regions, numbers)))  # of half the angle
    min_sine = math.sin(0.5 * math.radians(settings.min_angle))
    is_valley = (sines > min_sine) & (np.append(0.0, enclosed) == 0.0)
    valley = is_valley[regions]
    slopes = np.tan(np.arcsin(np.minimum(sines, settings.max_half_sine)))[regions[valley]]
    hanging = np.zeros_like(touched)
    thinned = slice(None, None, sweeps.stride)
    hanging[thinned, thinned] = ~(touched | spanned)[thinned, thinned] & touched.any()
    kinds = (spanned & ~valley), valley, hanging
    openings, valleys, free = (face[kind.ravel()] for kind in kinds)
    return UntouchedPlaces(openings, valleys, slopes, free)


def _before_and_after(touched: Bools, axis: int) -> tuple[Longs, Longs]:
    """Numbers (rows, cols) of the nearest touched taxels before and after each untouched taxel.

    -1 at touched taxels, and where one of the two is missing.
    """
    numbers = np.arange(touched.size).reshape(touched.shape)
    before = np.maximum.accumulate(np.where(touched, numbers, -1), axis=axis)
    flipped = np.flip(np.where(touched, numbers, touched.size), axis)
    after = np.flip(np.minimum.accumulate(flipped, axis=axis), axis)
    none = touched | (before < 0) | (after == touched.size)
    return np.where(none, -1, before), np.where(none, -1, after)


def _face(pad: Pad) -> Floats:
    """Places (rows * cols, 3) of the taxels, in the pad's frame [m]."""
    x, y = pad.grid()
    return np.column_stack([x.ravel(), y.ravel(), -pad.sag().ravel()])


def _leaning(before: Floats, after: Floats, points: Floats, normals: Floats) -> Floats:
    """Difference (n,) of the normals on both sides, projected on the line between the sides.

    `before`, `after` (n, 3): places of the two sides [m]; the normal of each is that of the nearest
    of `points`. Negative where the normals lean towards each other.
    """
    if not len(before) or not len(points):
        return np.zeros(len(before))
    normals_before, normals_after = (
        normals[np.linalg.norm(side[:, None] - points, axis=2).argmin(axis=1)]
        for side in (before, after)
    )
    across = after - before
    along = np.einsum("ni,ni->n", normals_after - normals_before, across)
    return np.asarray(along / np.linalg.norm(across, axis=1))
