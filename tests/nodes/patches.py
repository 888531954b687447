"""What filter and curvature make of a driver's frames of a ball, with a flat pad."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.poses import Pose, pad_rotation
from palpate.nodes import curvature, filter
from palpate.nodes.runtime.testing import drive
from palpate.nodes.specs.frames import SensorParams, sensor_info, tactile_frame
from palpate.nodes.specs.sensors import PadSpec, SensorSpec

SENSING = SensorParams(sensor=SensorSpec(pad=PadSpec(radius=None)))
INFO = ("/touch/info", sensor_info(SENSING))
RADIUS, DEPTH = 0.012, 0.5e-3
SIDE = (np.arange(16) - 7.5) * 1e-3
IMPRINT = np.maximum(DEPTH - RADIUS + np.sqrt(RADIUS**2 - SIDE[:, None] ** 2 - SIDE**2), 0.0)
Patches = list[Any]


def patches_at(places: Iterable[tuple[Floats, Floats]], image: Floats = IMPRINT) -> Patches:
    """Patches of frames at places, each with axes of the pad."""
    return patches_of((Pose(place, axes), image, 0) for place, axes in places)


def patches_of(frames: Iterable[tuple[Pose, Floats, int]]) -> Patches:
    """Patches of frames: the pad's pose, what its taxels sent, and the object's placement."""
    raw = [
        ("/touch/raw", tactile_frame(SENSING, touch, 0.1 * touch, pose.array, image, placement))
        for touch, (pose, image, placement) in enumerate(frames)
    ]
    return drive(curvature.NODE, [INFO, *drive(filter.NODE, [INFO, *raw])])


@cache
def ball_patches(
    count: int, lowest: float = -1.0, centre: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> Patches:
    """Even touches of a ball, down to a height of its unit sphere."""
    heights = 1.0 - (1.0 - lowest) * (np.arange(count) + 0.5) / count
    axes = [pad_rotation(2.4 * n, float(np.arcsin(up))) for n, up in enumerate(heights)]
    return patches_at((np.array(centre) + (DEPTH - RADIUS) * one[:, 2], one) for one in axes)


# A block of 44 by 32 by 26 mm that stands on 0, one side of which leans and one edge is cut: planes
# by outward normals and distances from the middle, m.
LEANING, CUT = np.array([np.cos(0.4), 0.0, np.sin(0.4)]), np.array([0.0, 0.6, 0.8])
BLOCK_NORMALS = np.array([*np.eye(3), *-np.eye(3), LEANING, CUT])
BLOCK_OFFSETS = np.array([0.022, 0.016, 0.013, 0.022, 0.016, 0.013, 0.018, 0.016])
BLOCK_MIDDLE = np.array([0.0, 0.0, 0.013])


def block_frames(count: int, lies: Pose, placement: int = 0) -> list[tuple[Pose, Floats, int]]:
    """Even touches from all sides of a block that lies so, but for what it lies on."""
    heights = 1.0 - 2.0 * (np.arange(count) + 0.5) / count
    frames = []
    for number, height in enumerate(heights):
        ray = -pad_rotation(2.4 * number, float(np.arcsin(height)))[:, 2]
        reach = BLOCK_OFFSETS / np.maximum(BLOCK_NORMALS @ ray, 1e-9)
        place, outward = BLOCK_MIDDLE + reach.min() * ray, BLOCK_NORMALS[reach.argmin()]
        if (lies.axes @ outward)[2] < -0.9:
            continue
        across = np.cross(outward, [0.36, 0.48, 0.8])
        across /= np.linalg.norm(across)
        axes = np.column_stack([across, np.cross(-outward, across), -outward])
        pad = Pose(place - DEPTH * outward, axes)
        frames.append((lies @ pad, _imprint(pad), placement))
    return frames


def _imprint(pad: Pose) -> Floats:
    """How far the block compresses each taxel of a pad: rays enter it through its front planes."""
    x, y = np.meshgrid(SIDE, SIDE)
    taxels = pad.to_outer(np.stack([x, y, 0.0 * x], axis=-1).reshape(-1, 3)) - BLOCK_MIDDLE
    rate, over = BLOCK_NORMALS @ pad.axes[:, 2], taxels @ BLOCK_NORMALS.T - BLOCK_OFFSETS
    ways = -over / np.where(np.abs(rate) > 1e-9, rate, 1e-9)
    entry = np.where(rate < -1e-9, ways, -np.inf).max(axis=1)
    leaves = np.where(rate > 1e-9, ways, np.inf).min(axis=1)
    beside = (over[:, np.abs(rate) <= 1e-9] > 0.0).any(axis=1)
    depth = np.where((entry < leaves) & ~beside, -entry, 0.0)
    return np.asarray(np.maximum(depth, 0.0).reshape(x.shape))
