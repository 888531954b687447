"""Trace slices of known solids: touches, accuracy, gaps; all in one process."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.aim import Aim
from palpate.core.explore.felt import Felt, feel_slice
from palpate.core.explore.path import Gap
from palpate.core.explore.trace import Slice, Status, Trace, after_touch, next_aim
from palpate.core.frames import pose_of, split_pose
from palpate.core.rotation import rotations_of_vectors
from palpate.core.touch.curvature import feel_patch
from palpate.core.touch.pad import Pad, press
from palpate.launch.bench_row import Row, print_groups
from palpate.launch.tracing_objects import OBJECTS, Traced, dented, notched, wedged
from palpate.launch.tracing_reach import hidden

FLAT = Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
DOMED = Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=1.0 / 0.015, saturation=0.8)
PADS = {"flat": FLAT, "domed": DOMED}
WIDTHS = (5e-3, 40e-3)
"""Of the narrowest and the widest array that are tried, m."""
SHARES = (-0.9, -0.6, -0.25, 0.0, 0.3, 0.6, 0.93)
"""Heights of the slices, as shares of half the object's height."""
SMOOTH = ("sphere", "egg", "cylinder", "pear")
MOST_SMOOTH = {"flat": 20, "domed": 26}
MOST = (
    ("box", "flat", 35),
    ("box", "domed", 35),
    ("star", "domed", 30),
    ("superellipsoid", "flat", 48),
    ("superellipsoid", "domed", 48),
)
MOST_NOISY = 45
SEEDS = 8
HOLLOWS = {
    "slot 5 mm wide, 10 deep": notched(0.010, 0.0025),
    "slot 8 mm wide, 10 deep": notched(0.010, 0.004),
    "slot 10 mm wide, 20 deep": notched(0.020, 0.005),
    "slot 3 mm wide, 3 deep": notched(0.003, 0.0015),
    "wedge 10 mm wide, 6 deep": wedged(0.006, 0.005),
    "wedge 8 mm wide, 8 deep": wedged(0.008, 0.004),
    "dent 10 mm wide, 3 deep": dented(0.003, 0.005),
    "dent 12 mm wide, 5 deep": dented(0.005, 0.006),
}
"""By name; each is widest at its mouth."""
MOST_RMS, MOST_ERROR, NEAR = 10e-6, 50e-6, 1e-3
MOST_TOUCHES = 150
CONTACT, BACK_OFF, APPROACH = 0.05e-3, 14e-3, 0.1


class Noise(NamedTuple):
    """What disturbs a touch."""

    place: float = 0.1e-3
    """Of the pose on each axis, m."""
    turn: float = math.radians(0.05)
    """Of the pose about each axis, rad."""
    taxel: float = 10e-6
    """Of each taxel, m."""


class Figures(NamedTuple):
    """One slice, traced."""

    status: Status
    """How it ended."""
    touches: int
    """Touches made."""
    rms: float
    """Distance of its points from the true slice, m."""
    worst: float
    """The largest of them, m."""
    covered: float
    """Share of the true slice within 1 mm of a point."""


Feel = Callable[[Aim], Felt | None]


def tracing(quick: bool) -> Iterator[Row]:
    """Closed contours: touches and accuracy, without noise."""
    for pad in PADS:
        yield from _rows(f"smooth, {pad}", SMOOTH, PADS[pad], MOST_SMOOTH[pad])
    for name, pad, most in MOST:
        yield from _rows(f"{name}, {pad}", (name,), PADS[pad], most)


def noisy(quick: bool) -> Iterator[Row]:
    """The box with the noise of an arm and an old array."""
    seeds = 2 if quick else SEEDS
    for name, pad in PADS.items():
        found = [
            traced(OBJECTS["box"], share, pad, Noise(), seed)
            for share in SHARES[1:-1]
            for seed in range(seeds)
        ]
        yield _touches(f"box with noise, {name}", found, MOST_NOISY)


def hollows(quick: bool) -> Iterator[Row]:
    """Hollows that no pad can enter: gaps are as long as what no pose of the pad can feel."""
    for name, target in list(HOLLOWS.items())[:: 4 if quick else 1]:
        for kind, pad in PADS.items():
            found, gaps = followed(target, 0.0, pad)
            off = max((abs(gap.extent - hidden(target, pad, 0.0, gap)) for gap in gaps), default=0)
            said = f"{found.status}, {found.touches}, off by {1e3 * off:.1f} mm"
            honest = found.status == ("occluded" if gaps else "closed")
            yield Row(f"{name}, {kind}", said, "within 1 mm", honest and off < NEAR)


def widths(quick: bool) -> Iterator[Row]:
    """Narrow and wide arrays of 16 by 16."""
    for width in WIDTHS:
        for name, pad in PADS.items():
            scaled = pad.__class__(
                16, 16, width / 15, pad.thickness, pad.dome * 15e-3 / width, pad.saturation
            )
            found = [traced(OBJECTS[n], 0.0, scaled) for n in ("sphere", "box", "superellipsoid")]
            closed = sum(one.status == "closed" for one in found)
            title = f"array of {1e3 * width:g} mm, {name}"
            yield Row(title, f"{closed} of {len(found)} closed", "all", closed == len(found))


