"""Where a contour is going at the end of what has been traced of it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.path import Path, heading_across

WINDOWS = (7.0 / 15.0, 3.2 / 15.0)
"""Lengths of the path's end to which a parabola is fitted, the first whose fit is good; in
widths of the pad."""
LONGEST_TAIL = 40
"""Points that belong to the path's end; near its closing the start lies within the window too."""
GOOD_FIT = 4.0e-3
"""A parabola within this of the points is good; in widths of the pad."""
CURVATURES = (-3.0, 7.5)
"""Bounds of the path's curvature, in 1 / widths of the pad."""
LEVEL_NORMAL = 0.2
"""A normal whose level part is shorter than this has no azimuth."""
ALIKE = 0.8
"""Cosine of the angle within which the felt normal and the parabola must agree."""
CLOSE = 0.997
"""The same where the parabola is good: beside an edge the normals are those of two faces."""


class Course(NamedTuple):
    """Where the path is going at its end."""

    tangent: Floats
    """(2,) unit vector."""
    curvature: float
    """1/m, positive where the contour bulges outwards."""
    heading: float
    """Azimuth of the outward normal, rad, without jumps of a whole turn."""


def course_at_end(path: Path, heading: float, width: float) -> Course:
    """Direction and curvature of a path at its last point.

    A parabola is fitted to the path's end, or to less of it where that does not fit: a longer
    window would mix two faces. The felt normal is a better heading than the
    parabola, unless they contradict each other.

    Parameters
    ----------
    path : Path
        At least one point.
    heading : float
        Azimuth of the outward normal at the last touch, rad.
    width : float
        Width of the pad, m.
    """
    tangent = np.array([-math.sin(heading), math.cos(heading)])
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
        felt = np.array([-normal[1], normal[0]]) / level
        tangent = felt if felt @ tangent > (CLOSE if good else ALIKE) else tangent
    change = math.remainder(heading_across(tangent) - heading, 2 * math.pi)
    least, most = (bound / width for bound in CURVATURES)
    return Course(tangent, min(max(curvature, least), most), heading + change)


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
