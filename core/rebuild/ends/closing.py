"""How a solid goes on beyond its first and last contours, and what cannot be known of it.

An end of known height belongs to the family that would have told the last contour: that is left
out, and each family predicts its radius from the others. An end that nobody touched closes where
the squared radii of the last contours, a quadratic of the height for every quadric, become zero,
or where a superellipse of unknown height does; contours of a cylinder tell nothing of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.geometry import area_centroids
from palpate.core.rebuild.contours import are_nearly_star_shaped
from palpate.core.rebuild.ends.profiles import (
    ROWS,
    SHOULDER_CONTOURS,
    EdgeSamples,
    Flat,
    Profile,
    Relief,
    Trend,
    conic,
    flared,
    flat,
    rounded,
    shoulder_misfits,
    superellipse,
    trend_of,
)

EndKind = Literal["flat", "conic", "superellipse", "flared", "rounded", "pole", "fan"]
LEAN_CONTOURS = 3  # Contours whose middles tell which way the axis leans
LEAST_GAP = 1e-6  # Of the contours' range: an end that lies nearer to the last contour lies on it
FEWEST = 12  # With fewer contours they lie too far apart for a test by the last one
SLACK = 0.004  # Of the largest radius: within this the plainest family is taken
NOISES = 2.0  # The same in standard deviations of a mean radius
# Contours that are left out for the test, at least and at most: of contours, and of dense ones,
# where it is those that lie the end's own way before the last.
LEFT_OUT = (1, 1), (5, 8)
STANDS = 0.5  # Squared radius, as a share of the last contour's, that is carried on to a flat end
ProfileKind = Literal["flat", "conic", "superellipse", "flared", "rounded"]
Family = Callable[[Floats, Floats, float], Profile]
# The plainest first.
FAMILIES: dict[ProfileKind, Family] = {"flat": flat, "conic": conic, "superellipse": superellipse}
# Those for contours so close together that they show how a leaning wall is rounded.
DENSE: dict[ProfileKind, Family] = {"flat": flat, "conic": conic, "flared": flared}
# Families that end level, as a wall does that an arc rounds off.
LEVEL: tuple[ProfileKind, ProfileKind] = "flat", "flared"
# By how much better either must be than a sharp edge where that tells the last row; else an arc
# than a superellipse, which looks like one, and how well it must then follow the rows, as a share
# of the radius.
BY_FAR, CLEARLY, CLOSELY = 0.2, 0.5, 8e-4
TOGETHER = 3.5  # Rows err together, by so many standard deviations of a mean radius
DENSE_SLACK = 5e-4  # As `SLACK`, for those
POLE_FEWEST = 4  # Contours: three for the quadratic, one to test it
POLE_MISS = 0.03  # Of the squared radius: most that the fourth contour may be missed by
POLE_NOISES = 4.0  # The same in standard deviations of its mean radius, as a share of it
FARTHEST = 2.0  # Spacings of the last contours: most that the pole may lie beyond them
# Squared radius of the last contour, as a share of the fourth's: a pole or an end is near only if
# the contours have begun to narrow.
NARROWED = 0.75
NEARLY_REAL = 0.15  # Imaginary over real part of a root that noise has lifted off the axis
SHOULDER_FEWEST = 12  # Contours: with fewer they lie too far apart to show how an edge is rounded
WAYS = np.geomspace(0.02, 1.0, 48)  # Heights over the last contour that are tried, in spacings
SHOULDER_MISS = 0.004  # Of the largest radius: what the contours may be missed by
SHOULDER_NOISES = 2.0  # The same in standard deviations of a mean radius


@dataclass(frozen=True, slots=True, eq=False)
class End:
    """One end of a solid, in the unit of the contours."""

    # flat: a wall and a level disc; conic, pole: closes in a point as a conic does, at the height
    # that was touched or at the one that the contours tell; superellipse: a shoulder; flared: a
    # shoulder on a wall that leans; rounded: a wall, an arc and a level disc; fan: a level disc on
    # the last contour, for want of knowledge.
    kind: EndKind
    rim: float  # Height of the last contour
    height: float  # Height at which the solid ends; the rim's for a fan
    # The solid may go on by up to this much, and nobody can know: one spacing of the contours for a
    # fan, as much as the end lies beyond them for a superellipse that nobody touched, else 0.
    uncovered: float
    profile: Profile  # Radius over the last contour's, by the share of the way from rim to height
    middle: Floats  # Place of the axis at `height`, (2,)
    # Whether the last contour is seen whole from its middle; where it is not, an end that is drawn
    # from the rim to the middle folds over itself.
    starlike: bool
    # Whether it is a piece of its own though it closes in a point: what closes a radial side, or
    # where a loft would have run through its own axis on the way there.
    apart: bool = False
    relief: Relief | None = None  # What it rises over its profile, if its face is not level

    @property
    def unseen(self) -> float:
        """How high it is: no contour has seen it."""
        return abs(self.height - self.rim)

    @property
    def pointed(self) -> bool:
        """Whether it closes in a point, as a conic does."""
        return self.kind in ("conic", "pole")

    @property
    def round(self) -> bool:
        """Whether the side itself should run on to a point at `height` and `middle`."""
        return self.pointed and not self.apart


def close_ends(
    heights: Floats,
    grid: Floats,
    *,
    bottom: float | None = None,
    top: float | None = None,
    noise: float = 0.0,
) -> tuple[End, End]:
    """Both ends of a stack of contours, below and above.

    They run counter-clockwise at ascending heights (m,), grid (m, k, 2); `noise` is the standard
    deviation of a point, in the same unit. `bottom` and `top` are heights at which a touch found
    the ends, left out where nobody touched. Raises ValueError if the contours are not like that or
    have no width, an end lies inside them by more than a spacing, or `noise` is negative.
    """
    down, up = (_stack(heights, grid, noise, upper=upper) for upper in (False, True))
    return _end("bottom", down, bottom, False, None), _end("top", up, top, False, None)


def close_rows(
    heights: Floats,
    grid: Floats,
    touched: float | None,
    noise: float,
    beyond: EdgeSamples | None,
    *,
    upper: bool,
) -> End:
    """The upper or lower end of rows of a surface, however close together: see `close_ends`.

    It was touched at a height, and `beyond` says what was touched between the last row and that.
    One that closes in a point is a piece of its own.
    """
    stack = _stack(heights, grid, noise, upper=upper)
    end = _end("top" if upper else "bottom", stack, touched, True, beyond)
    return replace(end, apart=end.pointed)


def _stack(heights: Floats, grid: Floats, noise: float, *, upper: bool) -> _Stack:
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
    last = [-1 if upper else 0]
    whole = bool(are_nearly_star_shaped(grid[last] - middles[last, None])[0])
    if upper:
        return _Stack(heights, radii, middles, scatter, 1.0, whole)
    return _Stack(-heights[::-1], radii[::-1], middles[::-1], scatter, -1.0, whole)


def _end(
    name: str, stack: _Stack, touched: float | None, dense: bool, beyond: EdgeSamples | None
) -> End:
    last = float(stack.depths[-1])
    if touched is None:
        rows = stack.depths, stack.radii
        if (ahead := free_pole(*rows, stack.scatter)) is not None:
            return stack.end("pole", last + ahead, conic(*rows, last + ahead))
        if (ahead := free_shoulder(*rows, stack.scatter)) is not None:
            profile = superellipse(*rows, last + ahead)
            return stack.end("superellipse", last + ahead, profile, ahead)
        return stack.end("fan", last, Flat(0.0), stack.spacing)
    depth = stack.sign * float(finite_array(name, touched, ()))
    if depth < last - stack.spacing:
        raise ValueError(
            f"{name} must not lie within the contours, "
            f"got {touched:g} where the last is at {stack.sign * last:g}"
        )
    if depth - last <= LEAST_GAP * max(last - float(stack.depths[0]), stack.spacing):
        return stack.end("flat", last, Flat(0.0))
    kind, profile, _ = choose_profile(
        stack.depths, stack.radii, depth, stack.scatter, dense=dense, beyond=beyond
    )
    return stack.end(kind, depth, profile)


def free_pole(depths: Floats, radii: Floats, scatter: float) -> float | None:
    """How far beyond the last contour the solid closes; None where nobody can know.

    By ascending outward coordinates (n,), mean radii there, and the deviation `scatter` of these.
    """
    if len(depths) < POLE_FEWEST:
        return None
    trend = trend_of(depths, radii)
    fourth = float(radii[-POLE_FEWEST]) ** 2
    miss = abs(trend.at(float(depths[-POLE_FEWEST] - depths[-1])) - fourth) / fourth
    told = miss < POLE_MISS + POLE_NOISES * scatter / float(radii[-POLE_FEWEST])
    narrows = trend.slope < 0.0 and trend.square < NARROWED * fourth
    pole = _first_root(trend)
    near = pole < FARTHEST * float(depths[-1] - depths[-2])
    return pole if told and narrows and near else None


def _first_root(trend: Trend) -> float:
    """The nearest positive root, or the real part of one that is nearly real; else infinity."""
    half, square = -0.5 * trend.slope, trend.square
    inside = half * half - trend.bend * square
    if inside >= 0.0:
        # Of both forms the one without cancellation; both roots are positive or one is.
        larger = half + math.copysign(math.sqrt(inside), half)
        roots = [square / larger if larger else math.inf]
        roots.append(larger / trend.bend if trend.bend else math.inf)
        return min((root for root in roots if root > 0.0), default=math.inf)
    real = half / trend.bend
    imaginary = math.sqrt(-inside) / abs(trend.bend)
    return real if real > 0.0 and imaginary < NEARLY_REAL * real else math.inf


def free_shoulder(depths: Floats, radii: Floats, scatter: float) -> float | None:
    """The same where a superellipse closes it, each with the width that fits; as `free_pole`."""
    if len(depths) < SHOULDER_FEWEST or not radii[-1] ** 2 < NARROWED * radii[-4] ** 2:
        return None
    begin = float(depths[-(len(depths) // 2 + 1)])
    ways = (depths[-1] - depths[-2]) * WAYS
    near, seen = depths[-SHOULDER_CONTOURS:], radii[-SHOULDER_CONTOURS:]
    zeta = (near - begin) / (depths[-1] + ways[:, None] - begin)
    squares = np.array([shoulder_misfits(each, seen).min() for each in zeta])
    misses = np.sqrt(squares / len(seen))
    best = int(misses.argmin())
    allowed = SHOULDER_MISS * float(radii.max()) + SHOULDER_NOISES * scatter
    return float(ways[best]) if misses[best] < allowed else None


def choose_profile(
    depths: Floats,
    radii: Floats,
    end: float,
    scatter: float,
    *,
    dense: bool = False,
    beyond: EdgeSamples | None = None,
) -> tuple[ProfileKind, Profile, dict[ProfileKind, float]]:
    """Family, profile and misses of an end at an outward coordinate, as of `free_pole`.

    Misses are of the last contour's radius, by family, m; none of few contours. What was touched
    `beyond` dense contours has to be met as well.
    """
    families, slack = (DENSE, DENSE_SLACK) if dense else (FAMILIES, SLACK)
    tried = dict(families)
    if beyond is not None:
        tried["flared"] = partial(flared, beyond=beyond)
    profiles = {name: family(depths, radii, end) for name, family in tried.items()}
    if len(depths) < FEWEST:
        carried = trend_of(depths, radii)
        stands = carried.at(end - float(depths[-1])) > STANDS * carried.square
        kind: ProfileKind = "flat" if stands else "conic"
        return kind, profiles[kind], {}
    if beyond is None:
        misses = _misses(families, depths, radii, end, LEFT_OUT[dense])
    else:
        rim, radius = float(depths[-1]), float(radii[-1])
        # What was touched beyond tells more of the end than any contour that is left out.
        misses = {
            name: float(np.sqrt(np.mean(beyond.off(one, rim, end, radius) ** 2)))
            for name, one in profiles.items()
        }
    enough = min(misses.values()) + max(NOISES * scatter, slack * float(radii.max()))
    kind = next(name for name, miss in misses.items() if miss <= enough)
    if kind not in LEVEL or not dense:
        return kind, profiles[kind], misses
    rows = depths, radii, end, beyond  # A sharp edge, or what follows the rows clearly better
    by_edge, by_shoulder = (_misfit(profiles[name], *rows) for name in LEVEL)
    most = min(CLEARLY * by_shoulder, CLOSELY * float(radii[-1]) + TOGETHER * scatter)
    if kind == "flat":
        is_shoulder = by_shoulder < BY_FAR * by_edge
        kind = "flared" if is_shoulder else "flat"
        most = by_shoulder if is_shoulder else BY_FAR * by_edge
    arc = rounded(depths, radii, end)
    if arc is not None and _misfit(arc, *rows) < most:
        return "rounded", arc, misses
    return kind, profiles[kind], misses


def _misses(
    families: dict[ProfileKind, Family],
    depths: Floats,
    radii: Floats,
    end: float,
    left_out: tuple[int, int],
) -> dict[ProfileKind, float]:
    """By how much the last radius is missed, from those that are not left out."""
    far = int(np.searchsorted(depths, 2.0 * depths[-1] - end, side="right"))
    least, most = left_out
    kept = max(min(far, len(depths) - least), len(depths) - most)
    known, seen = depths[:kept], radii[:kept]
    way = np.array([(depths[-1] - known[-1]) / (end - known[-1])])
    return {
        name: abs(float(seen[-1] * family(known, seen, end).shares(way)[0] - radii[-1]))
        for name, family in families.items()
    }


def _misfit(
    profile: Profile, depths: Floats, radii: Floats, end: float, beyond: EdgeSamples | None
) -> float:
    """Root mean square distance of the last rows, and of samples beyond, from a profile."""
    rim, last = float(depths[-1]), float(radii[-1])
    way = (depths[-ROWS:] - rim) / (end - rim)
    missed = [last * profile.shares(way) - radii[-ROWS:]]
    if beyond is not None:
        missed.append(beyond.off(profile, rim, end, last))
    return float(np.sqrt(np.mean(np.concatenate(missed) ** 2)))


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

    def end(self, kind: EndKind, depth: float, profile: Profile, uncovered: float = 0.0) -> End:
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
        return np.asarray(self.middles[-1] + ahead * lean)
