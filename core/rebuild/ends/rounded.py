"""A wall that is rounded off into a level end by an arc: how most made things end.

A superellipse that follows the wall's beginning comes down too early where the end is level: the
arc's own radius, and the disc within it, are told by few heights.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats

ROWS = 9
"""Rows of the side to which it is fitted."""
LARGEST = 12.0
"""Radius of the arc over the way from the last row to the end, at most; at least it is 1: a
smaller arc would begin where nothing was seen."""
TRIED = 49
"""Radii that are tried."""
LEAST_DISC = 0.05
"""Of the last row's radius: a smaller disc is none."""


class Rounded(NamedTuple):
    """A wall and an arc; shares are of the last row's radius, ways of the way to the end."""

    arc: float
    """Radius of the arc, as a way: 1 or more."""
    width: float
    """The same as a share."""
    wall: tuple[float, float, float]
    """The wall as a polynomial of the way, by ascending powers, shares."""

    def shares(self, way: Floats) -> Floats:
        """Radius (n,) as a share of the last row's."""
        inside = np.clip(1.0 - (1.0 - np.asarray(way)) / self.arc, 0.0, 1.0)
        level, slope, bend = self.wall
        wall = level + way * (slope + way * bend)
        shares: Floats = wall - self.width * (1.0 - np.sqrt(1.0 - inside**2))
        return shares


@dataclass(frozen=True, slots=True)
class Arc:
    """The arc of a rounded end, walked by its angle: smooth where it meets the disc."""

    profile: Rounded

    def at(self, way: Floats, by: int = 0) -> Floats:
        """See `palpate.core.rebuild.ends.end_curve.Curve.at`."""
        arc, width, (level, slope, bend) = self.profile
        first = math.asin(1.0 - 1.0 / arc)
        rate = 0.5 * math.pi - first
        sine, cosine = np.sin(first + rate * way), np.cos(first + rate * way)
        x = 1.0 - arc * (1.0 - sine)
        if by == 0:
            wall = level + x * (slope + x * bend)
            return np.stack([x, wall - width * (1.0 - cosine)], axis=-1)
        along, lean = arc * cosine * rate, slope + 2.0 * bend * x
        if by == 1:
            return np.stack([along, lean * along - width * sine * rate], axis=-1)
        more = -arc * sine * rate**2
        second = 2.0 * bend * along**2 + lean * more - width * cosine * rate**2
        return np.stack([more, second], axis=-1)


def rounded(depths: Floats, radii: Floats, end: float) -> Rounded | None:
    """Wall and arc that best follow the last rows of a side.

    Parameters
    ----------
    depths : (n,) array
        Outward coordinates of the rows, ascending, close together.
    radii : (n,) array
        Mean radii there, positive.
    end : float
        Outward coordinate of the end, beyond the last row.

    Returns
    -------
    Rounded or None
        None if no arc leaves a disc within it, or none is the best.

    Notes
    -----
    For each radius of the arc the wall follows by projection, for all radii at once.
    """
    depths, radii, last = depths[-ROWS:], radii[-ROWS:], float(radii[-1])
    gap = end - float(depths[-1])
    way = (depths - depths[-1]) / gap
    arcs = np.geomspace(1.0, LARGEST, TRIED)
    inside = np.clip(1.0 - (1.0 - way) / arcs[:, None], 0.0, 1.0)
    widths = arcs * gap / last
    cut = widths[:, None] * (1.0 - np.sqrt(1.0 - inside**2))
    powers = np.vander(way, 3, increasing=True)
    walls = np.linalg.lstsq(powers, (radii / last + cut).T, rcond=None)[0]
    missed = ((powers @ walls).T - cut - radii / last) ** 2
    best = int(missed.sum(axis=1).argmin())
    level, slope, bend = walls[:, best].tolist()
    # The arc begins where the last row is: the share there is 1 by definition.
    level += 1.0 - (level - float(cut[best, -1]))
    found = Rounded(float(arcs[best]), float(widths[best]), (level, slope, bend))
    leaves = float(found.shares(np.array([1.0]))[0])
    return found if best > 0 and leaves > LEAST_DISC else None
