"""Slices of known solids, traced: touches, accuracy, and gaps against what no pad can touch.

Seen along the pad's axis, an object is a field of depths. A rigid face that may stand anywhere
over it reaches down to the field's opening by that face; a pad that yields reaches so much
deeper as it can be compressed. So one cast answers for all places at which the pad may be put.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from palpate.bench.table import Row
from palpate.core import Bools, Floats, pad_rotation, pose_of, rotations_from_vectors, split_pose
from palpate.core.explore import tracing
from palpate.core.touch import HITS, Pad, fit_patch, guarded_move
from tests.studies.objects import HOLLOWS, TRACED_OBJECTS, TracedSolid

FLAT = Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
DOMED = Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=1.0 / 0.015, saturation=0.8)
PADS = {"flat": FLAT, "domed": DOMED}
WIDTHS = (5e-3, 40e-3)  # Of the narrowest and the widest array that are tried, m
SHARES = (-0.9, -0.6, -0.25, 0.0, 0.3, 0.6, 0.93)  # Heights of slices over half the object's
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
TRACING_SEEDS = 8
MOST_RMS, MOST_ERROR, NEAR = 10e-6, 50e-6, 1e-3
MOST_SLICE_TOUCHES = 150
CONTACT, BACK_OFF, APPROACH = 0.05e-3, 14e-3, 0.1
# Azimuths from which a stretch is touched, against the normal of its chord, rad.
TURNS = tuple(np.radians(np.arange(-75.0, 76.0, 12.5)).tolist())
TILTS = tuple(np.radians(np.arange(-60.0, 61.0, 30.0)).tolist())  # Elevations, rad
CELL = 0.75e-3  # Of the field, m
FINE = 0.1e-3  # Distance of the outline's points that are asked about, m
SEEN = 0.1e-3  # A point is seen that is as far away as the first thing in its way, m
FAR, PAST = 0.07, 0.01  # Rays begin this far before the stretch and end this far past it, m


class TouchNoise(NamedTuple):
    """What disturbs a touch: standard deviations."""

    place: float = 0.1e-3  # Of the pose on each axis, m
    turn: float = math.radians(0.05)  # Of the pose about each axis, rad
    taxel: float = 10e-6  # m


class SliceFigures(NamedTuple):
    """One slice, traced."""

    status: tracing.TraceStatus  # How it ended
    touches: int  # Touches made
    rms: float  # Distance of its points from the true slice, m
    worst: float  # The largest of them, m
    covered: float  # Share of the true slice within 1 mm of a point
    gaps: tuple[tracing.Gap, ...]


def tracing_rows(quick: bool) -> Iterator[Row]:
    """All figures of slices that are traced."""
    for pad in PADS:  # closed contours: touches and accuracy, without noise
        yield from _rows(f"smooth, {pad}", SMOOTH, PADS[pad], MOST_SMOOTH[pad])
    for name, pad, most in MOST:
        yield from _rows(f"{name}, {pad}", (name,), PADS[pad], most)
    yield from noisy_rows(quick)
    yield from hollow_rows(quick)
    yield from width_rows()


def _rows(title: str, names: Sequence[str], pad: Pad, most: int) -> Iterator[Row]:
    found = [trace_figures(TRACED_OBJECTS[name], share, pad) for name in names for share in SHARES]
    yield _touches(title, found, most)
    rms, worst = max(one.rms for one in found), max(one.worst for one in found)
    good = rms <= MOST_RMS and worst <= MOST_ERROR
    shown = f"{1e6 * rms:.1f}, {1e6 * worst:.0f} um"
    yield Row(f"{title}: worst rms, largest error", shown, "10, 50 um", good)
    covered = min(one.covered for one in found)
    yield Row(f"{title}: within 1 mm", f"{100 * covered:.1f} %", "100 %", covered > 0.9999)


def noisy_rows(quick: bool) -> Iterator[Row]:
    """The box with the noise of an arm and an old array."""
    seeds = 2 if quick else TRACING_SEEDS
    for name, pad in PADS.items():
        found = [
            trace_figures(TRACED_OBJECTS["box"], share, pad, TouchNoise(), seed)
            for share in SHARES[1:-1]
            for seed in range(seeds)
        ]
        yield _touches(f"box with noise, {name}", found, MOST_NOISY)


def _touches(title: str, found: Sequence[SliceFigures], most: int) -> Row:
    closed = sum(one.status == "closed" for one in found)
    touches = max(one.touches for one in found)
    shown, good = f"{closed} of {len(found)}, {touches}", closed == len(found) and touches <= most
    return Row(f"{title}: closed, most touches", shown, f"all, {most}", good)


def hollow_rows(quick: bool) -> Iterator[Row]:
    """Hollows that no pad can enter: gaps are as long as what no pose of the pad can touch."""
    for name, target in list(HOLLOWS.items())[:: 4 if quick else 1]:
        for kind, pad in PADS.items():
            found = trace_figures(target, 0.0, pad)
            off = max(
                (abs(gap.extent - unreachable_chord(target, pad, 0.0, gap)) for gap in found.gaps),
                default=0,
            )
            shown = f"{found.status}, {found.touches}, off by {1e3 * off:.1f} mm"
            honest = found.status == ("occluded" if found.gaps else "closed")
            yield Row(f"{name}, {kind}", shown, "within 1 mm", honest and off < NEAR)


def unreachable_chord(target: TracedSolid, pad: Pad, height: float, gap: tracing.Gap) -> float:
    """Chord of the longest stretch in a gap that no pose of the pad can touch, m; 0 for none."""
    points = _stretch(target.outline(height), gap)
    places = np.column_stack([points, np.full(len(points), height)])
    reached = np.zeros(len(points), bool)
    chord = points[-1] - points[0]
    heading = math.atan2(-chord[0], chord[1])
    for turn in TURNS:
        for tilt in TILTS:
            open_ = ~reached
            if open_.any():
                axes = pad_rotation(heading + turn, tilt)
                reached[open_] = _touched(target, pad, axes, places[open_])
    # The longest run of hidden points, to the points beside it.
    edges = np.diff(np.concatenate([[False], ~reached, [False]]).astype(np.int8))
    firsts, ends = (np.flatnonzero(edges == way).tolist() for way in (1, -1))
    last = len(points) - 1
    runs = zip(firsts, ends, strict=True)
    chords = (points[min(end, last)] - points[max(first - 1, 0)] for first, end in runs)
    return max((float(np.linalg.norm(chord)) for chord in chords), default=0.0)


def _stretch(outline: Floats, gap: tracing.Gap) -> Floats:
    """Points (n, 2) of an outline from a gap's start to its end."""
    first, last = (
        int(np.linalg.norm(outline - end[:2], axis=1).argmin()) for end in (gap.start, gap.end)
    )
    count = (last - first) % len(outline)
    if count > len(outline) // 2:  # on a steep wall the nearest points may change places
        first, count = last, len(outline) - count
    way = np.roll(outline, -first, axis=0)[: count + 1]
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1)))
    even = np.linspace(0.0, length[-1], max(int(length[-1] / FINE), 2))
    return np.column_stack([np.interp(even, length, one) for one in way.T])


