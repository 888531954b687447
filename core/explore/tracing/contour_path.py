"""What procedures of tracing share: touch commands, the arc that a touch shows, the way so far.

Procedures touch, wait and go on: they are written as generators and run as pure functions. A
procedure yields what it wants to touch and is sent what was touched. A generator cannot be a node's
state, for it cannot be copied or compared; so the state keeps what was touched since the procedure
began, and `resume` runs it again over that. Procedures are short, a few touches each.

An arc is where the surface touched by one pad meets the slice: one point in each column of taxels,
and column by column the band of heights that was touched without a break beside it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Generic, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.poses import Pose, pad_rotation
from palpate.core.touch import Jet, Pad

JOINED = 2.0 / 15.0  # Points farther apart than this have a gap between them; in widths of the pad
LEAST_JOINED = 1.6  # But points of neighbouring taxels never have; in pitches
# Depth of a plain touch, m: half of the pad. Shallower ones touch less at once: at 1 mm a contour
# takes a fifth more touches, and a band is lower by as much.
TOUCH_DEPTH = 1.5e-3
DEEP_TOUCH_DEPTH = 2.35e-3  # Depth where a plain one does not reach into a hollow, m
MOST_TILT = 1.45  # The pad is tilted no farther than this, rad: at a pole a contour has no heading
Result = TypeVar("Result")
# The pad touched beside the stretch, or over it, but not in it; or it touched nothing there.
GapReason = Literal["bridged", "missed"]
LEAST_POINTS = 10  # Fewer points have no winding
# Lengths of the path's end to which a parabola is fitted, the first whose fit is good; in widths of
# the pad.
WINDOWS = (7.0 / 15.0, 3.2 / 15.0)
# Points that belong to the path's end; near its closing the start lies within the window too.
LONGEST_TAIL = 40
GOOD_FIT = 4.0e-3  # A parabola within this of the points is good; in widths of the pad
CURVATURES = (-3.0, 7.5)  # Bounds of the path's curvature, in 1 / widths of the pad
LEVEL_NORMAL = 0.2  # A normal whose level part is shorter than this has no azimuth
ALIKE = 0.8  # Cosine of the angle within which the measured normal and the parabola must agree
CLOSE = 0.997  # Where the parabola is good: beside an edge the normals are those of two faces
NEIGHBOURS = 8  # Pairs of taxels that tell the slope nearest to the slice
LEAN = 0.36  # Slope to assume where only an edge of the pad touches: 20 degrees
Indices = NDArray[np.intp]
STEEP = 2.0  # Two neighbouring taxels on one surface differ by less than this many pitches
# First row, counted from the one before the slice, and number of rows that a polynomial goes
# through: the first window of which all rows are touched.
SLICE_ARC_WINDOWS = ((-1, 4), (-2, 4), (0, 4), (-1, 3), (0, 3), (0, 2))
MOST_ROWS = 4
# Columns with more than two rows that do without those that have two: a corner of the pad in a
# hollow has few of either.
AMPLE = 6
ROUNDS = 3  # Newton steps from the straight line's crossing: the next changes less than rounding


class SliceSpec(NamedTuple):
    """A slice, and the pad that follows it."""

    pad: Pad  # The array
    height: float  # Height of the slice in the slicing frame, m
    gap: float = 0.0  # Stretch of the contour that may stay untouched between two touches, m

    @property
    def width(self) -> float:
        """Width of the array, its smaller side, m."""
        return self.pad.pitch * (min(self.pad.rows, self.pad.cols) - 1)

    @property
    def joined(self) -> float:
        """Points that lie no farther apart than this follow each other, m."""
        return max(JOINED * self.width, LEAST_JOINED * self.pad.pitch) + 1.6 * self.gap


class Posture(NamedTuple):
    """How the pad is held; carried from touch to touch."""

    tilt: float = 0.0  # Elevation of the outward normal that the pad expects, rad
    shift: float = 0.0  # The contour lies this far from the pad's middle along its y axis, m
    depth: float = TOUCH_DEPTH  # Depth of press, m
    frozen: bool = False  # True once a search has found it: it is then kept for the contour
    failed_searches: int = 0  # Searches in a row that found none
    contact: float = math.inf  # Half the length of the arc that a searched posture touched first, m


class TouchCommand(NamedTuple):
    """One touch, in the slicing frame."""

    place: Floats  # Where the contour is expected, (2,), m
    heading: float  # Azimuth of the expected outward normal, rad
    standoff: float  # Distance before the place from which the pad starts, m
    reach: float  # How far past the place it may go, m
    posture: Posture  # How it is held

    def start(self, height: float) -> Pose:
        """Pose from which the pad moves, for a slice at this height."""
        axes = pad_rotation(self.heading, self.posture.tilt)
        target = np.array([self.place[0], self.place[1], height])
        target = target + self.posture.shift * axes[:, 1]
        return Pose(target - self.standoff * axes[:, 2], axes)

    @property
    def travel(self) -> float:
        """Longest way of the guarded move, m."""
        return self.standoff + self.reach


@dataclass(frozen=True, slots=True)
class ProcedureResult(Generic[Result]):
    """The end of a procedure."""

    result: Result


def resume(
    start: Callable[[], Procedure[Result]], arcs: Sequence[SliceArc | None]
) -> TouchCommand | ProcedureResult[Result]:
    """The next command of a procedure that has touched all this, or its end."""
    procedure = start()
    try:
        command = next(procedure)
        for one in arcs:
            command = procedure.send(one)
    except StopIteration as end:
        return ProcedureResult(end.value)
    return command


class Gap(NamedTuple):
    """A stretch between two points of a contour that could not be touched."""

    start: Floats  # Its last point before, (3,), m
    end: Floats  # The first one after, (3,), m
    reason: GapReason  # What the pad touched there

    @property
    def extent(self) -> float:
        """Distance between its ends, m."""
        return float(np.linalg.norm(self.end - self.start))


class Path(NamedTuple):
    """What has been traced so far, in the slicing frame."""

    points: Floats  # (n, 3), m
    normals: Floats  # (n, 3)
    across: Floats  # (n,), 1/m
    low: Floats  # Lowest height touched below each point, (n,), m
    high: Floats  # Highest height touched above it, (n,), m

    def joined(self, other: Path) -> Path:
        """Append another path."""
        return Path(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))

    def part(self, chosen: Bools | Ints | slice) -> Path:
        """Take some of its points."""
        return Path(*(field[chosen] for field in self))

    def with_bands_of(self, arc: SliceArc, near: float) -> Path:
        """Stretch the bands to what another touch has touched within `near` of the points, m."""
        if not len(arc.points):
            return self
        apart = np.linalg.norm(self.points[:, None, :2] - arc.points[None, :, :2], axis=2)
        met, nearest = apart.min(axis=1) < near, apart.argmin(axis=1)
        low = np.where(met, np.minimum(self.low, arc.low[nearest]), self.low)
        high = np.where(met, np.maximum(self.high, arc.high[nearest]), self.high)
        return self._replace(low=low, high=high)


def path_of(arc: SliceArc) -> Path:
    """The arc of a touch."""
    return Path(arc.points, arc.normals, arc.across, arc.low, arc.high)


def winding(points: Floats) -> float:
    """Angle swept about the middle of points (n, 3), rad; 0 for fewer than ten."""
    if len(points) <= LEAST_POINTS:
        return 0.0
    away = points[:, :2] - points[:, :2].mean(axis=0)
    angle = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    return float(angle[-1] - angle[0])


def normal_azimuth(chord: Floats) -> float:
    """Azimuth of the outward normal of a contour that runs along a chord (2,), rad."""
    return math.atan2(-chord[0], chord[1])


def travel_direction(normal_azimuth: float) -> Floats:
    """Direction of travel (2,) where the outward normal has this azimuth, rad."""
    return np.array([-math.sin(normal_azimuth), math.cos(normal_azimuth)])


class Heading(NamedTuple):
    """Where the path is going at its end."""

    tangent: Floats  # (2,) unit vector
    curvature: float  # 1/m, positive where the contour bulges outwards
    normal_azimuth: float  # Of the outward normal, rad, without jumps of a whole turn


def heading_at_end(path: Path, heading: float, width: float) -> Heading:
    """Direction and curvature of a path at its last point.

    A parabola is fitted to the path's end, or to less of it where that does not fit: a longer
    window would mix two faces. The measured normal, of azimuth `heading`, rad, is a better heading
    unless it contradicts the parabola. `width`: of the pad, m.
    """
    tangent = travel_direction(heading)
    curvature, good = 0.0, False
    end = path.points[-1]
    tail = path.points[-LONGEST_TAIL:]
    distance = np.linalg.norm(tail - end, axis=1)
    for window in WINDOWS:
        near = tail[distance < window * width][:, :2] - end[:2]
        if len(near) < 3:
            break
        tangent, curvature, misfit = _parabola(near)
        good = misfit < GOOD_FIT * width
        if good:
            break
    normal = path.normals[-1]
    level = math.hypot(normal[0], normal[1])
    if level > LEVEL_NORMAL:
        arc = np.array([-normal[1], normal[0]]) / level
        tangent = arc if arc @ tangent > (CLOSE if good else ALIKE) else tangent
    change = math.remainder(normal_azimuth(tangent) - heading, 2 * math.pi)
    least, most = (bound / width for bound in CURVATURES)
    # A parabola that bends as an edge does lies over one: its curvature is none of the face ahead.
    is_edge = not good and curvature > most
    bounded = 0.0 if is_edge else min(max(curvature, least), most)
    return Heading(tangent, bounded, heading + change)


def _parabola(near: Floats) -> tuple[Floats, float, float]:
    """Tangent at the end, curvature and largest misfit of points (n, 2) that end at 0."""
    centred = near - near.mean(axis=0)
    (xx, xy), (_, yy) = (centred.T @ centred).tolist()
    lean = 0.5 * math.atan2(2.0 * xy, xx - yy)  # of the scatter's long axis
    axis = np.array([math.cos(lean), math.sin(lean)])
    if axis @ (near[-1] - near[0]) < 0.0:
        axis = -axis
    along, outward = near @ axis, np.array([axis[1], -axis[0]])
    off = near @ outward
    if len(near) < 5:
        return axis, 0.0, math.inf
    basis = np.column_stack([along**2, along, np.ones(len(near))])
    coefficients = np.linalg.lstsq(basis, off, rcond=None)[0]
    tangent = axis + coefficients[1] * outward
    misfit = float(np.abs(basis @ coefficients - off).max())
    return tangent / np.linalg.norm(tangent), -2.0 * float(coefficients[0]), misfit


class SliceArc(NamedTuple):
    """One touch, in the slicing frame."""

    points: Floats  # The arc, (n, 3), in the direction of travel; empty if the slice was not met
    normals: Floats  # Outward unit normals along it, (n, 3)
    # Normal curvature across the contour along it, (n,), 1/m; convex is positive; 0 where the
    # surface is not smooth.
    across: Floats
    low: Floats  # Lowest height touched below each of its points without a break, (n,), m
    high: Floats  # Highest height touched above them, (n,), m
    # Slope of the surface against the pad along the pad's y axis, where it is nearest to the slice.
    slope: float
    nearest: Floats  # The touched point nearest to the slice in height, (3,)
    pad: Floats  # Middle of the pad's face, (3,)
    above: int  # Touched taxels above the slice
    below: int  # Touched taxels below it


def arc_in_slice(
    pad: Pad,
    pose: Pose,
    surface: Floats,
    touched: Bools,
    jet: Jet | None,
    height: float,
    smooth: bool = True,
) -> SliceArc | None:
    """Arc of a touched surface at a slice height.

    `pose`: pose of the pad in the slicing frame. `surface` (rows, cols): over the plane of the
    pad's face, m. `touched` (rows, cols) of bool. `jet`: the surface's jet; without one the pad's
    own normal stands in. `height`: of the slice, m. None if nothing is touched.
    """
    if not touched.any():
        return None
    position, axes = pose
    x, y = pad.grid()
    above = position[2] + axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * surface - height
    found = crossings(pad, above, surface, touched)
    low, high = contact_bands(above, same_surface(pad, surface, touched), found)
    local = found.places
    if len(local) and jet is not None:
        slope_x, slope_y = jet.slopes(local[:, 0], local[:, 1])
        curve = jet.second_derivatives(local[:, 0], local[:, 1])[2]
    else:
        slope_x = slope_y = curve = np.zeros(len(local))
    steepness = np.sqrt(1.0 + slope_x**2 + slope_y**2)
    outward = np.column_stack([slope_x, slope_y, -np.ones(len(local))]) / steepness[:, None]
    return SliceArc(
        points=local @ axes.T + position,
        normals=outward @ axes.T,
        across=curve / (steepness * (1.0 + slope_y**2)) * smooth,
        low=height + low,
        high=height + high,
        slope=float(np.median(slope_y)) if len(local) else _slope(pad, above, surface, touched),
        nearest=axes @ _nearest(pad, above, surface, touched) + position,
        pad=position,
        above=int((touched & (above > 0.0)).sum()),
        below=int((touched & (above < 0.0)).sum()),
    )


def crossings(pad: Pad, above: Floats, surface: Floats, touched: Bools) -> Crossings:
    """Where the surface meets the slice, at most once in each column.

    A straight line between two rows stands off by up to an eighth of the curvature times the pitch
    squared, 4 um on a ball of 30 mm; a cubic through four rows by less than 0.1 um.
    """
    x, y = pad.grid()
    meets = (above[:-1] <= 0.0) != (above[1:] <= 0.0)
    row, col = np.nonzero(meets & same_surface(pad, surface, touched))
    rows, window = _windows(touched, row, col)
    kept = window < len(SLICE_ARC_WINDOWS) - 1
    if kept.sum() >= AMPLE:  # without those that only a straight line goes through
        row, col, rows, window = row[kept], col[kept], rows[kept], window[kept]
    share = above[row, col] / (above[row, col] - above[row + 1, col])
    # Coefficients (n, 4) along the rows, 0 at the row before the slice.
    rise, depth = (
        np.einsum("nij,nj->ni", _OF_WINDOW[window], field[rows, col[:, None]])
        for field in (above, surface)
    )
    straight = share
    for _ in range(ROUNDS):
        value, slope = _values(rise, share)
        share = share - value / np.where(slope == 0.0, 1.0, slope)
    share = np.where((share >= 0.0) & (share <= 1.0), share, straight)
    up = y[row, col] + share * pad.pitch
    found = np.column_stack([x[row, col], up, _values(depth, share)[0]])
    order = np.lexsort((np.abs(found[:, 1]), col))
    first = np.ones(len(found), bool)
    first[1:] = np.diff(col[order]) > 0
    chosen = order[first]
    return Crossings(found[chosen], row[chosen], col[chosen])


def same_surface(pad: Pad, surface: Floats, touched: Bools) -> Bools:
    """Whether two neighbouring rows touch one surface, (rows - 1, cols)."""
    level: Bools = np.abs(surface[1:] - surface[:-1]) < STEEP * pad.pitch
    return touched[:-1] & touched[1:] & level


def _windows(touched: Bools, row: Indices, col: Indices) -> tuple[Indices, Indices]:
    """Rows (n, 4) of each crossing's polynomial, and the number of its window (n,)."""
    last = len(touched) - 1
    window = np.full(len(row), len(SLICE_ARC_WINDOWS) - 1)
    for number in reversed(range(len(SLICE_ARC_WINDOWS) - 1)):
        begin, count = SLICE_ARC_WINDOWS[number]
        wanted = row[:, None] + begin + np.arange(count)
        inside = (wanted >= 0) & (wanted <= last)
        whole = (inside & touched[np.clip(wanted, 0, last), col[:, None]]).all(axis=1)
        window[whole] = number
    begins = np.array([begin for begin, _ in SLICE_ARC_WINDOWS])[window]
    return np.clip((row + begins)[:, None] + np.arange(MOST_ROWS), 0, last), window


