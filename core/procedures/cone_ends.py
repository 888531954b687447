"""The ends of a generalised cone: touched along the axis, plane or round, or refused."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.procedures.cone_choice import (
    DEFAULT_CONE_CHOICE,
    ConeChoiceSettings,
    refitted,
)
from palpate.core.procedures.generalised_cones import ConeFit, RoundEnd, fit_cone, fit_round_end
from palpate.core.procedures.polyhedron import fit_plane
from palpate.core.procedures.protocol import (
    UP,
    Contact,
    FingerMove,
    Move,
    MoveResult,
    TouchSetup,
    approach,
    clear_of_platform,
    touch,
)

QUARTERS = tuple(0.5 * math.pi * quarter for quarter in range(4))  # [rad] azimuths beside an end


@dataclass(frozen=True, slots=True, kw_only=True)
class ConeEndSettings:
    """How an end is touched, and when it is plane, round or hollow."""

    min_points: int = 12  # of a touch of a plane end
    noise_sigmas: float = 4.0  # [standard deviations of a taxel] largest rms about a plane end
    plane_sigmas: float = 0.5  # [standard deviations of a point] the same; the larger one counts
    max_plane_tilt: float = math.radians(2.0)  # [rad] of a plane end's normal to the axis
    plane_radius: float = 0.6  # fraction of the radius, where a plane end is touched again
    round_radius: float = 0.7  # fraction of the radius, where a round end is touched again
    round_overlap: float = 0.1  # fraction of the pad's width, of side that a round end replaces
    min_hollow: int = 6  # untouched taxels between touched ones that show a hole
    hollow_depth: float = 3.0e-3  # [m] of a touch below the end of the side; beyond it: hollow
    upright_cosine: float = 1.0 - 1e-3  # to the vertical; beyond it, the platform is the lower end


DEFAULT_CONE_ENDS = ConeEndSettings()


class SideEnd(NamedTuple):
    """An end of the cone."""

    shape: float | RoundEnd  # [m] height of a plane end, or a round end
    untouched: float  # [m] height of the untouched part of the side before it


class EndError(Exception):
    """An end does not belong to a right cone."""


def squared_cone(
    setup: TouchSetup,
    fit: ConeFit,
    touches: list[Floats],
    choice: ConeChoiceSettings = DEFAULT_CONE_CHOICE,
    settings: ConeEndSettings = DEFAULT_CONE_ENDS,
) -> Generator[Move, MoveResult, ConeFit | None]:
    """The cone whose axis is square to a plane end; None if no plane end is touched.

    Any axis through an apex has a section of its own on the same surface: "end face is a necessary
    contact feature" (Fearing; Fung, 1999, 1.4.3.1).
    """
    for sign in (1.0, -1.0):
        move = _end_move(setup, fit, sign)
        if move is None:
            continue
        contact = yield from touch(setup, move)
        normal = _plane_normal(setup, contact, settings)
        if normal is None:
            continue
        axis = normal if normal @ fit.axis > 0.0 else -normal
        turned = fit_cone(
            touches, fit.kind, fit.point, axis, setup.sigma, is_axis_fixed=True, settings=choice.fit
        )
        squared = refitted(setup, turned, touches, choice, is_axis_fixed=True)
        if squared.rms <= setup.common.max_rms * setup.sigma:
            error = math.hypot(contact.normal_error, setup.angle_error)
            return squared._replace(axis_error=error)
    return None


def _end_move(setup: TouchSetup, fit: ConeFit, sign: float) -> FingerMove | None:
    """The move along the axis to an end; None if there is no room."""
    middle = fit.point + (fit.high if sign > 0.0 else fit.low) * fit.axis
    standoff = setup.common.standoff
    return clear_of_platform(setup, approach(middle, sign * fit.axis, 3.0 * standoff, standoff))


def _plane_normal(setup: TouchSetup, contact: Contact, settings: ConeEndSettings) -> Floats | None:
    """The outward unit normal (3,) of an end; None if it is not plane where it is touched."""
    if len(contact.points) < settings.min_points:
        return None
    errors = setup.noise, setup.point_error, setup.angle_error
    fit = fit_plane([contact.points], contact.normal, *errors)
    max_rms = max(settings.noise_sigmas * setup.noise, settings.plane_sigmas * setup.sigma)
    return fit.plane.normal if fit.rms <= max_rms else None


def touched_end(
    setup: TouchSetup, fit: ConeFit, sign: float, settings: ConeEndSettings = DEFAULT_CONE_ENDS
) -> Generator[Move, MoveResult, SideEnd]:
    """Touch an end along the axis, and on four sides of its middle; raises EndError.

    `sign`: 1 for the upper end, -1 for the lower one.
    """
    outward, height = sign * fit.axis, fit.high if sign > 0.0 else fit.low
    end = fit.point + height * fit.axis
    if outward @ UP < -settings.upright_cosine and end[2] < setup.platform + setup.width:
        floor = float((setup.platform - fit.point[2]) / fit.axis[2])
        return SideEnd(floor, abs(floor - height))
    move = _end_move(setup, fit, sign)
    if move is None:
        return SideEnd(height, setup.width)
    contact = yield from touch(setup, move)
    heights = (contact.points - fit.point) @ fit.axis
    pole = float(sign * (sign * heights).max(initial=-math.inf))
    _check_filled(setup, contact, sign * (pole - height), settings)
    normal = _plane_normal(setup, contact, settings)
    if normal is None:
        return (yield from _round_end(setup, fit, sign, contact, pole, settings))
    if not abs(normal @ fit.axis) > math.cos(settings.max_plane_tilt):
        tilt = math.degrees(math.acos(min(abs(float(normal @ fit.axis)), 1.0)))
        raise EndError(f"its end leans by {tilt:.0f} degrees: it is no right cone")
    level = float(heights.mean())
    yield from _check_level(setup, fit, sign, level, settings)
    return SideEnd(level, abs(pole - height))


def _check_filled(
    setup: TouchSetup, contact: Contact, rise: float, settings: ConeEndSettings
) -> None:
    """Raise EndError if an end is hollow; `rise` [m]: of the contact over the side's end."""
    if rise < -settings.hollow_depth:
        depth = setup.common.standoff if math.isinf(rise) else abs(rise)
        raise EndError(f"it is hollow: a finger falls {1e3 * depth:.0f} mm or more into its end")
    if len(contact.hollow) >= settings.min_hollow:
        raise EndError("it is hollow: taxels in the middle of its end touch nothing")