def _touched(target: TracedSolid, pad: Pad, axes: Floats, points: Floats) -> Bools:
    """Which of some points (n, 3) a pad with these axes can touch, wherever it is put."""
    from scipy.ndimage import grey_dilation, grey_erosion, map_coordinates

    local = points @ axes
    y, x = (
        CELL * np.arange(-half, half + 1)
        for half in (int(0.5 * (n - 1) * pad.pitch / CELL) for n in (pad.rows, pad.cols))
    )
    # How far the face falls back behind its middle; the stubs know of whole numbers alone.
    face: Any = -np.asarray(0.5 * pad.dome * (y[:, None] ** 2 + x**2))
    margin = CELL * np.array(face.shape[::-1])
    low, high = local.min(axis=0)[:2] - margin, local.max(axis=0)[:2] + margin
    columns, rows = (np.arange(a, b, CELL) for a, b in zip(low, high, strict=True))
    starts = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    before = float(local[:, 2].min()) - FAR
    origins = np.concatenate([starts, local[:, :2]])
    origins = np.column_stack([origins, np.full(len(origins), before)])
    depth = before + target.shape.cast(origins @ axes.T, axes[:, 2], FAR + PAST)
    nothing = before + FAR + PAST
    field = np.minimum(depth[: len(starts)].reshape(len(rows), len(columns)), nothing)
    opened = grey_dilation(grey_erosion(field, structure=face), structure=face)
    cells = (local[:, 1::-1] - low[::-1]) / CELL
    floor = map_coordinates(opened, cells.T, order=1, mode="nearest")
    seen = np.abs(depth[len(starts) :] - local[:, 2]) < SEEN
    return np.asarray(seen & (local[:, 2] - floor <= pad.saturation * pad.thickness))


