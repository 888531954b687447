"""What procedures of tracing share: touch commands, the arc of a touch, and the traced path.

A procedure is a generator: it yields the touch that it wants and is sent the arc that was touched.
A generator cannot be a node's state, for it cannot be copied or compared. So the state keeps the
arcs since the procedure began, and `resume` runs the procedure again over them; a procedure makes
only a few touches.

An arc is where the surface touched by one pad meets the slice: one point for each column of taxels,
and for each point the band of heights that was touched without a break beside it.
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

Result = TypeVar("Result")
# "bridged": the pad touched beside the stretch or over it, not in it; "missed": it touched nothing.
GapReason = Literal["bridged", "missed"]
Indices = NDArray[np.intp]


@dataclass(frozen=True, slots=True, kw_only=True)
class TouchSettings:
    """How a pad may touch a slice, and which touched points follow each other."""

    deep_depth: float = 2.35e-3  # [m] of press, where a plain touch does not reach into a hollow
    max_tilt: float = 1.45  # [rad] of the pad; below a right angle: at a pole there is no heading
    max_spacing: float = 2.0 / 15.0  # [widths of the pad] of points without a gap between them
    min_spacing: float = 1.6  # [pitches] the same, at least
    gap_margin: float = 1.6  # [`SliceSpec.gap`] added to that spacing


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingSettings:
    """How direction and curvature of a path are fitted at its end."""

    # [widths of the pad] lengths of the path's end to which a parabola is fitted, until one fits.
    windows: tuple[float, ...] = (7.0 / 15.0, 3.2 / 15.0)
    max_points: int = 40  # last points that are used; with more, the start could be among them
    max_misfit: float = 4.0e-3  # [widths of the pad] largest residual of a parabola that fits
    min_curvature: float = -3.0  # [1 / widths of the pad] lower bound of the curvature
    max_curvature: float = 7.5  # [1 / widths of the pad] upper bound of the curvature
    min_level_normal: float = 0.2  # level part of a normal, below which it has no azimuth
    min_cosine: float = 0.8  # of parabola and measured tangent, above which the latter is used
    # The same where the parabola fits: normals beside an edge are those of two faces.
    min_cosine_of_fit: float = 0.997


@dataclass(frozen=True, slots=True, kw_only=True)
class ArcSettings:
    """How the arc of one touch is found."""

    max_depth_step: float = 2.0  # [pitches] between neighbouring taxels on one surface
    # With at least so many columns of more than two touched rows, those of two rows are left out. A
    # corner of the pad in a hollow has few of either.
    min_columns: int = 6
    newton_steps: int = 3  # from the crossing of the straight line; a fourth is below rounding
    n_slope_pairs: int = 8  # pairs of taxels nearest to a slice that was not met; median slope
    edge_slope: float = 0.36  # [1] assumed where only an edge of the pad touches: 20 degrees


class RowWindow(NamedTuple):
    """Rows that a polynomial goes through."""

    first: int  # counted from the row before the slice
    n_rows: int


# The first window whose rows are all touched is used.
ROW_WINDOWS = tuple(
    RowWindow(*rows) for rows in ((-1, 4), (-2, 4), (0, 4), (-1, 3), (0, 3), (0, 2))
)
N_ROWS = max(window.n_rows for window in ROW_WINDOWS)


class SliceSpec(NamedTuple):
    """A slice, and the pad that follows it."""

    pad: Pad
    height: float  # [m] of the slice in the slicing frame
    gap: float = 0.0  # [m] of the contour that may stay untouched between two touches
    touch: TouchSettings = TouchSettings()

    @property
    def width(self) -> float:
        """Width of the pad, its smaller side [m]."""
        return self.pad.pitch * (min(self.pad.rows, self.pad.cols) - 1)

    @property
    def max_spacing(self) -> float:
        """Largest distance of points that have no gap between them [m]."""
        touch = self.touch
        spacing = max(touch.max_spacing * self.width, touch.min_spacing * self.pad.pitch)
        return spacing + touch.gap_margin * self.gap


class Posture(NamedTuple):
    """How the pad is held; carried from touch to touch."""

    tilt: float = 0.0  # [rad] elevation of the outward normal that the pad expects
    shift: float = 0.0  # [m] of the contour from the pad's middle along the pad's y axis
    # [m] of press, half of the pad. Shallower ones touch less at once: at 1 mm a contour takes a
    # fifth more touches, and a band is lower by as much.
    depth: float = 1.5e-3
    is_kept: bool = False  # for the rest of the contour, once a search has found it
    failed_searches: int = 0  # on this contour
    half_contact: float = math.inf  # [m] half the length of the arc that a search touched first


class TouchCommand(NamedTuple):
    """One touch, in the slicing frame."""

    place: Floats  # (2,) [m] where the contour is expected
    heading: float  # [rad] azimuth of the expected outward normal
    standoff: float  # [m] distance before the place from which the pad starts
    reach: float  # [m] how far past the place it may go
    posture: Posture

    def start(self, height: float) -> Pose:
        """Pose from which the pad moves, for a slice at a height [m]."""
        axes = pad_rotation(self.heading, self.posture.tilt)
        target = np.array([self.place[0], self.place[1], height])
        target = target + self.posture.shift * axes[:, 1]
        return Pose(target - self.standoff * axes[:, 2], axes)

    @property
    def travel(self) -> float:
        """Longest distance of the guarded move [m]."""
        return self.standoff + self.reach


@dataclass(frozen=True, slots=True)
class ProcedureResult(Generic[Result]):
    """The end of a procedure."""

    result: Result


def resume(
    start: Callable[[], Procedure[Result]], arcs: Sequence[SliceArc | None]
) -> TouchCommand | ProcedureResult[Result]:
    """The next command of a procedure that has touched these arcs, or its result."""
    procedure = start()
    try:
        command = next(procedure)
        for arc in arcs:
            command = procedure.send(arc)
    except StopIteration as end:
        return ProcedureResult(end.value)
    return command


class Gap(NamedTuple):
    """A stretch between two points of a contour that could not be touched."""

    start: Floats  # (3,) [m] last point before it
    end: Floats  # (3,) [m] first point after it
    reason: GapReason

    @property
    def extent(self) -> float:
        """Distance between its ends [m]."""
        return float(np.linalg.norm(self.end - self.start))


class Path(NamedTuple):
    """What has been traced so far, in the slicing frame."""

    points: Floats  # (n, 3) [m]
    normals: Floats  # (n, 3) outward unit normals
    curvatures: Floats  # (n,) [1/m] across the contour
    low: Floats  # (n,) [m] lowest height touched below each point
    high: Floats  # (n,) [m] highest height touched above it

    def followed_by(self, other: Path) -> Path:
        """The path with another one appended."""
        return Path(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))

    def part(self, chosen: Bools | Ints | slice) -> Path:
        """Some of its points."""
        return Path(*(field[chosen] for field in self))

    def with_bands_of(self, arc: SliceArc, radius: float) -> Path:
        """Bands widened to what another touch has touched within a radius of the points [m]."""
        if not len(arc.points):
            return self
        distances = np.linalg.norm(self.points[:, None, :2] - arc.points[None, :, :2], axis=2)
        is_near, nearest = distances.min(axis=1) < radius, distances.argmin(axis=1)
        low = np.where(is_near, np.minimum(self.low, arc.low[nearest]), self.low)
        high = np.where(is_near, np.maximum(self.high, arc.high[nearest]), self.high)
        return self._replace(low=low, high=high)


def path_of(arc: SliceArc) -> Path:
    """The path of a single touch."""
    return Path(arc.points, arc.normals, arc.curvatures, arc.low, arc.high)


def winding(points: Floats, min_points: int = 11) -> float:
    """Angle swept about the middle of points (n, 3) [rad]; 0 for fewer than `min_points`."""
    if len(points) < min_points:
        return 0.0
    offsets = points[:, :2] - points[:, :2].mean(axis=0)
    angle = np.unwrap(np.arctan2(offsets[:, 1], offsets[:, 0]))
    return float(angle[-1] - angle[0])


def normal_azimuth(chord: Floats) -> float:
    """Azimuth of the outward normal of a contour that runs along a chord (2,) [rad]."""
    return math.atan2(-chord[0], chord[1])


def travel_direction(normal_azimuth: float) -> Floats:
    """Direction of travel (2,) where the outward normal has an azimuth [rad]."""
    return np.array([-math.sin(normal_azimuth), math.cos(normal_azimuth)])


class Heading(NamedTuple):
    """Where a path is going at its end."""

    tangent: Floats  # (2,) unit vector
    curvature: float  # [1/m] positive where the contour bulges outwards
    normal_azimuth: float  # [rad] of the outward normal, without jumps of a whole turn


def heading_at_end(
    path: Path, heading: float, width: float, settings: HeadingSettings = HeadingSettings()
) -> Heading:
    """Direction and curvature of a path at its last point.

    A parabola is fitted to the path's end, or to less of it where that does not fit: a longer
    window would mix two faces. The measured normal, of azimuth `heading` [rad], gives the direction
    unless it contradicts the parabola. `width`: of the pad [m].
    """
    tangent = travel_direction(heading)
    curvature, is_fit = 0.0, False
    end = path.points[-1]
    tail = path.points[-settings.max_points :]
    distance = np.linalg.norm(tail - end, axis=1)
    for window in settings.windows:
        near = tail[distance < window * width][:, :2] - end[:2]
        if len(near) < 3:
            break
        tangent, curvature, misfit = _parabola(near)
        is_fit = misfit < settings.max_misfit * width
        if is_fit:
            break
    normal = path.normals[-1]
    level = math.hypot(normal[0], normal[1])
    if level > settings.min_level_normal:
        measured = np.array([-normal[1], normal[0]]) / level
        min_cosine = settings.min_cosine_of_fit if is_fit else settings.min_cosine
        tangent = measured if measured @ tangent > min_cosine else tangent
    change = math.remainder(normal_azimuth(tangent) - heading, 2 * math.pi)
    lower, upper = settings.min_curvature / width, settings.max_curvature / width
    # A parabola that bends as an edge does lies over one: its curvature is not the next face's.
    is_edge = not is_fit and curvature > upper
    bounded = 0.0 if is_edge else min(max(curvature, lower), upper)
    return Heading(tangent, bounded, heading + change)


def _parabola(near: Floats) -> tuple[Floats, float, float]:
    """Tangent at the end, curvature and largest misfit of points (n, 2) that end at 0 [m]."""
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

    points: Floats  # (n, 3) [m] in the direction of travel; empty if the slice was not met
    normals: Floats  # (n, 3) outward unit normals
    # (n,) [1/m] normal curvature across the contour, positive if convex; 0 where not smooth.
    curvatures: Floats
    low: Floats  # (n,) [m] lowest height touched below each point without a break
    high: Floats  # (n,) [m] highest height touched above it
    slope: float  # of the surface against the pad along its y axis, where nearest to the slice
    nearest: Floats  # (3,) [m] the touched point nearest to the slice in height
    pad: Floats  # (3,) [m] middle of the pad's face
    above: int  # number of touched taxels above the slice
    below: int  # number of touched taxels below it


def arc_in_slice(
    pad: Pad,
    pose: Pose,
    surface: Floats,
    touched: Bools,
    jet: Jet | None,
    height: float,
    smooth: bool = True,
    settings: ArcSettings = ArcSettings(),
) -> SliceArc | None:
    """Arc of a touched surface at a slice height; None if nothing is touched.

    `pose`: of the pad in the slicing frame. `surface` (rows, cols): over the plane of the pad's
    face [m]. `touched` (rows, cols): mask of touched taxels. `jet`: of the surface; without one the
    pad's own normal stands in. `height`: of the slice [m]. `smooth`: whether curvatures mean
    anything. `settings`: how the arc is found.
    """
    if not touched.any():
        return None
    position, axes = pose
    x, y = pad.grid()
    above = position[2] + axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * surface - height
    connected = connected_rows(pad, surface, touched, settings.max_depth_step)
    met = crossings(pad, above, surface, touched, connected, settings)
    low, high = contact_bands(above, connected, met)
    local = met.places
    slope_x, slope_y, curve = _derivatives(jet, local)
    stretch = np.sqrt(1.0 + slope_x**2 + slope_y**2)
    outward = np.column_stack([slope_x, slope_y, -np.ones(len(local))]) / stretch[:, None]
    return SliceArc(
        points=local @ axes.T + position,
        normals=outward @ axes.T,
        curvatures=curve / (stretch * (1.0 + slope_y**2)) * smooth,
        low=height + low,
        high=height + high,
        slope=float(np.median(slope_y))
        if len(local)
        else _slope_near_slice(pad, above, surface, touched, settings),
        nearest=axes @ _nearest_point(pad, above, surface, touched) + position,
        pad=position,
        above=int((touched & (above > 0.0)).sum()),
        below=int((touched & (above < 0.0)).sum()),
    )


def _derivatives(jet: Jet | None, places: Floats) -> tuple[Floats, Floats, Floats]:
    """Slopes along x and y (n,), and second derivative along y (n,) [1/m]; 0 without a jet."""
    if jet is None or not len(places):
        return (np.zeros(len(places)),) * 3
    x, y = places[:, 0], places[:, 1]
    return *jet.slopes(x, y), jet.second_derivatives(x, y)[2]


class Crossings(NamedTuple):
    """Where columns of taxels meet the slice, in their order."""

    places: Floats  # (n, 3) [m] pad frame
    rows: Indices  # (n,) the row before each
    columns: Indices  # (n,)


def crossings(
    pad: Pad,
    above: Floats,
    surface: Floats,
    touched: Bools,
    connected: Bools,
    settings: ArcSettings,
) -> Crossings:
    """Where the surface meets the slice, at most once in each column.

    `above` (rows, cols): height of the surface over the slice [m]. `connected`: of
    `connected_rows`. A straight line between two rows stands off by up to an eighth of the
    curvature times the pitch squared, 4 um on a ball of 30 mm; a cubic through four rows by less
    than 0.1 um.
    """
    x, y = pad.grid()
    meets = (above[:-1] <= 0.0) != (above[1:] <= 0.0)
    row, col = np.nonzero(meets & connected)
    rows, window = _windows(touched, row, col)
    kept = window < len(ROW_WINDOWS) - 1
    if kept.sum() >= settings.min_columns:  # without those that only a straight line goes through
        row, col, rows, window = row[kept], col[kept], rows[kept], window[kept]
    share = above[row, col] / (above[row, col] - above[row + 1, col])
    # Coefficients (n, 4) along the rows, 0 at the row before the slice.
    rise, depth = (
        np.einsum("nij,nj->ni", _COEFFICIENTS[window], field[rows, col[:, None]])
        for field in (above, surface)
    )
    straight = share
    for _ in range(settings.newton_steps):
        value, slope = _values(rise, share)
        share = share - value / np.where(slope == 0.0, 1.0, slope)
    share = np.where((share >= 0.0) & (share <= 1.0), share, straight)
    up = y[row, col] + share * pad.pitch
    places = np.column_stack([x[row, col], up, _values(depth, share)[0]])
    order = np.lexsort((np.abs(places[:, 1]), col))
    is_first = np.ones(len(places), bool)
    is_first[1:] = np.diff(col[order]) > 0
    chosen = order[is_first]
    return Crossings(places[chosen], row[chosen], col[chosen])


def connected_rows(pad: Pad, surface: Floats, touched: Bools, max_step: float) -> Bools:
    """Whether neighbouring rows touch one surface, (rows - 1, cols); `max_step` in pitches."""
    level: Bools = np.abs(surface[1:] - surface[:-1]) < max_step * pad.pitch
    return touched[:-1] & touched[1:] & level


def _windows(touched: Bools, row: Indices, col: Indices) -> tuple[Indices, Indices]:
    """Rows (n, 4) of each crossing's polynomial, and the number of its window (n,)."""
    last = len(touched) - 1
    window = np.full(len(row), len(ROW_WINDOWS) - 1)
    for number in reversed(range(len(ROW_WINDOWS) - 1)):
        first, count = ROW_WINDOWS[number]
        wanted = row[:, None] + first + np.arange(count)
        inside = (wanted >= 0) & (wanted <= last)
        is_touched = (inside & touched[np.clip(wanted, 0, last), col[:, None]]).all(axis=1)
        window[is_touched] = number
    firsts = np.array([first for first, _ in ROW_WINDOWS])[window]
    return np.clip((row + firsts)[:, None] + np.arange(N_ROWS), 0, last), window


