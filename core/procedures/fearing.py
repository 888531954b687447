"""Three fingers on a cone: its axis and apex from a few contact features (Fearing).

Finger 1 searches for the object from above; then three fingers close on its sides at once, and each
touch is classified as a vertex, an edge, a face or a parabolic point. Which of them belong to the
top, the bottom or the sides is not known: all assignments that tables and geometry allow are
compared, and touches are added until one is left: `palpate.core.cones`; Fung, 1999, 1.4.3.1.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterable
from dataclasses import dataclass, replace
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
    UP,
    Contact,
    Exploration,
    Findings,
    Move,
    MoveResult,
    TouchSetup,
    approach,
    clear_of_platform,
    touch,
    touch_from_above,
    touch_pair,
    touch_squarely,
)

N_FINGERS = 3
CLEAR_GROUPS = "FP"  # features that are never misread: faces and parabolic points
Noise = tuple[float, float]  # standard deviations of a direction [rad] and of a coordinate [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class FearingSettings:
    """Where three fingers close on a cone, and which interpretations of their contacts count."""

    # [m] of each closing of three fingers below the place that was touched from above.
    depths: tuple[float, ...] = (18.0e-3, 32.0e-3, 12.0e-3, 25.0e-3)
    check_depth: float = 0.75  # fraction of the object's height, of the closing that verifies a fit
    min_height: float = 9.0e-3  # [m] of a closing above the platform
    turn: float = math.radians(25.0)  # [rad] of the fingers between two closings
    opening: float = 0.9  # fraction of the fingers' reach, from which they close
    min_apex_distance: float = 3.0e-3  # [m] of the apex from the plane of an end
    min_error: float = 1e-9  # [m] and [rad] of any standard deviation
    min_curved: int = 2  # touches that are curved both ways, which show that it is no cone
    max_relative_error: float = 0.25  # of a curvature difference; below it, directions are defined
    n_compared: int = 5  # features whose places are assigned in all ways
    residual_tolerance: float = 0.5  # [standard deviations] above the best; such ones are kept too
    same_axis: float = math.radians(3.0)  # [rad] between the axes of one cone
    same_apex: float = 5.0e-3  # [m] between the apices of one cone


class ConePoseFit(NamedTuple):
    """Axis and apex of a cone."""

    orientation: ConeOrientation
    origin: ConeOrigin
    features: tuple[Feature, ...]  # with their places
    half_angles: tuple[float, ...]  # [rad] of the touched meridians to the axis
    interpretations: tuple[str, ...]  # that geometry allows, the most likely first
    residual_sigma: float  # [standard deviations] root mean square of all features


def fearing(setup: TouchSetup, settings: FearingSettings = FearingSettings()) -> Exploration:
    """Close three fingers on a cone until its axis and apex are known.

    Findings: a `ConePoseFit`; or ``unsuited``, with what was touched and why it does not suffice
    or fit.
    """
    if setup.fingers < N_FINGERS:
        return Findings(status="unsuited", reason=f"it takes {N_FINGERS} fingers at once")
    first = yield from touch_from_above(setup)
    if first is None:
        return Findings(status="incomplete", reason="nothing was touched within reach")
    first = yield from touch_squarely(setup, first)
    contacts, reason, fit, is_confirmed = [first], "", None, False
    for closing, depth in enumerate(settings.depths):
        contacts += yield from _closing(setup, first.middle, closing, depth, settings)
        if closing == 0:
            contacts += yield from _end_face(setup, contacts)
        fit, reason = recovered(setup, contacts, settings)
        if fit is not None and len(fit.interpretations) == 1:
            # The same cone must be touched elsewhere on the sides, or it is not a cone.
            depth, known = settings.check_depth * (first.middle[2] - setup.platform), fit
            more = yield from _closing(setup, first.middle, closing + 0.5, depth, settings)
            fit, reason = recovered(setup, [*contacts, *more], settings)
            is_confirmed = fit is not None and len(fit.features) > len(known.features)
            break
    return _findings(setup, fit, reason, is_confirmed)


def _findings(
    setup: TouchSetup, fit: ConePoseFit | None, reason: str, is_confirmed: bool
) -> Findings:
    """The cone, unless it is unknown for a `reason`, refuted, or one of several."""
    if fit is None:
        return Findings(status="unsuited", reason=reason)
    count = len(fit.interpretations)
    if count == 1 and not is_confirmed:
        reason = "no cone fits all touches: elsewhere on the sides the same cone is not touched"
        return Findings(status="unsuited", reason=reason)
    figures, names = _figures(fit), " ".join(feature.name for feature in fit.features)
    if fit.residual_sigma > setup.common.max_rms:
        reason = (
            f"its features are no cone's: together they are {fit.residual_sigma:.1f} standard "
            "deviations off the best one"
        )
        return Findings(status="unsuited", reason=reason, figures=figures)
    if count > 1:
        reason = f"{names} leave {count} cones: {'; '.join(fit.interpretations)}"
        return Findings(status="incomplete", reason=reason, figures=figures)
    reason = f"axis and apex follow from {names}"
    return Findings(status="done", reason=reason, shape=fit, figures=figures)


def _closing(
    setup: TouchSetup, top: Floats, closing: float, depth: float, settings: FearingSettings
) -> Generator[Move, MoveResult, list[Contact]]:
    """Contacts of three fingers that close on the sides, evenly around, `depth` below the top [m].

    `closing`: its number, by which the fingers are turned.
    """
    height = max(top[2] - depth, setup.platform + settings.min_height)
    place = np.array([top[0], top[1], height])
    moves = []
    for finger in range(N_FINGERS):
        azimuth = closing * settings.turn + 2.0 * math.pi * finger / N_FINGERS
        outward = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        move = approach(place, outward, settings.opening * setup.reach, 0.0)
        moves.append(clear_of_platform(setup, move))
    possible = tuple(move for move in moves if move is not None)
    if len(possible) < N_FINGERS:
        return []
    contacts = yield from touch_pair(possible)
    return [contact for contact in contacts if contact.is_hit]


def _end_face(
    setup: TouchSetup, contacts: list[Contact]
) -> Generator[Move, MoveResult, list[Contact]]:
    """A touch from above in the middle of the sides, unless the first contact is a face."""
    first = _feature_of(setup, contacts[0]).feature
    if len(contacts) < N_FINGERS or (first is not None and first.group == "F"):
        return []
    place = np.mean([contact.middle for contact in contacts[1:]], axis=0)
    place[2] = max(contact.middle[2] for contact in contacts)
    standoff = setup.common.standoff
    contact = yield from touch(setup, approach(place, UP, standoff, 2.0 * standoff))
    if not contact.is_hit:
        return []
    return [(yield from touch_squarely(setup, contact))]


def _feature_of(setup: TouchSetup, contact: Contact) -> ContactFeature:
    return feature_of_contact(
        contact.kind,
        contact.points,
        contact.normal,
        principal=contact.curvatures,
        principal_error=contact.curvature_errors,
        principal_direction=contact.direction,
        noise=setup.noise,
    )


def recovered(
    setup: TouchSetup, contacts: list[Contact], settings: FearingSettings = FearingSettings()
) -> tuple[ConePoseFit | None, str]:
    """The cone that contacts determine; or None and the reason, in a sentence."""
    readings = [_feature_of(setup, contact) for contact in contacts]
    features = [reading.feature for reading in readings if reading.feature is not None]
    if len(features) < N_FINGERS:
        first = next((reading.reason for reading in readings if reading.feature is None), "")
        return None, f"{len(features)} of {len(contacts)} touches met a feature of a cone: {first}"
    reasons = [reading.reason for reading in readings]
    curved = [reason for reason in reasons if reason.startswith("curved both ways")]
    if len(curved) >= settings.min_curved:
        return None, f"no cone has the {len(curved)} curved touches: {curved[0]}"
    angle_noise = _angle_noise(setup, contacts, settings)
    noise = angle_noise, max(setup.point_error, settings.min_error)
    max_rms = setup.common.max_rms
    fit, reason = _solved(features, noise, max_rms, settings)
    if fit is None:  # edges and vertices say more than faces, but may be misread
        clear = [feature for feature in features if feature.group in CLEAR_GROUPS]
        if N_FINGERS <= len(clear) < len(features):
            fit, clear_reason = _solved(clear, noise, max_rms, settings)
            reason = reason if fit is None else clear_reason
    return fit, reason


def _solved(
    features: list[Feature], noise: Noise, max_rms: float, settings: FearingSettings
) -> tuple[ConePoseFit | None, str]:
    """The cone of features of unknown places; or None and the reason, in a sentence."""
    compared = features[: settings.n_compared]
    assigned = interpretations(compared, angle_noise=noise[0], position_noise=noise[1])
    possible = [assignment for assignment in assigned if assignment.is_possible]
    if not possible:
        violated = "; ".join(assigned[0].violations)
        return None, f"no cone has {_names(compared)} as they were touched; violated: {violated}"
    solved = [item for item in possible if item.orientation is not None and item.origin is not None]
    if not solved:
        return None, _missing_reason(possible[0], noise)
    max_residual = solved[0].residual_sigma + settings.residual_tolerance
    kept = _distinct([item for item in solved if item.residual_sigma <= max_residual], settings)
    placed = _all_placed(kept[0], features, noise, settings.n_compared)
    if placed is None:
        names = _names(kept[0].features)
        return None, f"no cone fits all touches: further ones are not on the cone of {names}"
    try:
        orientation, origin = solve_orientation(placed, *noise), solve_origin(placed, *noise)
    except InsufficientFeaturesError as error:
        return None, str(error)
    apex_error = math.sqrt(float(np.linalg.eigvalsh(origin.covariance)[-1]))
    min_distance = max(max_rms * apex_error, settings.min_apex_distance)
    for feature in placed:
        if feature.place in ("T", "B") and len(feature.normals) == 1:
            distance = abs(float((origin.point - feature.point) @ feature.normals[0]))
            if distance < min_distance:
                reason = f"the apex is on the plane of {feature.name}, within its error"
                return None, f"{reason}: it is no cone"
    angles = tuple(radius.half_angle for radius in scaled_radii(placed, orientation, origin))
    readings = tuple(item.name for item in kept)
    residual = residual_sigma(orientation, origin)
    return ConePoseFit(orientation, origin, tuple(placed), angles, readings, residual), ""


def _names(features: Iterable[Feature]) -> str:
    return " ".join(feature.name for feature in features)


def _angle_noise(setup: TouchSetup, contacts: list[Contact], settings: FearingSettings) -> float:
    """Standard deviation of a measured direction, from the pose and the taxels [rad]."""
    errors = []
    for contact in contacts:
        error = contact.normal_error if contact.normal_error < 1.0 else 0.0
        difference = contact.curvatures[0] - contact.curvatures[1]
        largest = max(contact.curvature_errors) / settings.max_relative_error
        if contact.kind == "smooth" and difference > largest:
            error = math.hypot(error, contact.curvature_errors[1] / difference)
        errors.append(error)
    rms = float(np.sqrt(np.mean(np.square(errors))))
    return math.hypot(setup.angle_error, rms, settings.min_error)


def _missing_reason(possible: Interpretation, noise: Noise) -> str:
    """Why a possible interpretation does not determine a cone."""
    try:
        solve_orientation(possible.features, *noise)
        solve_origin(possible.features, *noise)
    except InsufficientFeaturesError as error:
        return str(error)
    return "neither axis nor apex follow"


def _distinct(solved: list[Interpretation], settings: FearingSettings) -> list[Interpretation]:
    """Interpretations with different cones, the first of each."""
    kept: list[Interpretation] = []
    for item in solved:
        if not any(_is_same_cone(item, other, settings) for other in kept):
            kept.append(item)
    return kept


def _is_same_cone(item: Interpretation, other: Interpretation, settings: FearingSettings) -> bool:
    """Whether two interpretations have nearly the same axis and apex."""
    assert item.orientation is not None and item.origin is not None
    assert other.orientation is not None and other.origin is not None
    angle = math.acos(min(abs(float(item.orientation.axis @ other.orientation.axis)), 1.0))
    distance = float(np.linalg.norm(item.origin.point - other.origin.point))
    return angle < settings.same_axis and distance < settings.same_apex


def _all_placed(
    chosen: Interpretation, features: list[Feature], noise: Noise, n_compared: int
) -> list[Feature] | None:
    """All features with places: those after the compared ones where they fit best.

    None if a face or a parabolic point is nowhere on the cone. Edges and vertices that are nowhere
    on it are left out: they may be misread.
    """
    placed = list(chosen.features)
    for feature in features[len(placed) :]:
        assigned = interpretations(
            [*placed[: n_compared - 1], feature], angle_noise=noise[0], position_noise=noise[1]
        )
        possible = [assignment for assignment in assigned if assignment.is_possible]
        if possible:
            placed.append(replace(feature, place=possible[0].features[-1].place))
        elif feature.group in CLEAR_GROUPS:
            return None
    return placed


def _figures(fit: ConePoseFit) -> dict[str, float]:
    spread = np.linalg.eigvalsh(fit.orientation.covariance)[-1]
    figures = {
        "features": float(len(fit.features)),
        "axis_error_deg": math.degrees(math.sqrt(max(float(spread), 0.0))),
        "apex_error_m": math.sqrt(float(np.linalg.eigvalsh(fit.origin.covariance)[-1])),
        "residual_sigma": fit.residual_sigma,
    }
    if fit.half_angles:
        figures["half_angle_deg"] = math.degrees(float(np.mean(fit.half_angles)))
    return figures