GROUPS = (tracing, noisy, hollows, widths)


def bench(*, quick: bool, echo: Callable[[str], None] = print) -> int:
    """Print the table; 0 if every demand is met, else 1."""
    return print_groups(GROUPS, quick=quick, echo=echo)


def traced(
    target: Traced, share: float, pad: Pad, noise: Noise | None = None, seed: int = 0
) -> Figures:
    """Trace one slice and compare it with the truth."""
    return followed(target, share, pad, noise, seed)[0]


def followed(
    target: Traced, share: float, pad: Pad, noise: Noise | None = None, seed: int = 0
) -> tuple[Figures, tuple[Gap, ...]]:
    """Trace one slice: how it compares with the truth, and its gaps."""
    from scipy.spatial import cKDTree

    height = share * target.half
    feel = finger(target, pad, height, noise, seed)
    trace = Trace(Slice(height, np.zeros(2), APPROACH, MOST_TOUCHES))
    while True:
        trace, status = next_aim(pad, trace)
        if not isinstance(status, Aim):
            break
        trace = after_touch(trace, feel(status))
    if trace.path is None:
        return Figures(status, trace.touches, math.inf, math.inf, 0.0), trace.gaps
    outline, points = target.outline(height), trace.path.points[:, :2]
    off = off_outline(points, outline)
    near = cKDTree(points).query(outline)[0] <= NEAR
    ways = np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1)
    covered = float(ways[near].sum() / ways.sum())
    rms = float(np.sqrt((off**2).mean()))
    figures = Figures(status, trace.touches, rms, float(off.max()), covered)
    return figures, trace.gaps


def finger(target: Traced, pad: Pad, height: float, noise: Noise | None, seed: int = 0) -> Feel:
    """A finger that touches a solid and says what it feels of one slice."""
    rng = np.random.default_rng(seed)

    def feel(aim: Aim) -> Felt | None:
        believed = aim.start(height)
        actual = believed if noise is None else _disturbed(believed, noise, rng)
        end = press(target.shape, pad, actual, aim.travel, aim.stance.depth)
        if end.outcome == "inside" and aim.standoff < BACK_OFF:
            return feel(aim._replace(standoff=aim.standoff + BACK_OFF))
        if end.outcome not in ("hit", "bottomed"):
            return None
        pose, (place, axes) = believed.copy(), split_pose(believed)
        pose[:3] = place + end.advance * axes[:, 2]
        spread = 0.0 if noise is None else noise.taxel
        compression = end.compression + spread * rng.standard_normal(end.compression.shape)
        touched = compression > CONTACT
        surface = np.where(touched, -(compression + pad.sag()), 0.0)
        patch = feel_patch(pad, surface, touched, axes[2], spread)
        return feel_slice(
            pad, pose, surface, touched, patch.jet, height, smooth=patch.kind == "smooth"
        )

    return feel


def off_outline(points: Floats, outline: Floats) -> Floats:
    """Distance (n,) of points (n, 2) from a closed polygon, m."""
    from scipy.spatial import cKDTree

    nearest = cKDTree(outline).query(points)[1]
    off = np.full(len(points), np.inf)
    for corner in (nearest - 1, nearest):
        start = outline[corner]
        way = outline[(corner + 1) % len(outline)] - start
        length = np.maximum(np.einsum("ni,ni->n", way, way), 1e-30)
        share = np.clip(np.einsum("ni,ni->n", points - start, way) / length, 0.0, 1.0)
        off = np.minimum(off, np.linalg.norm(points - start - share[:, None] * way, axis=1))
    return off


def _disturbed(pose: Floats, noise: Noise, rng: np.random.Generator) -> Floats:
    place, axes = split_pose(pose)
    shift, turn = rng.standard_normal((2, 3))
    return pose_of(
        place + axes @ (noise.place * shift),
        axes @ rotations_of_vectors(noise.turn * turn[None])[0],
    )


def _rows(title: str, names: Sequence[str], pad: Pad, most: int) -> Iterator[Row]:
    found = [traced(OBJECTS[name], share, pad) for name in names for share in SHARES]
    yield _touches(title, found, most)
    rms, worst = max(one.rms for one in found), max(one.worst for one in found)
    said = f"{1e6 * rms:.1f}, {1e6 * worst:.0f} um"
    yield Row(
        f"{title}: worst rms, largest error",
        said,
        "10, 50 um",
        rms <= MOST_RMS and worst <= MOST_ERROR,
    )
    covered = min(one.covered for one in found)
    yield Row(f"{title}: within 1 mm", f"{100 * covered:.1f} %", "100 %", covered > 0.9999)


def _touches(title: str, found: Sequence[Figures], most: int) -> Row:
    closed = sum(one.status == "closed" for one in found)
    touches = max(one.touches for one in found)
    return Row(
        f"{title}: closed, most touches",
        f"{closed} of {len(found)}, {touches}",
        f"all, {most}",
        closed == len(found) and touches <= most,
    )
