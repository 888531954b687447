"""Ends of a solid beyond its first and last contours, and what remains unknown of them.

An end of known height belongs to the family that predicts the last contour best: that is left out,
and each family predicts its radius from the others. An end that was not touched closes where the
squared radii of the last contours, a quadratic of the height for every quadric, become zero, or
where a superellipse of unknown height does. Contours of a cylinder determine neither.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.geometry import area_centroids
from palpate.core.rebuild.contours import are_nearly_star_shaped
from palpate.core.rebuild.ends.profiles import (
    N_TREND_CONTOURS,
    EdgeSamples,
    Flat,
    Profile,
    ProfileSettings,
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
ProfileKind = Literal["flat", "conic", "superellipse", "flared", "rounded"]
Family = Callable[[Floats, Floats, float, ProfileSettings], Profile]
# The plainest first: of families that predict about as well, the first one is taken.
FAMILIES: dict[ProfileKind, Family] = {"flat": flat, "conic": conic, "superellipse": superellipse}
# Of rows so close together that they show how a leaning wall is rounded.
DENSE_FAMILIES: dict[ProfileKind, Family] = {"flat": flat, "conic": conic, "flared": flared}


@dataclass(frozen=True, slots=True, kw_only=True)
class UntouchedEndSettings:
    """When contours alone determine where an end closes, in a pole or in a shoulder."""

    max_pole_misfit: float = 0.03  # error of the fourth squared radius by the quadratic, relative
    pole_sigmas: float = 4.0  # standard deviations of that radius, added to this limit
    max_pole_distance: float = 2.0  # [spacings of the last contours] beyond the last contour
    # Squared radius of the last contour over that of the fourth from it: an end is near only if
    # the contours have begun to narrow.
    max_square_ratio: float = 0.75
    # Imaginary over real part of a root: noise makes a double root complex.
    max_imaginary_ratio: float = 0.15
    min_shoulder_contours: int = 12  # fewer lie too far apart to show how an edge is rounded
    min_shoulder_height: float = 0.02  # [spacings] least height of the end over the last contour
    max_shoulder_height: float = 1.0  # [spacings] largest one
    n_shoulder_heights: int = 48  # heights that are tried
    max_shoulder_misfit: float = 0.004  # rms misfit, as a fraction of the largest radius
    shoulder_sigmas: float = 2.0  # standard deviations of a mean radius, added to this limit


@dataclass(frozen=True, slots=True, kw_only=True)
class FamilySettings:
    """How the profile family of an end of known height is chosen.

    Each family predicts contours that are left out. The plainest family whose error exceeds the
    least by no more than a slack is taken. An arc or a flared shoulder replaces a sharp edge that
    predicts the contours only if it follows the last rows much better.
    """

    min_contours: int = 12  # fewer lie too far apart for a prediction of the last one
    min_flat_square: float = 0.5  # extrapolated squared radius at a flat end, over the last one
    slack: float = 0.004  # fraction of the largest radius
    dense_slack: float = 5e-4  # the same of dense rows
    slack_sigmas: float = 2.0  # standard deviations of a mean radius; the larger slack counts
    # Least and most contours that are left out. Between these, dense rows are left out as far from
    # the last one as that lies from the end.
    n_left_out: tuple[int, int] = (1, 1)
    n_dense_left_out: tuple[int, int] = (5, 8)
    max_edge_ratio: float = 0.2  # misfit of a shoulder or an arc, over that of a sharp edge
    max_shoulder_ratio: float = 0.5  # misfit of an arc, over that of a shoulder, which is similar
    max_arc_misfit: float = 8e-4  # rms misfit, as a fraction of the last radius
    arc_sigmas: float = 3.5  # standard deviations of a mean radius, added: errors are correlated


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosingSettings:
    """How a stack of contours is closed; tuned on the shipped scenes with 5 and 9 contours."""

    min_gap: float = 1e-6  # fraction of the contours' range; a nearer end lies at the last contour
    n_axis_contours: int = 3  # contours whose middles determine the direction of the axis
    untouched: UntouchedEndSettings = UntouchedEndSettings()
    family: FamilySettings = FamilySettings()
    profile: ProfileSettings = field(default_factory=ProfileSettings)


@dataclass(frozen=True, slots=True, eq=False)
class End:
    """One end of a solid, in the unit of the contours."""

    # flat: a wall and a level disc; conic, pole: closes in a point as a conic does, at a touched
    # height or at one that the contours determine; superellipse: a shoulder; flared: a shoulder on
    # a wall that leans; rounded: a wall, an arc and a level disc; fan: a level disc on the last
    # contour, where nothing determines the end.
    kind: EndKind
    rim: float  # height of the last contour
    height: float  # height at which the solid ends; the rim's for a fan
    # Length by which the solid may continue unseen: one spacing of the contours for a fan, the
    # distance of the end from the contours for an untouched superellipse, else 0.
    uncovered: float
    profile: Profile  # of the radius from `rim` to `height`
    middle: Floats  # of the axis at `height`, (2,)
    # Whether the last contour is star-shaped about its middle; an end that is drawn from another
    # rim to the middle folds over itself.
    starlike: bool
    # Whether an end that closes in a point is a piece of its own: of a radial side, or where a loft
    # up to that point crosses its own axis.
    apart: bool = False
    relief: Relief | None = None  # height of its face over the profile, if that is not level

    @property
    def unseen(self) -> float:
        """Height of the end over the last contour."""
        return abs(self.height - self.rim)

    @property
    def pointed(self) -> bool:
        """Whether it closes in a point, as a conic does."""
        return self.kind in ("conic", "pole")

    @property
    def round(self) -> bool:
        """Whether the side itself continues to a point at `height` and `middle`."""
        return self.pointed and not self.apart


def close_ends(
    heights: Floats,
    grid: Floats,
    *,
    bottom: float | None = None,
    top: float | None = None,
    noise: float = 0.0,
    settings: ClosingSettings = ClosingSettings(),
) -> tuple[End, End]:
    """Lower and upper end of a stack of contours.

    Contours run counter-clockwise at ascending heights (m,), grid (m, k, 2); `noise` is the
    standard deviation of a point, in the same unit. `bottom` and `top` are the touched heights of
    the ends, None where there was no touch. Raises ValueError if the arrays do not fit or are not
    finite, heights do not ascend, a contour has no width, an end lies inside the contours by more
    than a spacing, or `noise` is negative.
    """
    down, up = (_stack(heights, grid, noise, settings, upper=upper) for upper in (False, True))
    lower = _end("bottom", down, bottom, settings)
    return lower, _end("top", up, top, settings)


def close_rows(
    heights: Floats,
    grid: Floats,
    touched: float | None,
    noise: float,
    samples: EdgeSamples | None,
    *,
    upper: bool,
    settings: ClosingSettings = ClosingSettings(),
) -> End:
    """Upper or lower end of dense rows of a surface: see `close_ends`.

    `touched` is the end's height; `samples` are what was touched between the last row and that. An
    end that closes in a point is a piece of its own.
    """
    stack = _stack(heights, grid, noise, settings, upper=upper)
    end = _end("top" if upper else "bottom", stack, touched, settings, dense=True, samples=samples)
    return replace(end, apart=end.pointed)


def _stack(
    heights: Floats, grid: Floats, noise: float, settings: ClosingSettings, *, upper: bool
) -> _Stack:
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
    starlike = bool(are_nearly_star_shaped(grid[last] - middles[last, None])[0])
    n_axis = settings.n_axis_contours
    if upper:
        return _Stack(heights, radii, middles, scatter, 1.0, starlike, n_axis)
    return _Stack(-heights[::-1], radii[::-1], middles[::-1], scatter, -1.0, starlike, n_axis)


def _end(
    name: str,
    stack: _Stack,
    touched: float | None,
    settings: ClosingSettings,
    *,
    dense: bool = False,
    samples: EdgeSamples | None = None,
) -> End:
    last = float(stack.depths[-1])
    if touched is None:
        return _untouched_end(stack, settings)
    depth = stack.sign * float(finite_array(name, touched, ()))
    if depth < last - stack.spacing:
        raise ValueError(
            f"{name} must not lie within the contours, "
            f"got {touched:g} where the last is at {stack.sign * last:g}"
        )
    if depth - last <= settings.min_gap * max(last - float(stack.depths[0]), stack.spacing):
        return stack.end("flat", last, Flat(0.0))
    kind, profile = _chosen_profile(stack, depth, dense, samples, settings)
    return stack.end(kind, depth, profile)


def _untouched_end(stack: _Stack, settings: ClosingSettings) -> End:
    """A pole or a shoulder where the contours determine one, else a level disc on the last."""
    rows, last = (stack.depths, stack.radii), float(stack.depths[-1])
    distance = free_pole(*rows, stack.scatter, settings.untouched)
    if distance is not None:
        end = last + distance
        return stack.end("pole", end, conic(*rows, end, settings.profile))
    distance = free_shoulder(*rows, stack.scatter, settings)
    if distance is not None:
        end = last + distance
        profile = superellipse(*rows, end, settings.profile)
        return stack.end("superellipse", end, profile, uncovered=distance)
    return stack.end("fan", last, Flat(0.0), uncovered=stack.spacing)


def free_pole(
    depths: Floats, radii: Floats, scatter: float, settings: UntouchedEndSettings
) -> float | None:
    """Distance of a pole beyond the last contour; None where the contours do not determine it.

    By ascending outward coordinates (n,), mean radii (n,) there, and the standard deviation
    `scatter` of these. Three contours determine a quadratic, and a fourth tests it.
    """
    if len(depths) <= N_TREND_CONTOURS:
        return None
    trend, fourth = trend_of(depths, radii), -1 - N_TREND_CONTOURS
    square = float(radii[fourth]) ** 2
    misfit = abs(trend.at(float(depths[fourth] - depths[-1])) - square) / square
    allowed = settings.max_pole_misfit + settings.pole_sigmas * scatter / float(radii[fourth])
    narrows = trend.slope < 0.0 and trend.square < settings.max_square_ratio * square
    pole = _first_root(trend, settings.max_imaginary_ratio)
    is_near = pole < settings.max_pole_distance * float(depths[-1] - depths[-2])
    return pole if misfit < allowed and narrows and is_near else None


def _first_root(trend: Trend, max_imaginary_ratio: float) -> float:
    """The nearest positive root, or the real part of one that is nearly real; else infinity."""
    half, square = -0.5 * trend.slope, trend.square
    discriminant = half * half - trend.bend * square
    if discriminant >= 0.0:
        # Of both forms the one without cancellation; both roots are positive or one is.
        larger = half + math.copysign(math.sqrt(discriminant), half)
        roots = [square / larger if larger else math.inf]
        roots.append(larger / trend.bend if trend.bend else math.inf)
        return min((root for root in roots if root > 0.0), default=math.inf)
    real = half / trend.bend
    imaginary = math.sqrt(-discriminant) / abs(trend.bend)
    return real if real > 0.0 and imaginary < max_imaginary_ratio * real else math.inf


def free_shoulder(
    depths: Floats, radii: Floats, scatter: float, settings: ClosingSettings
) -> float | None:
    """As `free_pole`, but the end of the superellipse that fits the last contours best."""
    untouched, fourth = settings.untouched, -1 - N_TREND_CONTOURS
    if len(depths) < untouched.min_shoulder_contours:
        return None
    if not radii[-1] ** 2 < untouched.max_square_ratio * radii[fourth] ** 2:
        return None
    begin = float(depths[-(len(depths) // 2 + 1)])
    limits = untouched.min_shoulder_height, untouched.max_shoulder_height
    spacings = np.geomspace(*limits, untouched.n_shoulder_heights)
    distances = (depths[-1] - depths[-2]) * spacings
    last = slice(-settings.profile.n_shoulder_contours, None)
    zetas = (depths[last] - begin) / (depths[-1] + distances[:, None] - begin)
    squares = np.array(
        [shoulder_misfits(zeta, radii[last], settings.profile).min() for zeta in zetas]
    )
    misfits = np.sqrt(squares / len(radii[last]))
    best = int(misfits.argmin())
    allowed = untouched.max_shoulder_misfit * float(radii.max())
    allowed += untouched.shoulder_sigmas * scatter
    return float(distances[best]) if misfits[best] < allowed else None


def _chosen_profile(
    stack: _Stack,
    end: float,
    dense: bool,
    samples: EdgeSamples | None,
    settings: ClosingSettings,
) -> tuple[ProfileKind, Profile]:
    """Family and profile of an end at an outward coordinate; `samples` decide it, if any."""
    depths, radii, family = stack.depths, stack.radii, settings.family
    families = DENSE_FAMILIES if dense else FAMILIES
    if len(depths) < family.min_contours:
        trend = trend_of(depths, radii)
        is_flat = trend.at(end - float(depths[-1])) > family.min_flat_square * trend.square
        kind: ProfileKind = "flat" if is_flat else "conic"
        return kind, families[kind](depths, radii, end, settings.profile)
    profiles = {name: fit(depths, radii, end, settings.profile) for name, fit in families.items()}
    if samples is not None:
        profiles["flared"] = flared(depths, radii, end, settings.profile, samples)
        rim, radius = float(depths[-1]), float(radii[-1])
        # Samples beyond the last contour determine the end better than contours that are left out.
        errors = {
            name: float(np.sqrt(np.mean(samples.residuals(profile, rim, end, radius) ** 2)))
            for name, profile in profiles.items()
        }
    else:
        errors = _prediction_errors(stack, end, dense, settings)
    slack = (family.dense_slack if dense else family.slack) * float(radii.max())
    allowed = min(errors.values()) + max(family.slack_sigmas * stack.scatter, slack)
    kind = next(name for name, error in errors.items() if error <= allowed)
    if dense and kind in ("flat", "flared"):
        return _level_profile(stack, end, kind, profiles, samples, settings)
    return kind, profiles[kind]


def _prediction_errors(
    stack: _Stack, end: float, dense: bool, settings: ClosingSettings
) -> dict[ProfileKind, float]:
    """Error of the last radius that each family predicts from the contours before."""
    depths, radii = stack.depths, stack.radii
    as_far = int(np.searchsorted(depths, 2.0 * depths[-1] - end, side="right"))
    least, most = settings.family.n_dense_left_out if dense else settings.family.n_left_out
    kept = max(min(as_far, len(depths) - least), len(depths) - most)
    known, seen = depths[:kept], radii[:kept]
    fraction = np.array([(depths[-1] - known[-1]) / (end - known[-1])])
    errors: dict[ProfileKind, float] = {}
    for name, fit in (DENSE_FAMILIES if dense else FAMILIES).items():
        ratio = fit(known, seen, end, settings.profile).radius_ratios(fraction)[0]
        errors[name] = abs(float(seen[-1] * ratio - radii[-1]))
    return errors


def _level_profile(
    stack: _Stack,
    end: float,
    kind: ProfileKind,
    profiles: dict[ProfileKind, Profile],
    samples: EdgeSamples | None,
    settings: ClosingSettings,
) -> tuple[ProfileKind, Profile]:
    """A level end: with a sharp edge, a flared shoulder or an arc."""

    def misfit(profile: Profile) -> float:
        """Root mean square distance of the last rows, and of the samples, from a profile."""
        rim, last = float(stack.depths[-1]), float(stack.radii[-1])
        rows = slice(-settings.profile.n_rows, None)
        fractions = (stack.depths[rows] - rim) / (end - rim)
        residuals = [last * profile.radius_ratios(fractions) - stack.radii[rows]]
        if samples is not None:
            residuals.append(samples.residuals(profile, rim, end, last))
        return float(np.sqrt(np.mean(np.concatenate(residuals) ** 2)))

    family = settings.family
    by_edge, by_shoulder = misfit(profiles["flat"]), misfit(profiles["flared"])
    limit = family.max_arc_misfit * float(stack.radii[-1]) + family.arc_sigmas * stack.scatter
    limit = min(family.max_shoulder_ratio * by_shoulder, limit)
    if kind == "flat":
        is_shoulder = by_shoulder < family.max_edge_ratio * by_edge
        kind = "flared" if is_shoulder else "flat"
        limit = by_shoulder if is_shoulder else family.max_edge_ratio * by_edge
    arc = rounded(stack.depths, stack.radii, end, settings.profile)
    if arc is not None and misfit(arc) < limit:
        return "rounded", arc
    return kind, profiles[kind]


@dataclass(frozen=True, slots=True, eq=False)
class _Stack:
    """Contours from inside towards an end."""

    depths: Floats  # ascending outward coordinates (n,)
    radii: Floats  # root mean square radii (n,)
    middles: Floats  # (n, 2)
    scatter: float  # standard deviation of a mean radius
    sign: float  # 1 towards an upper end, -1 towards a lower one
    starlike: bool  # whether the last contour is star-shaped about its middle
    n_axis: int  # contours whose middles determine the direction of the axis

    @property
    def spacing(self) -> float:
        """Distance of the last two contours; 0 if there is one."""
        return float(self.depths[-1] - self.depths[-2]) if len(self.depths) > 1 else 0.0

    def end(self, kind: EndKind, depth: float, profile: Profile, uncovered: float = 0.0) -> End:
        """The end at an outward coordinate."""
        rim = self.sign * float(self.depths[-1])
        middle = self._axis(depth)
        return End(kind, rim, self.sign * depth, uncovered, profile, middle, self.starlike)

    def _axis(self, depth: float) -> Floats:
        """Middle at an outward coordinate, on the line through the last middles."""
        last, middles = self.depths[-self.n_axis :], self.middles[-self.n_axis :]
        below = last - last[-1]
        # Far beyond the contours the direction of the axis is unknown: the line ends there.
        ahead = min(depth - self.depths[-1], self.depths[-1] - self.depths[0])
        centred = below - below.mean()
        square = float(centred @ centred)
        lean = centred @ (middles - middles.mean(axis=0)) / square if square else np.zeros(2)
        return np.asarray(self.middles[-1] + ahead * lean)