def _round_end(
    setup: TouchSetup,
    fit: ConeFit,
    sign: float,
    contact: Contact,
    pole: float,
    settings: ConeEndSettings,
) -> Generator[Move, MoveResult, SideEnd]:
    """Touch an end on four sides of its pole [m], and fit a round end; else it stays untouched."""
    height, standoff = fit.high if sign > 0.0 else fit.low, setup.common.standoff
    points = [contact.points]
    for azimuth in QUARTERS:
        across = fit.across @ [math.cos(azimuth), math.sin(azimuth)]
        radius = fit.radius(np.array([height]), np.array([azimuth]))[0]
        place = (
            fit.point + 0.5 * (height + pole) * fit.axis + settings.round_radius * radius * across
        )
        outward = (across + sign * fit.axis) / math.sqrt(2.0)
        move = clear_of_platform(setup, approach(place, outward, 2.0 * standoff, standoff))
        if move is not None:
            beside = yield from touch(setup, move)
            points += [beside.points] if beside.is_hit else []
    edge = height - settings.round_overlap * sign * setup.width
    shape = fit_round_end(fit, np.concatenate(points), pole, edge)
    is_closed = shape.radius(np.linspace(edge, pole, 20))[:-1].all()
    if shape.rms > setup.common.max_rms * setup.sigma or not is_closed:
        return SideEnd(height, abs(pole - height))
    return SideEnd(shape, 0.0)


def _check_level(
    setup: TouchSetup, fit: ConeFit, sign: float, level: float, settings: ConeEndSettings
) -> Generator[Move, MoveResult, None]:
    """Touch a plane end beside its middle; raise EndError if it is not at `level` [m] there."""
    standoff = setup.common.standoff
    for azimuth in QUARTERS:
        across = fit.across @ [math.cos(azimuth), math.sin(azimuth)]
        radius = fit.radius(np.array([level]), np.array([azimuth]))[0]
        place = fit.point + level * fit.axis + settings.plane_radius * radius * across
        move = clear_of_platform(setup, approach(place, sign * fit.axis, 3.0 * standoff, standoff))
        if move is None:
            continue
        contact = yield from touch(setup, move)
        heights = sign * ((contact.points - fit.point) @ fit.axis - level)
        max_offset = setup.common.max_touch_error * setup.sigma
        if abs(float(heights.max(initial=-standoff))) > max_offset:
            raise EndError("its end is not plane: it is hollow, or raised, beside its middle")