def _values(polynomials: Floats, share: Floats) -> tuple[Floats, Floats]:
    """Values and slopes (n,) of polynomials (n, 4) at places (n,)."""
    a, b, c, d = polynomials.T
    return a + share * (b + share * (c + share * d)), b + share * (2.0 * c + share * 3.0 * d)


def contact_bands(above: Floats, connected: Bools, met: Crossings) -> tuple[Floats, Floats]:
    """Lowest and highest height touched without a break from where columns meet the slice.

    Only touched taxels count: the edge of a domed pad's face often hangs free. Returns `low`,
    `high` (n,): heights over the slice [m], 0 or less, 0 or more.
    """
    breaks = np.cumsum(~connected, axis=0)
    stretch = np.vstack([np.zeros_like(breaks[:1]), breaks])[:, met.columns]
    unbroken = stretch == stretch[met.rows, np.arange(len(met.rows))]
    heights = np.where(unbroken, above[:, met.columns], 0.0)
    return heights.min(axis=0), heights.max(axis=0)


def _slope_near_slice(
    pad: Pad, above: Floats, surface: Floats, touched: Bools, settings: ArcSettings
) -> float:
    """Slope along y at the touched rows nearest to a slice that was not met."""
    both = touched[:-1] & touched[1:]
    if both.sum() < 2:
        return -math.copysign(settings.edge_slope, float(pad.grid()[1][touched].mean()))
    distance = np.abs(above[1:] + above[:-1])[both]
    rise = (surface[1:] - surface[:-1])[both] / pad.pitch
    nearest = np.argsort(distance, kind="stable")[: settings.n_slope_pairs]
    return float(np.median(rise[nearest]))


