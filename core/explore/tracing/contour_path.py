"""What of a contour has been traced, its gaps, and where it is heading at its end."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.explore.tracing.slice_arc import SliceArc

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
# The same where the parabola is good: beside an edge the normals are those of two faces.
CLOSE = 0.997


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
    window would mix two faces. The measured normal is a better heading than the parabola, unless
    they contradict each other.

    `heading`: azimuth of the outward normal at the last touch, rad. `width`: width of the pad, m.
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
    return Heading(tangent, min(max(curvature, least), most), heading + change)


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
