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
    raw = [
        ("/touch/raw", tactile_frame(SENSING, touch, 0.1 * touch, Pose(place, axes).array, image))
        for touch, (place, axes) in enumerate(places)
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
