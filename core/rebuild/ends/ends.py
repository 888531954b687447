"""How a solid goes on beyond its first and last contours, and what cannot be known of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.plane.area_centroid import area_centroids
from palpate.core.rebuild.ends.end_choice import choose_profile
from palpate.core.rebuild.ends.end_profiles import Beyond, Flat, Profile, conic, superellipse
from palpate.core.rebuild.ends.free_pole import free_pole
from palpate.core.rebuild.ends.free_shoulder import free_shoulder
from palpate.core.rebuild.slices.star_shaped import are_nearly_star_shaped

Kind = Literal["flat", "conic", "superellipse", "flared", "rounded", "pole", "fan"]

LEAN_CONTOURS = 3
"""Contours whose middles say which way the axis leans."""
LEAST_GAP = 1e-6
"""Of the contours' range: an end that lies nearer to the last contour lies on it."""


@dataclass(frozen=True, slots=True, eq=False)
class End:
    """One end of a solid, in the unit of the contours."""

    kind: Kind
    """flat: a wall and a level disc; conic, pole: closes in a point as a conic does, at the
    height that was touched or at the one that the contours tell; superellipse: a shoulder;
    flared: a shoulder on a wall that leans; rounded: a wall, an arc and a level disc;
    fan: a level disc on the last contour, for want of knowledge."""
    rim: float
    """Height of the last contour."""
    height: float
    """Height at which the solid ends; the rim's for a fan."""
    uncovered: float
    """The solid may go on by up to this much, and nobody can know: one spacing of the
    contours for a fan, as much as the end lies beyond them for a superellipse that nobody
    touched, else 0."""
    profile: Profile
    """Radius over the last contour's, by the share of the way from `rim` to `height`."""
    middle: Floats
    """Place of the axis at `height`, (2,)."""
    starlike: bool
    """Whether the last contour is seen whole from its middle; where it is not, an end that is
    drawn from the rim to the middle folds over itself."""
    apart: bool = False
    """Whether it is a piece of its own though it closes in a point, for the side would have run
    through its own axis on the way there."""

    @property
    def unseen(self) -> float:
        """How high it is: no contour has seen it."""
        return abs(self.height - self.rim)

    @property
    def round(self) -> bool:
        """Whether the side itself should run on to a point at `height` and `middle`."""
        return self.kind in ("conic", "pole") and not self.apart

    def shares(self, heights: Floats) -> Floats:
        """Radius (n,) at heights between rim and end, as a share of the last contour's."""
        gap = self.height - self.rim
        way = (np.asarray(heights) - self.rim) / gap if gap else np.zeros_like(heights)
        return self.profile.shares(np.clip(way, 0.0, 1.0))


def close_ends(
    heights: Floats,
    grid: Floats,
    *,
    bottom: float | None = None,
    top: float | None = None,
    noise: float = 0.0,
    dense: bool = False,
    beyond: tuple[Beyond | None, Beyond | None] = (None, None),
) -> tuple[End, End]:
    """Both ends of a stack of contours.

    Parameters
    ----------
    heights : (m,) array
        Heights of the contours, ascending.
    grid : (m, k, 2) array
        Their points, counter-clockwise.
    bottom, top : float, optional
        Heights at which a touch found the ends; left out where nobody touched.
    noise : float
        Standard deviation of a point, in the same unit.
    dense : bool
        Whether the contours are rows of a surface, as close together as one likes.
    beyond : pair of Beyond or None
        What was felt below and above dense contours, between them and touched ends.

    Returns
    -------
    bottom, top : End

    Raises
    ------
    ValueError
        If the contours are not like that or have no width, if an end lies inside the contours
        by more than a spacing, or if `noise` is negative.
    """
    heights = finite_array("heights", heights, (None,))
    grid = finite_array("grid", grid, (len(heights), None, 2))
    if not len(heights) or not (np.diff(heights) > 0.0).all():
        raise ValueError(f"heights must ascend, and be at least one, got {heights.tolist()}")
    if not 0.0 <= noise < np.inf:
        raise ValueError(f"noise must be 0 or more and finite, got {noise}")
    middles = area_centroids(grid)
    radii = np.sqrt(np.mean(np.sum((grid - middles[:, None]) ** 2, axis=2), axis=1))
    if not (radii > 0.0).all():
        raise ValueError(f"contours must have a width, got radius 0 in {int((radii <= 0).sum())}")
    scatter = noise / np.sqrt(grid.shape[1])
    last = [0, -1]
    whole = are_nearly_star_shaped(grid[last] - middles[last, None]).tolist()
    up = _Stack(heights, radii, middles, scatter, 1.0, whole[1])
    down = _Stack(-heights[::-1], radii[::-1], middles[::-1], scatter, -1.0, whole[0])
    below, above = beyond
    return _end("bottom", down, bottom, dense, below), _end("top", up, top, dense, above)


@dataclass(frozen=True, slots=True, eq=False)
class _Stack:
    """Contours from inside towards an end."""

    depths: Floats
    radii: Floats
    middles: Floats
    scatter: float
    sign: float
    starlike: bool

    @property
    def spacing(self) -> float:
        """Of the last two contours; 0 if there is but one."""
        return float(self.depths[-1] - self.depths[-2]) if len(self.depths) > 1 else 0.0

    def end(self, kind: Kind, depth: float, profile: Profile, uncovered: float = 0.0) -> End:
        """The end at an outward coordinate."""
        rim = self.sign * float(self.depths[-1])
        middle = self._axis(depth)
        return End(kind, rim, self.sign * depth, uncovered, profile, middle, self.starlike)

    def _axis(self, depth: float) -> Floats:
        """Middle at an outward coordinate, on the line through the last middles."""
        last, middles = self.depths[-LEAN_CONTOURS:], self.middles[-LEAN_CONTOURS:]
        beyond = last - last[-1]
        # Far beyond the contours nobody knows whether it leans on.
        ahead = min(depth - self.depths[-1], self.depths[-1] - self.depths[0])
        away = beyond - beyond.mean()
        square = float(away @ away)
        lean = away @ (middles - middles.mean(axis=0)) / square if square else np.zeros(2)
        axis: Floats = self.middles[-1] + ahead * lean
        return axis


def _end(
    name: str, stack: _Stack, touched: float | None, dense: bool, beyond: Beyond | None
) -> End:
    last = float(stack.depths[-1])
    if touched is None:
        ahead = free_pole(stack.depths, stack.radii, stack.scatter)
        if ahead is None:
            return _rounded_or_open(stack)
        profile = conic(stack.depths, stack.radii, last + ahead)
        return stack.end("pole", last + ahead, profile)
    depth = stack.sign * float(finite_array(name, touched, ()))
    if depth < last - stack.spacing:
        raise ValueError(
            f"{name} must not lie within the contours, "
            f"got {touched:g} where the last is at {stack.sign * last:g}"
        )
    if depth - last <= LEAST_GAP * max(last - float(stack.depths[0]), stack.spacing):
        return stack.end("flat", last, Flat(0.0))
    choice = choose_profile(
        stack.depths, stack.radii, depth, stack.scatter, dense=dense, beyond=beyond
    )
    return stack.end(choice.kind, depth, choice.profile)


def _rounded_or_open(stack: _Stack) -> End:
    """An end that nobody touched and that is no conic's."""
    last = float(stack.depths[-1])
    beyond = free_shoulder(stack.depths, stack.radii, stack.scatter)
    if beyond is None:
        return stack.end("fan", last, Flat(0.0), stack.spacing)
    profile = superellipse(stack.depths, stack.radii, last + beyond)
    return stack.end("superellipse", last + beyond, profile, beyond)