def width_rows() -> Iterator[Row]:
    """Narrow and wide arrays of 16 by 16."""
    for width in WIDTHS:
        for name, pad in PADS.items():
            dome = pad.dome * 15e-3 / width
            scaled = Pad(16, 16, width / 15, pad.thickness, dome, pad.saturation)
            names = ("sphere", "box", "superellipsoid")
            found = [trace_figures(TRACED_OBJECTS[one], 0.0, scaled) for one in names]
            closed = sum(one.status == "closed" for one in found)
            title = f"array of {1e3 * width:g} mm, {name}"
            yield Row(title, f"{closed} of {len(found)} closed", "all", closed == len(found))


def trace_figures(
    target: TracedSolid, share: float, pad: Pad, noise: TouchNoise | None = None, seed: int = 0
) -> SliceFigures:
    """Trace one slice and compare it with the truth."""
    from scipy.spatial import cKDTree

    height = share * target.half
    touch = simulated_finger(target, pad, height, noise, seed)
    trace = tracing.Trace(tracing.TraceGoal(height, np.zeros(2), APPROACH, MOST_SLICE_TOUCHES))
    while True:
        trace, status = tracing.next_command(pad, trace)
        if not isinstance(status, tracing.TouchCommand):
            break
        trace = tracing.after_touch(trace, touch(status))
    if trace.path is None:
        return SliceFigures(status, trace.touches, math.inf, math.inf, 0.0, trace.gaps)
    outline, points = target.outline(height), trace.path.points[:, :2]
    off = outline_distances(points, outline)
    near = cKDTree(points).query(outline)[0] <= NEAR
    ways = np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1)
    covered = float(ways[near].sum() / ways.sum())
    rms = float(np.sqrt((off**2).mean()))
    return SliceFigures(status, trace.touches, rms, float(off.max()), covered, trace.gaps)


def simulated_finger(
    target: TracedSolid, pad: Pad, height: float, noise: TouchNoise | None, seed: int = 0
) -> Callable[[tracing.TouchCommand], tracing.SliceArc | None]:
    """A finger that touches a solid and tells what it touches of one slice."""
    rng = np.random.default_rng(seed)

    def touch(aim: tracing.TouchCommand) -> tracing.SliceArc | None:
        believed = aim.start(height)
        pose, (place, axes) = believed.copy(), split_pose(believed)
        actual = believed
        if noise is not None:
            shift, turn = rng.standard_normal((2, 3))
            off = rotations_from_vectors(noise.turn * turn[None])[0]
            actual = pose_of(place + axes @ (noise.place * shift), axes @ off)
        end = guarded_move(target.shape, pad, actual, aim.travel, aim.posture.depth)
        if end.outcome == "inside" and aim.standoff < BACK_OFF:
            return touch(aim._replace(standoff=aim.standoff + BACK_OFF))
        if end.outcome not in HITS:
            return None
        pose[:3] = place + end.advance * axes[:, 2]
        spread = 0.0 if noise is None else noise.taxel
        compression = end.compression + spread * rng.standard_normal(end.compression.shape)
        touched = compression > CONTACT
        surface = pad.surface(compression, touched)
        patch = fit_patch(pad, surface, touched, axes[2], spread)
        smooth = patch.kind == "smooth"
        return tracing.arc_in_slice(pad, pose, surface, touched, patch.jet, height, smooth=smooth)

    return touch


def outline_distances(points: Floats, outline: Floats) -> Floats:
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