def _values(polynomials: Floats, share: Floats) -> tuple[Floats, Floats]:
    """Values and slopes (n,) of polynomials (n, 4) at places (n,)."""
    a, b, c, d = polynomials.T
    return a + share * (b + share * (c + share * d)), b + share * (2.0 * c + share * 3.0 * d)


def contact_bands(above: Floats, one_surface: Bools, met: Crossings) -> tuple[Floats, Floats]:
    """Lowest and highest height touched without a break from where columns meet the slice.

    Only touched taxels count: of a domed pad's face the edge often hangs free. Returns `low`,
    `high` (n,): heights over the slice, m: 0 or less, 0 or more.
    """
    breaks = np.cumsum(~one_surface, axis=0)
    stretch = np.vstack([np.zeros_like(breaks[:1]), breaks])[:, met.columns]
    unbroken = stretch == stretch[met.rows, np.arange(len(met.rows))]
    heights = np.where(unbroken, above[:, met.columns], 0.0)
    return heights.min(axis=0), heights.max(axis=0)


def _slope(pad: Pad, above: Floats, surface: Floats, touched: Bools) -> float:
    """Slope along y at the touched rows nearest to the slice, which was not met."""
    both = touched[:-1] & touched[1:]
    if both.sum() < 2:
        return -math.copysign(LEAN, float(pad.grid()[1][touched].mean()))
    away = np.abs(above[1:] + above[:-1])[both]
    rise = (surface[1:] - surface[:-1])[both] / pad.pitch
    return float(np.median(rise[np.argsort(away, kind="stable")[:NEIGHBOURS]]))


