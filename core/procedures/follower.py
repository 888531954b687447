"""Surface Contour Follower: thumb and index along an axis that they find (Allen).

Thumb and index close on the object as a pair, are lifted, and move along the axis until one of them
makes no contact. In the text the axis is given, and a contact has the height of its finger. Here
pairs all around give a first axis, which the fit then adjusts with everything else, and each
touched taxel counts where it is: on a sloping side it is millimetres off the finger. The pair turns
as it moves, so that a section that is not round shows. Fung, 1999, 1.4.3.2.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.poses import axes_along
from palpate.core.procedures.cone_choice import (
    DEFAULT_CONE_CHOICE,
    KINDS,
    ConeChoiceSettings,
    best_axis,
    best_cone,
    is_on_side,
    misfit,
)
from palpate.core.procedures.cone_ends import (
    DEFAULT_CONE_ENDS,
    ConeEndSettings,
    EndError,
    squared_cone,
    touched_end,
)
from palpate.core.procedures.generalised_cones import ConeFit, ConeKind, cone_mesh
from palpate.core.procedures.protocol import (
    Contact,
    Exploration,
    Findings,
    FingerMove,
    Move,
    MoveResult,
    TouchSetup,
    approach,
    clear_of_platform,
    touch_from_above,
    touch_pair,
)

GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))  # [rad] turn of the pair between two heights
Pair = tuple[Contact, ...]  # contacts of thumb and index
Residuals = Mapping[ConeKind, float]  # [m] root mean square, of each kind of cone


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstPairSettings:
    """Where thumb and index close before an axis is known."""

    depths: tuple[float, ...] = (18.0e-3, 38.0e-3)  # [m] below the top
    n_azimuths: int = 3  # at each depth; as many pairs must touch the sides
    min_height: float = 0.3  # fraction of the top's height over the platform
    clearance: float = 0.01  # [m] above the platform, at least


@dataclass(frozen=True, slots=True, kw_only=True)
class LeaningSettings:
    """How pairs that are square to the profile touch the side beyond its ends."""

    max_pairs: int = 8  # at each end
    step: float = 0.25  # fraction of the pad's width, between two pairs
    slope_distance: float = 0.5e-3  # [m] to both sides, over which the profile's slope is taken
    max_slope: float = 4.0  # [1] of the profile; a steeper place is not touched


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowerSettings:
    """How thumb and index follow an axis, and which solid is fitted to their contacts."""

    first: FirstPairSettings = FirstPairSettings()
    leaning: LeaningSettings = LeaningSettings()
    choice: ConeChoiceSettings = DEFAULT_CONE_CHOICE
    ends: ConeEndSettings = DEFAULT_CONE_ENDS
    max_opening: float = 0.9  # fraction of the fingers' reach, the farthest start of a finger
    ample_radius: float = 1.5  # times the expected radius, plus the standoff: its first start
    step: float = 0.45  # fraction of the pad's width, between two pairs along the axis
    min_step: float = 0.1  # fraction of the pad's width, to which a step is halved at an end
    max_pairs: int = 120  # along the axis
    min_pairs: int = 6  # that determine an axis and a profile
    n_turns: int = 12  # directions of a pair, tried where the platform is in the way
    max_axis_error: float = math.radians(1.0)  # [rad] beyond it a plane end gives the axis
    max_untouched: float = 3.0e-3  # [m] of height, beyond which an untouched part is reported


def follower(setup: TouchSetup, settings: FollowerSettings = FollowerSettings()) -> Exploration:
    """Follow the contour on both sides, with two fingers, and fit a generalised cone.

    Findings: a `ConeFit`, or ``unsuited`` if none fits to three standard deviations.
    """
    choice = settings.choice
    if setup.fingers < 2:
        return Findings(status="unsuited", reason="thumb and index are two fingers, there is one")
    first = yield from touch_from_above(setup)
    if first is None:
        return Findings(status="incomplete", reason="nothing was touched within reach")
    pairs = yield from _first_pairs(setup, first.middle, settings)
    if len(pairs) < settings.first.n_azimuths:
        return Findings(status="unsuited", reason="thumb and index do not both touch its sides")
    axis = best_axis(setup, [contact for pair in pairs for contact in pair], choice)
    if axis is None:
        return Findings(status="unsuited", reason="no axis fits the contacts of thumb and index")
    followed = yield from _along_axis(setup, axis, settings)
    if len(followed) < settings.min_pairs:
        reason = f"thumb and index touch its sides at {len(followed)} heights only"
        return Findings(status="unsuited", reason=reason)
    contacts = (contact for pair in (*pairs, *followed) for contact in pair)
    touches = [c.points for c in contacts if is_on_side(c, axis.axis, choice)]
    fit, residuals = best_cone(setup, touches, axis, choice)
    reason = misfit(setup, fit, residuals)
    if not reason and fit.kind != "linear":
        touches += yield from _leaning(setup, fit, settings.leaning)
        fit, residuals = best_cone(setup, touches, fit, choice)
        reason = misfit(setup, fit, residuals)
    if not reason and fit.kind != "revolution" and fit.axis_error > settings.max_axis_error:
        squared = yield from squared_cone(setup, fit, touches, choice, settings.ends)
        if squared is None:
            reason = (
                f"its sides are not round and leave the axis open by "
                f"{math.degrees(fit.axis_error):.1f} degrees, and no plane end was touched"
            )
        fit = squared or fit
    if reason:
        return Findings(status="unsuited", reason=reason, figures=_figures(fit, residuals))
    return (yield from _closed(setup, fit, residuals, touches, settings))


def _closed(
    setup: TouchSetup,
    fit: ConeFit,
    residuals: Residuals,
    touches: list[Floats],
    settings: FollowerSettings,
) -> Exploration:
    """Touch both ends, and close the solid."""
    figures, ends = _figures(fit, residuals), []
    try:
        for sign in (-1.0, 1.0):
            ends.append((yield from touched_end(setup, fit, sign, settings.ends)))
    except EndError as error:
        return Findings(status="unsuited", reason=str(error), figures=figures)
    untouched = [end.untouched for end in ends]
    heights = np.sort((np.concatenate(touches) - fit.point) @ fit.axis)
    band = float(np.diff(heights).max())
    reason = f"{KINDS[fit.kind]} fits all {len(touches)} touches"
    if band > settings.max_untouched:
        reason += f"; an untouched band of {1e3 * band:.0f} mm around it is bridged"
    if max(untouched) > settings.max_untouched:
        total = 1e3 * sum(untouched)
        reason += f"; {total:.0f} mm at its ends are not touched and taken for straight"
    return Findings(
        status="done",
        reason=reason,
        shape=fit,
        mesh=cone_mesh(fit, ends[0].shape, ends[1].shape),
        figures={**figures, "untouched_m": sum(untouched), "untouched_band_m": band},
    )


def _pair(
    setup: TouchSetup, middle: Floats, direction: Floats, distance: float
) -> Generator[Move, MoveResult, Pair | None]:
    """Close thumb and index on a place (3,) from both sides; None if there is no room.

    Each begins at `distance` [m] from the place, and misses if it gets as far as the place.
    """
    moves = [
        clear_of_platform(setup, approach(middle, side * direction, distance, 0.0))
        for side in (1.0, -1.0)
    ]
    thumb, index = moves
    if thumb is None or index is None or min(thumb.reach, index.reach) < 0.99 * distance:
        return None
    contacts = yield from touch_pair((thumb, index))
    return contacts


def _first_pairs(
    setup: TouchSetup, top: Floats, settings: FollowerSettings
) -> Generator[Move, MoveResult, list[Pair]]:
    """Pairs all around, at several depths below the place that was touched from above."""
    pairs, first, count = list[Pair](), settings.first, settings.first.n_azimuths
    lowest = setup.platform + first.min_height * (top[2] - setup.platform)
    for number, depth in enumerate(first.depths):
        height = max(top[2] - depth, lowest)
        for turn in range(count):
            azimuth = math.pi * (turn + 0.5 * number) / count
            direction = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
            z = max(height, setup.platform + first.clearance)
            place, distance = np.array([top[0], top[1], z]), settings.max_opening * setup.reach
            pair = yield from _pair(setup, place, direction, distance)
            if pair is not None and all(contact.is_hit for contact in pair):
                pairs.append(pair)
    return pairs


def _along_axis(
    setup: TouchSetup, axis: ConeFit, settings: FollowerSettings
) -> Generator[Move, MoveResult, list[Pair]]:
    """Pairs along the axis, from its middle to both ends, until a finger makes no contact.

    There the step is halved until it is too small, so that the last pair is near the end.
    """
    frame, start = axes_along(axis.axis), 0.5 * (axis.low + axis.high)
    full, least = settings.step * setup.width, settings.min_step * setup.width
    pairs: list[Pair] = []
    for sign in (1.0, -1.0):
        step, height = full, start - 0.5 * sign * settings.step * setup.width
        while step > least and len(pairs) < settings.max_pairs:
            next_height, number = height + sign * step, len(pairs)
            pair = yield from _turned_pair(setup, axis, frame, next_height, number, settings)
            if pair is None:
                step *= 0.5
                continue
            pairs.append(pair)
            height += sign * step
    return pairs


def _turned_pair(
    setup: TouchSetup,
    axis: ConeFit,
    frame: Floats,
    height: float,
    number: int,
    settings: FollowerSettings,
) -> Generator[Move, MoveResult, Pair | None]:
    """A pair at a height that touches the side; None if a finger does not, or has no room.

    It begins near the expected radius, and again from as far as possible if that is inside.
    """
    middle = axis.point + height * axis.axis
    radius = float(axis.radius(np.array([axis.low, axis.high]), np.zeros(2)).max())
    farthest = settings.max_opening * setup.reach
    near = min(settings.ample_radius * radius + setup.common.standoff, farthest)
    for distance in (near, farthest):
        for direction in _directions(frame, number, settings.n_turns):
            pair = yield from _pair(setup, middle, direction, distance)
            if pair is not None:
                break
        if pair is None or not any(contact.outcome == "inside" for contact in pair):
            break
    if pair is None:
        return None
    return pair if all(is_on_side(c, axis.axis, settings.choice) for c in pair) else None


def _directions(frame: Floats, number: int, n_turns: int) -> Iterator[Floats]:
    """Directions across the axis in which a pair may close, the preferred one first."""
    for turn in range(n_turns):
        angle = number * GOLDEN_ANGLE + math.pi * turn / n_turns
        yield math.cos(angle) * frame[:, 0] + math.sin(angle) * frame[:, 1]


def _leaning(
    setup: TouchSetup, fit: ConeFit, settings: LeaningSettings
) -> Generator[Move, MoveResult, list[Floats]]:
    """Touches beyond both ends of the side, by a pair that is square to the profile there.

    Where a side flares or closes, a finger square to the axis touches only its widest place.
    """
    touches: list[Floats] = []
    for sign in (1.0, -1.0):
        end = fit.high if sign > 0.0 else fit.low
        for number in range(settings.max_pairs):
            height = end + sign * (number - 1) * settings.step * setup.width
            angle = len(touches) * GOLDEN_ANGLE
            thumb = _square_move(setup, fit, height, angle, settings)
            index = _square_move(setup, fit, height, angle + math.pi, settings)
            if thumb is None or index is None:
                break
            pair = yield from touch_pair((thumb, index))
            heights = [sign * (c.points - fit.point) @ fit.axis for c in pair if c.is_hit]
            if len(heights) < 2 or max(values.max() for values in heights) < sign * end:
                break
            touches += [contact.points for contact in pair if contact.kind == "smooth"]
    return touches


def _square_move(
    setup: TouchSetup, fit: ConeFit, height: float, azimuth: float, settings: LeaningSettings
) -> FingerMove | None:
    """The move square to the profile at a height [m] and azimuth [rad]; None if it is no side."""
    distance, standoff = settings.slope_distance, setup.common.standoff
    radii = fit.radius(height + distance * np.array([-1.0, 1.0]), np.full(2, azimuth))
    slope = float(radii[1] - radii[0]) / (2.0 * distance)
    if radii.min() <= 0.0 or abs(slope) > settings.max_slope:
        return None
    across = fit.across @ [math.cos(azimuth), math.sin(azimuth)]
    outward = (across - slope * fit.axis) / math.hypot(1.0, slope)
    place = fit.point + height * fit.axis + radii.mean() * across
    move = clear_of_platform(setup, approach(place, outward, 2.0 * standoff, 0.5 * standoff))
    return move if move is not None and move.reach > 2.0 * standoff else None


def _figures(fit: ConeFit, residuals: Residuals) -> dict[str, float]:
    return {
        "residual_rms_m": fit.rms,
        "residual_worst_m": fit.worst,
        "axis_error_deg": math.degrees(fit.axis_error),
        **{f"residual_{kind}_m": rms for kind, rms in residuals.items()},
    }
