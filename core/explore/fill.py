"""Gaps between felt points: each is probed in its middle until it is closed or known to stay."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.aim import DEEP_PRESS, UPRIGHT, Stance
from palpate.core.explore.creep import creeping
from palpate.core.explore.cut import Cut
from palpate.core.explore.felt import Felt
from palpate.core.explore.path import Gap, Path, Why, heading_across, path_of
from palpate.core.explore.routine import Routine
from palpate.core.explore.seek import Target, seek

STANDOFF, REACH = 6.0 / 15.0, 8.0 / 15.0
"""Ways of a probe before and past the gap's chord, in widths of the pad; longer gaps are probed
from as far away as they are long."""
WITHIN = 0.25 / 15.0
"""A point in the gap lies this far from both of its ends, in widths of the pad."""
SHORTER = 0.25
"""A probe that leaves a gap shorter by less than this many pitches has not helped."""


def fill(cut: Cut, chain: Path, stance: Stance) -> Routine[tuple[Path, tuple[Gap, ...]]]:
    """Probe every gap between neighbouring points of a chain.

    Parameters
    ----------
    cut : Cut
        The slice and the pad.
    chain : Path
        Points in the order of travel, its gaps not yet probed.
    stance : Stance
        How the pad was held at the chain's end.

    Returns
    -------
    The chain with what was felt between its points, and the gaps that remain.
    """
    gaps: list[Gap] = []
    last = len(chain.points) - 1
    while last > 0:  # from the end, so that what is put in moves no gap that is still to come
        ends = chain.part(slice(last - 1, last + 1))
        start, end = ends.points
        if np.linalg.norm(end - start) <= cut.joined:
            last -= 1
            continue
        between, why = yield from _probe(cut, ends, stance)
        if between is None:
            gaps.append(Gap(start, end, why))
            last -= 1
            continue
        before, after = chain.part(slice(None, last)), chain.part(slice(last, None))
        chain = before.joined(between).joined(after)
        last += len(between.points)
    return chain, tuple(reversed(gaps))


def _probe(cut: Cut, ends: Path, stance: Stance) -> Routine[tuple[Path | None, Why]]:
    """What is felt between two points: by a plain touch, a deep one, by the pad's edges."""
    start, end = ends.points
    deep = UPRIGHT._replace(tilt=stance.tilt, shift=stance.shift, depth=DEEP_PRESS)
    chord = end[:2] - start[:2]
    length = float(np.linalg.norm(chord))
    target = Target(
        start[:2] + 0.5 * chord,
        heading_across(chord),
        max(STANDOFF * cut.width, length),
        max(REACH * cut.width, length),
    )
    felt, _ = yield from seek(cut, stance, target)
    between = _between(cut, start, end, felt)
    if felt is None or between is not None:
        return between, "missed"
    for aim in (target.aim(deep), *creeping(cut, ends.points, ends.normals)):
        felt = yield aim
        between = _between(cut, start, end, felt)
        if between is not None:
            break
    return between, "bridged"


def _between(cut: Cut, start: Floats, end: Floats, felt: Felt | None) -> Path | None:
    """The part of an arc that lies in a gap, if it shortens the gap."""
    if felt is None or not len(felt.points):
        return None
    chord = end[:2] - start[:2]
    length = float(np.linalg.norm(chord))
    along = (felt.points[:, :2] - start[:2]) @ chord / length
    inside = (along > WITHIN * cut.width) & (along < length - WITHIN * cut.width)
    if not inside.any():
        return None
    arc = path_of(felt).part(inside)
    ways = np.diff(np.concatenate([start[None], arc.points, end[None]]), axis=0)
    longest = float(np.linalg.norm(ways, axis=1).max())
    whole = float(np.linalg.norm(end - start))
    return arc if longest < whole - SHORTER * cut.pad.pitch else None