def _nearest(pad: Pad, above: Floats, surface: Floats, touched: Bools) -> Floats:
    """The surface's point (3,) nearest to the slice in height, pad frame, m."""
    return pad.surface_point(surface, int(np.where(touched, np.abs(above), np.inf).argmin()))


def deepest_point(pad: Pad, surface: Floats, touched: Bools) -> Floats:
    """The surface's point (3,) under the most compressed taxel, pad frame, m."""
    pressed = np.where(touched, -(surface + pad.sag()), -np.inf)
    return pad.surface_point(surface, int(pressed.argmax()))


class Crossings(NamedTuple):
    """Where columns meet the slice, in their order."""

    places: Floats  # Pad frame, (n, 3), m
    rows: Indices  # The row before each, (n,)
    columns: Indices  # Its column, (n,)


def _coefficients(first: int, count: int) -> Floats:
    """What gives a polynomial's coefficients from its values on the rows, (4, 4)."""
    nodes = first + np.arange(count)
    matrix = np.zeros((MOST_ROWS, MOST_ROWS))
    matrix[:count, :count] = np.linalg.inv(np.vander(nodes, increasing=True).astype(float))
    return matrix


UPRIGHT = Posture()  # How the pad is held before anything is known
Procedure = Generator[TouchCommand, SliceArc | None, Result]
_OF_WINDOW = np.stack([_coefficients(*window) for window in SLICE_ARC_WINDOWS])
