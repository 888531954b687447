"""The generalised cone that fits the contacts of a pair of fingers: its axis, and its kind."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.grasp import revolution_axis
from palpate.core.procedures.generalised_cones import (
    DEFAULT_CONE_FIT,
    ConeFit,
    ConeFitSettings,
    ConeKind,
    fit_cone,
    side_points,
    widest_gap,
)
from palpate.core.procedures.protocol import Contact, TouchSetup

KINDS: Mapping[ConeKind, str] = {
    "revolution": "a surface of revolution",
    "linear": "a linear generalised cone",
    "free": "a straight homogeneous generalised cone",
}
ROUGH_KINDS: tuple[ConeKind, ...] = ("revolution", "linear")  # that few contacts determine


@dataclass(frozen=True, slots=True, kw_only=True)
class ConeChoiceSettings:
    """How contacts are assigned to the side of a cone, and which kind of cone is chosen."""

    fit: ConeFitSettings = DEFAULT_CONE_FIT
    # [rad] between normal and axis; a contact that is closer to the axis belongs to an end.
    min_side_angle: float = math.radians(25.0)
    end_cost: float = 0.2  # [standard deviations] added per contact that an axis assigns to an end
    n_first_harmonics: int = 3  # of a section that is fitted to the first contacts
    max_gap: float = math.radians(40.0)  # [rad] untouched about the axis, unless of revolution
    # A simpler kind is chosen if its residual does not exceed the sum of these two.
    max_rms_ratio: float = 1.25  # times the residual of the best kind
    rms_tolerance: float = 0.2  # [standard deviations]
    rim_width: float = 0.3  # [pad's width] from an end, where a touch may reach over the rim
    min_touch_points: int = 12  # of a touch on the side; one with fewer, or as many, is left out
    min_touches: int = 4  # of a fit


DEFAULT_CONE_CHOICE = ConeChoiceSettings()


def best_axis(
    setup: TouchSetup, contacts: list[Contact], settings: ConeChoiceSettings = DEFAULT_CONE_CHOICE
) -> ConeFit | None:
    """The generalised cone that fits contacts best, among several axes that they suggest.

    `contacts`: of thumb and index in turn.
    """
    points = np.array([contact.middle for contact in contacts])
    normals = np.array([contact.normal for contact in contacts])
    middles = 0.5 * (points[::2] + points[1::2])
    middle, directions = middles.mean(axis=0), np.linalg.svd(middles - middles.mean(axis=0))[2]
    starts = [*np.eye(3), directions[0]]
    revolution = revolution_axis(points, normals, np.array(starts))
    lines = [(revolution.point, revolution.axis), *((middle, axis) for axis in starts)]
    first_fit = replace(settings.fit, n_harmonics=settings.n_first_harmonics)
    fits: list[tuple[float, ConeFit]] = []
    for point, axis in lines:
        sides = [contact.points for contact in contacts if is_on_side(contact, axis, settings)]
        # Contacts that an axis assigns to an end do not count in its favour.
        end_cost = settings.end_cost * (len(contacts) - len(sides)) * setup.sigma
        for kind in ROUGH_KINDS if len(sides) >= settings.min_touches else ():
            fit = fit_cone(sides, kind, point, axis, setup.sigma, settings=first_fit)
            fits.append((fit.rms + end_cost, fit))
    return min(fits, key=lambda pair: pair[0])[1] if fits else None


def is_on_side(
    contact: Contact, axis: Floats, settings: ConeChoiceSettings = DEFAULT_CONE_CHOICE
) -> bool:
    """Whether a contact is on the side of a cone, and not on an end."""
    max_cosine = math.cos(settings.min_side_angle)
    return contact.is_hit and abs(float(contact.normal @ axis)) < max_cosine


def best_cone(
    setup: TouchSetup,
    touches: list[Floats],
    axis: ConeFit,
    settings: ConeChoiceSettings = DEFAULT_CONE_CHOICE,
) -> tuple[ConeFit, dict[ConeKind, float]]:
    """The simplest kind of cone that fits nearly as well as the best, and all residuals [m].

    `touches`: points of each touch, (n, 3) [m]. Points on the rims of the ends are left out of a
    second fit.
    """
    fits = []
    for kind in KINDS:
        fit = fit_cone(touches, kind, axis.point, axis.axis, setup.sigma, settings=settings.fit)
        if fit.kind != "revolution" and widest_gap(fit, touches) > settings.max_gap:
            continue
        fits.append(refitted(setup, fit, touches, settings))
    tolerance = settings.rms_tolerance * setup.sigma
    max_rms = settings.max_rms_ratio * min(fit.rms for fit in fits) + tolerance
    chosen = next(fit for fit in fits if fit.rms <= max_rms)
    return chosen, {fit.kind: fit.rms for fit in fits}


def refitted(
    setup: TouchSetup,
    fit: ConeFit,
    touches: list[Floats],
    settings: ConeChoiceSettings = DEFAULT_CONE_CHOICE,
    *,
    is_axis_fixed: bool = False,
) -> ConeFit:
    """The cone fitted again without points on the rims of its ends."""
    max_offset, rim = setup.common.max_rms * setup.sigma, settings.rim_width * setup.width
    sides = [side_points(fit, points, max_offset, rim, settings.fit) for points in touches]
    sides = [points for points in sides if len(points) > settings.min_touch_points]
    if len(sides) < settings.min_touches:
        return fit
    return fit_cone(
        sides,
        fit.kind,
        fit.point,
        fit.axis,
        setup.sigma,
        is_axis_fixed=is_axis_fixed,
        settings=settings.fit,
    )


def misfit(setup: TouchSetup, fit: ConeFit, rms_by_kind: Mapping[ConeKind, float]) -> str:
    """Why the object is not a generalised cone; empty if it may be one."""
    sigma, common = setup.sigma, setup.common
    if fit.rms <= common.max_rms * sigma and fit.worst <= common.max_touch_error * sigma:
        return ""
    residuals = ", ".join(f"{kind} {1e3 * rms:.3f}" for kind, rms in rms_by_kind.items())
    return (
        f"no generalised cone fits: residuals in mm rms are {residuals}, of the worst touch "
        f"{1e3 * fit.worst:.3f}, where one standard deviation is {1e3 * sigma:.3f}"
    )
