"""A taxel sees an area, not a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, get_args

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plugins import Range, check_ranges
from palpate.core.poses import split_pose
from palpate.core.touch.pad import GuardedMove, Pad, TouchOutcome, started_inside
from palpate.core.touch.pipeline import Fingertip, Phase, SimulatedTouch, Stage, record_move

Reading = Literal["mean", "max"]  # What an element makes of the compression under it


@dataclass(frozen=True, slots=True, kw_only=True)
class Aperture:
    """Each element looks along a square grid of rays, and reports their mean or their largest.

    ``c = mean(max(a - g, 0))`` or ``max(max(a - g, 0))``, with the gaps ``g`` under its area and
    the way ``a``. The move stops when the deepest element reports the asked depth, or earlier, as
    bottomed, where the pad is pressed to its saturation at any ray. A touched element is indented
    by what it reports; a free one is as far away as its nearest ray. It matters for features
    smaller than the pitch, which a single ray sees wholly or not at all.
    """

    phase: ClassVar = Phase.CAST

    # Side of an element, as a share of the pitch: elements need a gap between them.
    width: Annotated[float, Range(0.05, 1.0, "1")] = 0.8
    # Rays along a side: three see what lies between two taxels at a bearable cost, that of nine
    # casts.
    rays: Annotated[int, Range(2, 8, "1")] = 3
    # The echo of an element's whole area is nearest to its mean; the first echo to arrive is that
    # of its largest compression.
    reading: Reading = "mean"

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.reading not in get_args(Reading):
            raise ValueError(f"reading is {self.reading!r}; expected mean or max")

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        pad, mean = finger.pad, self.reading == "mean"
        origins = _origins(pad, self.width, self.rays)

        def apply(touch: SimulatedTouch, state: None) -> None:
            record_move(finger, touch, _press(pad, origins, touch, mean))

        return Stage(apply)


def _origins(pad: Pad, width: float, rays: int) -> Floats:
    """Where the rays start in the pad's frame, (rows * cols * rays^2, 3), m.

    Those of one element stand together. The transducers follow the dome under every ray.
    """
    across = ((np.arange(rays) + 0.5) / rays - 0.5) * width * pad.pitch
    x, y = pad.grid()
    x, y = np.broadcast_arrays(
        x[:, :, None, None] + across[None, :], y[:, :, None, None] + across[:, None]
    )
    z = -(pad.thickness + 0.5 * pad.dome * (x * x + y * y))
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()])


def _press(pad: Pad, origins: Floats, touch: SimulatedTouch, mean: bool) -> GuardedMove:
    """The guarded move of `palpate.core.touch.guarded_move`, with elements for taxels."""
    size, limit = (pad.rows, pad.cols), pad.saturation * pad.thickness
    position, axes = split_pose(touch.actual)
    reach = pad.thickness + touch.reach + limit
    ranges = touch.shape.cast(origins @ axes.T + position, axes[:, 2], reach)
    gaps = ranges.reshape(pad.rows * pad.cols, -1) - pad.thickness
    first = gaps.min(axis=1)
    nearest = float(first.min())
    if nearest < 0.0:
        return started_inside(pad, touch.actual)
    wanted = _way_to_mean(gaps, touch.depth) if mean else nearest + touch.depth
    outcome: TouchOutcome = "miss"
    advance = touch.reach
    if nearest <= touch.reach:
        outcome = "hit" if wanted <= nearest + limit else "bottomed"
        advance = min(wanted, nearest + limit)
    deepest = advance - first
    compression = np.maximum(deepest, 0.0)
    if mean:
        compression = np.maximum(advance - gaps, 0.0).mean(axis=1)
        deepest = np.where(deepest > 0.0, compression, deepest)
    end = touch.actual.copy()
    end[:3] = position + advance * axes[:, 2]
    return GuardedMove(outcome, end, compression.reshape(size), advance, deepest.reshape(size))


def _way_to_mean(gaps: Floats, depth: float) -> float:
    """Way after which the first element's mean compression is `depth`.

    A mean ``sum(max(a - g, 0)) / n`` is the largest of the lines ``(k a - g1 - ... - gk) / n`` over
    k, with the gaps in order; so the way to `depth` is the smallest of theirs.
    """
    count = gaps.shape[1]
    sums = np.sort(gaps, axis=1).cumsum(axis=1)
    return float(((count * depth + sums) / np.arange(1, count + 1)).min())
