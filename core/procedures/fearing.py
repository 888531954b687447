"""Three fingers on a cone: its axis and apex from a few contact features (Fearing).

Finger 1 looks for the object from above; then three fingers close on its sides at once, and each
touch is read as a vertex, an edge, a face or a parabolic point. Which of them belong to the top,
the bottom or the sides nobody says: the interpretations that tables and geometry leave are
compared, and more touches made until one is left: `palpate.core.cones`; Fung, 1999, 1.4.3.1.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.cones import (
    ConeOrientation,
    ConeOrigin,
    ContactFeature,
    Feature,
    InsufficientFeaturesError,
    Interpretation,
    feature_of_contact,
    interpretations,
    residual_sigma,
    scaled_radii,
    solve_orientation,
    solve_origin,
)
from palpate.core.procedures.protocol import (
    STANDOFF,
    UNSUITED,
    UP,
    Contact,
    Exploration,
    Findings,
    Met,
    Move,
    TouchSetting,
    approach,
    kept_clear,
    square_on,
    touch,
    touch_from_above,
    touch_pair,
)

FINGERS = 3
ROUNDS = 4  # Closings of three fingers at most
DOWN = (18.0e-3, 32.0e-3, 12.0e-3, 25.0e-3)  # Below what was touched from above, m, by closing
LOW, LEAST_HEIGHT = 0.75, 9.0e-3  # Of the height: where a cone is touched again; over the platform
TURN = math.radians(25.0)  # Of the fingers, from one closing to the next
LEAST_ROOM = 3.0e-3  # From an apex to the plane of an end, m
LEAST_ERROR = 1e-9  # m and rad
CLEAR = "FP"  # Features that are read surely: faces and parabolic points
BENT = 2  # Touches that are curved both ways, of which no cone has one
COMPARED = 5  # Features whose places are tried all ways
ALIKE = 0.5  # Residuals, in standard deviations, that do not tell interpretations apart
SAME_AXIS, SAME_APEX = math.radians(3.0), 5.0e-3  # Interpretations that mean the same cone, m


class ConePoseFit(NamedTuple):
    """Axis and apex of a cone."""

    orientation: ConeOrientation
    origin: ConeOrigin
    features: tuple[Feature, ...]  # With their places
    half_angles: tuple[float, ...]  # Of the touched meridians to the axis, rad
    interpretations: tuple[str, ...]  # That geometry leaves, the most likely first
    residual_sigma: float  # Of all features


def fearing(setting: TouchSetting) -> Exploration:
    """Close three fingers on a cone until its axis and apex are known.

    Findings: a `ConePoseFit`, or ``unsuited``: what was touched and why it does not suffice or fit.
    """
    if setting.fingers < FINGERS:
        return Findings(status="unsuited", reason=f"it takes {FINGERS} fingers at once")
    first = yield from touch_from_above(setting)
    if first is None:
        return Findings(status="incomplete", reason="nothing was touched within reach")
    first = yield from square_on(setting, first)
    contacts, why, fit, confirmed = [first], "", None, False
    for closing in range(ROUNDS):
        contacts += yield from _closing(setting, first.middle, closing, DOWN[closing])
        if closing == 0:
            contacts += yield from _end_face(setting, contacts)
        fit, why = recovered(setting, contacts)
        if fit is not None and len(fit.interpretations) == 1:
            # Elsewhere on the sides the same cone must be touched, or it is none.
            low = LOW * (first.middle[2] - setting.platform)
            more, known = (yield from _closing(setting, first.middle, closing + 0.5, low)), fit
            fit, why = recovered(setting, [*contacts, *more])
            confirmed = fit is not None and len(fit.features) > len(known.features)
            break
    if fit is not None and not confirmed and len(fit.interpretations) == 1:
        why = "no cone has all of it: elsewhere on its sides no feature of the same cone is touched"
        return Findings(status="unsuited", reason=why)
    if fit is None:
        return Findings(status="unsuited", reason=why)
    figures = _figures(fit)
    if fit.residual_sigma > UNSUITED:
        why = (
            f"its features are no cone's: together they are {fit.residual_sigma:.1f} standard "
            "deviations off the best one"
        )
        return Findings(status="unsuited", reason=why, figures=figures)
    names = " ".join(one.name for one in fit.features)
    if len(fit.interpretations) > 1:
        why = f"{names} leave {len(fit.interpretations)} cones: {'; '.join(fit.interpretations)}"
        return Findings(status="incomplete", reason=why, figures=figures)
    reason = f"axis and apex follow from {names}"
    return Findings(status="done", reason=reason, shape=fit, figures=figures)


def _closing(
    setting: TouchSetting, top: Floats, closing: float, down: float
) -> Generator[Move, Met, list[Contact]]:
    """What three fingers meet that close on the sides, evenly around, so far below the top, m."""
    height = max(top[2] - down, setting.platform + LEAST_HEIGHT)
    place = np.array([top[0], top[1], height])
    moves = []
    for finger in range(FINGERS):
        azimuth = closing * TURN + 2.0 * math.pi * finger / FINGERS
        way = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        moves.append(kept_clear(setting, approach(place, way, 0.9 * setting.reach, 0.0)))
    possible = tuple(one for one in moves if one is not None)
    if len(possible) < FINGERS:
        return []
    met = yield from touch_pair(possible)
    return [one for one in met if one.met]


def _end_face(
    setting: TouchSetting, contacts: list[Contact]
) -> Generator[Move, Met, list[Contact]]:
    """A touch from above in the middle of the sides, where the first one met no face."""
    first = _read(setting, contacts[0]).feature
    if len(contacts) < FINGERS or (first is not None and first.group == "F"):
        return []
    place = np.mean([one.middle for one in contacts[1:]], axis=0)
    place[2] = max(one.middle[2] for one in contacts)
    contact = yield from touch(setting, approach(place, UP, STANDOFF, 2.0 * STANDOFF))
    if not contact.met:
        return []
    return [(yield from square_on(setting, contact))]


def _read(setting: TouchSetting, contact: Contact) -> ContactFeature:
    return feature_of_contact(
        contact.kind,
        contact.points,
        contact.normal,
        principal=contact.curvatures,
        principal_error=contact.curvature_errors,
        principal_direction=contact.direction,
        noise=setting.noise,
    )


def recovered(setting: TouchSetting, contacts: list[Contact]) -> tuple[ConePoseFit | None, str]:
    """The cone that contacts let recover; or None and why not, in a sentence."""
    read = [_read(setting, one) for one in contacts]
    features = [one.feature for one in read if one.feature is not None]
    if len(features) < FINGERS:
        told = next((one.reason for one in read if one.feature is None), "")
        return None, f"{len(features)} of {len(contacts)} touches met a feature of a cone: {told}"
    bent = [one.reason for one in read if one.reason.startswith("curved both ways")]
    if len(bent) >= BENT:
        return None, f"no cone is what {len(bent)} touches met: {bent[0]}"
    noise = _angle_noise(setting, contacts), max(setting.point_error, LEAST_ERROR)
    fit, why = _solved(features, noise)
    if fit is None:  # edges and vertices tell more than faces, and are the first to be misread
        clear = [one for one in features if one.group in CLEAR]
        if FINGERS <= len(clear) < len(features):
            fit, other = _solved(clear, noise)
            why = why if fit is None else other
    return fit, why


def _solved(features: list[Feature], noise: tuple[float, float]) -> tuple[ConePoseFit | None, str]:
    """The cone of features whose places are not known; or None and why there is none."""
    angle, position = noise
    found = interpretations(features[:COMPARED], angle_noise=angle, position_noise=position)
    standing = [one for one in found if one.stands]
    if not standing:
        names = " ".join(one.name for one in features[:COMPARED])
        return None, f"no cone has {names} as they were touched: {'; '.join(found[0].refusals)}"
    solved = [one for one in standing if one.orientation is not None and one.origin is not None]
    if not solved:
        return None, _refusal(standing[0], noise)
    kept = _distinct([one for one in solved
                      if one.residual_sigma <= solved[0].residual_sigma + ALIKE])  # fmt: skip
    placed = _all_placed(kept[0], features, noise)
    if placed is None:
        names = " ".join(one.name for one in kept[0].features)
        return None, f"no cone has all of it: what else was touched is not on that of {names}"
    try:
        orientation, origin = solve_orientation(placed, *noise), solve_origin(placed, *noise)
    except InsufficientFeaturesError as error:
        return None, str(error)
    spread = math.sqrt(float(np.linalg.eigvalsh(origin.covariance)[-1]))
    for one in placed:
        if one.place in ("T", "B") and len(one.normals) == 1:
            off = abs(float((origin.point - one.point) @ one.normals[0]))
            if off < max(UNSUITED * spread, LEAST_ROOM):
                return None, f"the apex is on the plane of {one.name}, within its error: no cone is"
    angles = tuple(one.half_angle for one in scaled_radii(placed, orientation, origin))
    readings = tuple(one.name for one in kept)
    residual = residual_sigma(orientation, origin)
    return ConePoseFit(orientation, origin, tuple(placed), angles, readings, residual), ""


def _angle_noise(setting: TouchSetting, contacts: list[Contact]) -> float:
    """Standard deviation of a measured direction, rad: the pose's, and the taxels'."""
    own = []
    for one in contacts:
        error = one.normal_error if one.normal_error < 1.0 else 0.0
        apart = one.curvatures[0] - one.curvatures[1]
        if one.kind == "smooth" and apart > 4.0 * max(one.curvature_errors):
            error = math.hypot(error, one.curvature_errors[1] / apart)
        own.append(error)
    return math.hypot(setting.angle_error, float(np.sqrt(np.mean(np.square(own)))), LEAST_ERROR)


def _refusal(standing: Interpretation, noise: tuple[float, float]) -> str:
    """Why an interpretation that stands gives no cone."""
    try:
        solve_orientation(standing.features, *noise)
        solve_origin(standing.features, *noise)
    except InsufficientFeaturesError as error:
        return str(error)
    return "neither axis nor apex follow"


def _distinct(solved: list[Interpretation]) -> list[Interpretation]:
    """Interpretations that mean different cones."""
    kept: list[Interpretation] = []
    for one in solved:
        assert one.orientation is not None and one.origin is not None
        for other in kept:
            assert other.orientation is not None and other.origin is not None
            leans = math.acos(min(abs(float(one.orientation.axis @ other.orientation.axis)), 1.0))
            apart = np.linalg.norm(one.origin.point - other.origin.point)
            if leans < SAME_AXIS and apart < SAME_APEX:
                break
        else:
            kept.append(one)
    return kept


def _all_placed(
    chosen: Interpretation, features: list[Feature], noise: tuple[float, float]
) -> list[Feature] | None:
    """All features with places: those beyond the compared ones where they fit best.

    None if a face or a parabolic point is nowhere on the cone; edges and vertices may be misread.
    """
    placed = list(chosen.features)
    for feature in features[len(placed) :]:
        tried = interpretations(
            [*placed[: COMPARED - 1], feature], angle_noise=noise[0], position_noise=noise[1]
        )
        standing = [one for one in tried if one.stands]
        if standing:
            placed.append(replace(feature, place=standing[0].features[-1].place))
        elif feature.group in CLEAR:
            return None
    return placed


def _figures(fit: ConePoseFit) -> dict[str, float]:
    spread = np.linalg.eigvalsh(fit.orientation.covariance)[-1]
    told = {
        "features": float(len(fit.features)),
        "axis_error_deg": math.degrees(math.sqrt(max(float(spread), 0.0))),
        "apex_error_m": math.sqrt(float(np.linalg.eigvalsh(fit.origin.covariance)[-1])),
        "residual_sigma": fit.residual_sigma,
    }
    if fit.half_angles:
        told["half_angle_deg"] = math.degrees(float(np.mean(fit.half_angles)))
    return told
