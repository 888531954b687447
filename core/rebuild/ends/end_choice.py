"""Which family an end of known height belongs to: the one that would have told the last contour.

The last contour is left out, and each family predicts its radius from the others.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.ends.end_profiles import (
    Beyond,
    Profile,
    conic,
    flared,
    flat,
    superellipse,
    trend_of,
)
from palpate.core.rebuild.ends.rounded import ROWS, rounded

FEWEST = 12
"""With fewer contours they lie too far apart for a test by the last one."""
SLACK = 0.004
"""Of the largest radius: families that predict within this are equally good; the plainest is
taken."""
NOISES = 2.0
"""The same in standard deviations of a mean radius."""
LEFT_OUT = (1, 1), (5, 8)
"""Contours that are left out for the test, at least and at most: of contours, and of dense ones,
where it is those that lie the end's own way before the last."""
STANDS = 0.5
"""Squared radius, as a share of the last contour's, that is carried on to a flat end."""

Kind = Literal["flat", "conic", "superellipse", "flared", "rounded"]
Family = Callable[[Floats, Floats, float], Profile]
FAMILIES: dict[Kind, Family] = {
    "flat": flat,
    "conic": conic,
    "superellipse": superellipse,
}
"""The plainest first."""
DENSE: dict[Kind, Family] = {"flat": flat, "conic": conic, "flared": flared}
"""Those for contours so close together that they show how a leaning wall is rounded."""
LEVEL = ("flat", "flared")
"""Families that end level, as a wall does that an arc rounds off."""
BY_FAR, CLEARLY, CLOSELY = 0.2, 0.5, 8e-4
"""By how much better either must be than a sharp edge where that tells the last row; else an arc
than a superellipse, which looks like one, and how well it must then follow the rows, as a share of
the radius."""
TOGETHER = 3.5
"""Rows err together, by so many standard deviations of a mean radius."""
DENSE_SLACK = 5e-4
"""As `SLACK`, for those."""


class Choice(NamedTuple):
    """A family and its profile."""

    kind: Kind
    profile: Profile
    misses: dict[Kind, float]
    """By how much each family missed the last contour's radius; none with few contours."""


def choose_profile(
    depths: Floats,
    radii: Floats,
    end: float,
    scatter: float,
    *,
    dense: bool = False,
    beyond: Beyond | None = None,
) -> Choice:
    """Profile of an end whose height is known.

    Parameters
    ----------
    depths : (n,) array
        Outward coordinates of the contours, ascending.
    radii : (n,) array
        Mean radii there, positive.
    end : float
        Outward coordinate of the end, beyond the last contour.
    scatter : float
        Standard deviation of a mean radius.
    dense : bool
        Whether the contours are rows of a surface, as close together as one likes.
    beyond : Beyond, optional
        What was felt between dense contours and the end: it has to be met as well.
    """
    families, slack = (DENSE, DENSE_SLACK) if dense else (FAMILIES, SLACK)
    profiles = {name: family(depths, radii, end) for name, family in families.items()}
    if beyond is not None:
        profiles["flared"] = flared(depths, radii, end, beyond)
    if len(depths) < FEWEST:
        carried = trend_of(depths, radii)
        stands = carried.at(end - float(depths[-1])) > STANDS * carried.square
        kind: Kind = "flat" if stands else "conic"
        return Choice(kind, profiles[kind], {})
    misses = _misses(families, depths, radii, end, LEFT_OUT[dense])
    if beyond is not None:
        rim, radius = float(depths[-1]), float(radii[-1])
        felt = {name: beyond.miss(one, rim, end, radius) for name, one in profiles.items()}
        # What was felt beyond says more of the end than any contour that is left out.
        misses = felt
    enough = min(misses.values()) + max(NOISES * scatter, slack * float(radii.max()))
    kind = next(name for name, miss in misses.items() if miss <= enough)
    if kind not in LEVEL or not dense:
        return Choice(kind, profiles[kind], misses)
    return _level(kind, profiles, depths, radii, end, scatter, beyond)._replace(misses=misses)


def _level(
    kind: Kind,
    profiles: dict[Kind, Profile],
    depths: Floats,
    radii: Floats,
    end: float,
    scatter: float,
    beyond: Beyond | None,
) -> Choice:
    """A sharp edge, or what follows the rows clearly better: a shoulder, or an arc."""

    def strays(profile: Profile) -> float:
        return _strays(profile, depths, radii, end, beyond)

    by_edge, by_shoulder = strays(profiles["flat"]), strays(profiles["flared"])
    most = min(CLEARLY * by_shoulder, CLOSELY * float(radii[-1]) + TOGETHER * scatter)
    if kind == "flat":
        is_shoulder = by_shoulder < BY_FAR * by_edge
        kind = "flared" if is_shoulder else "flat"
        most = by_shoulder if is_shoulder else BY_FAR * by_edge
    arc = rounded(depths, radii, end)
    if arc is not None and strays(arc) < most:
        return Choice("rounded", arc, {})
    return Choice(kind, profiles[kind], {})


def _strays(
    profile: Profile, depths: Floats, radii: Floats, end: float, beyond: Beyond | None
) -> float:
    """Root mean square distance of the last rows, and of what was felt beyond, from a profile."""
    rim, last = float(depths[-1]), float(radii[-1])
    way = (depths[-ROWS:] - rim) / (end - rim)
    missed = [last * profile.shares(way) - radii[-ROWS:]]
    if beyond is not None:
        shares = profile.shares((beyond.depths - rim) / (end - rim))
        missed.append(beyond.weights * (last * shares - beyond.radii))
    return float(np.sqrt(np.mean(np.concatenate(missed) ** 2)))


def _misses(
    families: dict[Kind, Family],
    depths: Floats,
    radii: Floats,
    end: float,
    left_out: tuple[int, int],
) -> dict[Kind, float]:
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