def _nearest_point(pad: Pad, above: Floats, surface: Floats, touched: Bools) -> Floats:
    """The surface's point (3,) nearest to the slice in height, pad frame [m]."""
    return pad.surface_point(surface, int(np.where(touched, np.abs(above), np.inf).argmin()))


def deepest_point(pad: Pad, surface: Floats, touched: Bools) -> Floats:
    """The surface's point (3,) under the most compressed taxel, pad frame [m]."""
    pressed = np.where(touched, -(surface + pad.sag()), -np.inf)
    return pad.surface_point(surface, int(pressed.argmax()))


def _coefficients(window: RowWindow) -> Floats:
    """Matrix (4, 4) from a polynomial's values on the rows to its coefficients."""
    nodes = window.first + np.arange(window.n_rows)
    matrix = np.zeros((N_ROWS, N_ROWS))
    values = np.vander(nodes, increasing=True).astype(float)
    matrix[: window.n_rows, : window.n_rows] = np.linalg.inv(values)
    return matrix


UPRIGHT = Posture()  # before anything is known
TOUCH_DEPTH = UPRIGHT.depth  # [m] of a plain touch
Procedure = Generator[TouchCommand, SliceArc | None, Result]
_COEFFICIENTS = np.stack([_coefficients(window) for window in ROW_WINDOWS])
