"""Surface Contour Follower: thumb and index along an axis that they find (Allen).

Thumb and index close on the object as a pair, are lifted, and go on along the axis until one of
them fails to make contact. The text is given the axis, and takes the height of a contact for that
of the finger; here pairs all around give a first axis, which the fit moves with everything else,
and every touched taxel counts where it is: on a sloping side the finger is off by millimetres. The
pair turns as it goes, so that a section that is not round shows. Fung, 1999, 1.4.3.2.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.grasp import revolution_axis
from palpate.core.poses import axes_along
from palpate.core.procedures.generalised_cones import (
    ConeFit,
    ConeKind,
    RoundEnd,
    cone_mesh,
    fit_cone,
    fit_round_end,
    side_points,
    widest_gap,
)
from palpate.core.procedures.polyhedron import fit_plane
from palpate.core.procedures.protocol import (
    STANDOFF,
    UNSUITED,
    UP,
    WORST,
    Contact,
    Exploration,
    Findings,
    FingerMove,
    Met,
    Move,
    TouchSetting,
    approach,
    kept_clear,
    touch,
    touch_from_above,
    touch_pair,
)

DOWN = (18.0e-3, 38.0e-3)  # Below what was touched from above, m: where the first pairs close
FIRST = 3  # Azimuths of the first pairs, at each height
SIDE = math.cos(math.radians(25.0))  # Of a normal along the axis: what leans more is an end
STEP, LEAST_STEP = 0.45, 0.1  # Of the pad's width, along the axis between two pairs
END_COST = 0.2  # Standard deviations that each contact costs which is of no use to an axis
MOST_LEANING, LEAN_STEP = 8, 0.25  # Pairs beyond an end, and their step over the pad's width
SLOPE, MOST_SLOPE = 0.5e-3, 4.0  # Over which a profile's slope is taken, m; it is no side beyond
FEW_HARMONICS = 3  # Of a section, while there are few contacts
GAP = math.radians(40.0)  # Wider untouched turns leave a section open
PLANE = 0.5  # Standard deviations, rms, that an end may rise and fall, and be plane
SQUARE = math.cos(math.radians(2.0))  # Of a plane end, and the axis
FEW_POINTS = 12  # Of a touch: fewer tell nothing
GOLDEN = math.pi * (3.0 - math.sqrt(5.0))  # Turn of the pair from one to the next, rad
TURNS = 12  # Turns that are tried where the platform is in the way
MOST_PAIRS = 120
AMPLE = 1.5  # Times the expected radius at which a pair opens
FEWEST = 6  # Pairs that tell an axis and a profile
ENOUGH = 1.25  # Times the residual of the best kind, and
LITTLE = 0.2  # standard deviations besides: then a simpler kind will do
KINDS: dict[ConeKind, str] = {
    "revolution": "a surface of revolution",
    "linear": "a linear generalised cone",
    "free": "a straight homogeneous generalised cone",
}
ROUGH_KINDS: tuple[ConeKind, ...] = ("revolution", "linear")  # Told by few contacts
LOOSE = math.radians(1.0)  # An axis that is not better known is that of a plane end
RIM = 0.3  # Of the pad's width: so near to an end of the side a touch may reach over its rim
BESIDE = 0.6  # Of the radius: where a plane end is touched besides its middle
FEW_HOLLOW = 6  # Taxels that touch nothing, between others: there is a hole
HOLLOW = 3.0e-3  # Below the end of the side, m: there a finger has fallen in
OPEN_END = 3.0e-3  # Of a side, m: what is not touched for longer is told
TALL = 1.0 - 1e-3  # Cosine of the lean of an axis on which the object stands upright


class SideEnd(NamedTuple):
    """An end of the cone."""

    shape: float | RoundEnd  # Where it is plane, m, or how it is round
    untouched: float  # Height of the side before it that nothing touched, m


def follower(setting: TouchSetting) -> Exploration:
    """Follow the contour on both sides, with two fingers, and fit a generalised cone.

    Findings: a `ConeFit`, or ``unsuited`` for what none fits to three standard deviations.
    """
    if setting.fingers < 2:
        return Findings(status="unsuited", reason="thumb and index are two fingers, there is one")
    first = yield from touch_from_above(setting)
    if first is None:
        return Findings(status="incomplete", reason="nothing was touched within reach")
    pairs = yield from _first_pairs(setting, first.middle)
    if len(pairs) < FIRST:
        return Findings(status="unsuited", reason="thumb and index do not both touch its sides")
    axis = best_axis(setting, [one for pair in pairs for one in pair])
    if axis is None:
        return Findings(status="unsuited", reason="no axis is found in what thumb and index touch")
    followed = yield from _along(setting, axis)
    sides = [one for pair in (*pairs, *followed) for one in pair if _on_side(one, axis.axis)]
    if len(followed) < FEWEST:
        told = f"thumb and index touch its sides at {len(followed)} heights only"
        return Findings(status="unsuited", reason=told)
    touches = [one.points for one in sides]
    fit, others = best_cone(setting, touches, axis)
    why = _misfit(setting, fit, others)
    if not why and fit.kind != "linear":
        touches += yield from _leaning(setting, fit)
        fit, others = best_cone(setting, touches, fit)
        why = _misfit(setting, fit, others)
    if not why and fit.kind != "revolution" and fit.axis_error > LOOSE:
        found = yield from _squared(setting, fit, touches)
        if found is None:
            why = (
                f"its sides are not round and leave the axis open by "
                f"{math.degrees(fit.axis_error):.1f} degrees, and no plane end was touched"
            )
        fit = found or fit
    if why:
        return Findings(status="unsuited", reason=why, figures=_figures(fit, others))
    return (yield from _closed(setting, fit, others, touches))


def _closed(
    setting: TouchSetting, fit: ConeFit, others: dict[ConeKind, float], touches: list[Floats]
) -> Exploration:
    """Touch both ends, and close the solid."""
    ends = []
    try:
        for sign in (-1.0, 1.0):
            ends.append((yield from _end(setting, fit, sign)))
    except EndError as error:
        return Findings(status="unsuited", reason=str(error), figures=_figures(fit, others))
    untouched = [one.untouched for one in ends]
    told = f"{KINDS[fit.kind]} fits all {len(touches)} touches"
    heights = np.sort((np.concatenate(touches) - fit.point) @ fit.axis)
    band = float(np.diff(heights).max())
    if band > OPEN_END:
        told += f"; a band of {1e3 * band:.0f} mm around it touches nothing, and is bridged"
    if max(untouched) > OPEN_END:
        told += (
            f"; {1e3 * sum(untouched):.0f} mm at its ends are not touched and taken for straight"
        )
    return Findings(
        status="done",
        reason=told,
        shape=fit,
        mesh=cone_mesh(fit, ends[0].shape, ends[1].shape),
        figures={**_figures(fit, others), "untouched_m": sum(untouched), "untouched_band_m": band},
    )


def _pair(
    setting: TouchSetting, middle: Floats, way: Floats, far: float
) -> Generator[Move, Met, tuple[Contact, ...] | None]:
    """Close thumb and index on a place (3,) from `far` on both sides, m; None if there is no room.

    A finger that goes on for as far as it is from the middle has missed.
    """
    moves = [kept_clear(setting, approach(middle, side * way, far, 0.0)) for side in (1.0, -1.0)]
    thumb, index = moves
    if thumb is None or index is None or min(thumb.reach, index.reach) < 0.99 * far:
        return None
    met = yield from touch_pair((thumb, index))
    return met


def _first_pairs(
    setting: TouchSetting, top: Floats
) -> Generator[Move, Met, list[tuple[Contact, ...]]]:
    """Pairs all around, at two heights below the place that was touched from above."""
    found = []
    for number, down in enumerate(DOWN):
        height = max(top[2] - down, setting.platform + 0.3 * (top[2] - setting.platform))
        for turn in range(FIRST):
            azimuth = math.pi * (turn + 0.5 * number) / FIRST
            way = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
            place = np.array([top[0], top[1], max(height, setting.platform + 0.01)])
            met = yield from _pair(setting, place, way, 0.9 * setting.reach)
            if met is not None and all(one.met for one in met):
                found.append(met)
    return found


def best_axis(setting: TouchSetting, contacts: list[Contact]) -> ConeFit | None:
    """The generalised cone whose axis suits contacts best, of several that they suggest."""
    points = np.array([one.middle for one in contacts])
    normals = np.array([one.normal for one in contacts])
    middles = 0.5 * (points[::2] + points[1::2])
    ways = np.linalg.svd(middles - middles.mean(axis=0))[2]
    starts = [*np.eye(3), ways[0]]
    found = revolution_axis(points, normals, np.array(starts))
    fits: list[tuple[float, ConeFit]] = []
    for point, axis in (
        (found.point, found.axis),
        *((middles.mean(axis=0), one) for one in starts),
    ):
        sides = [one.points for one in contacts if _on_side(one, axis)]
        # What an axis calls an end does not speak for it.
        ends = END_COST * (len(contacts) - len(sides)) * setting.sigma
        for kind in ROUGH_KINDS if len(sides) >= 4 else ():
            fit = fit_cone(sides, kind, point, axis, setting.sigma, FEW_HARMONICS)
            fits.append((fit.rms + ends, fit))
    return min(fits, key=lambda one: one[0])[1] if fits else None


def _on_side(contact: Contact, axis: Floats) -> bool:
    """Whether a contact is one of the side, and not of an end."""
    return contact.met and abs(float(contact.normal @ axis)) < SIDE


def _along(setting: TouchSetting, axis: ConeFit) -> Generator[Move, Met, list[tuple[Contact, ...]]]:
    """Pairs along the axis, from its middle to both ends, until a finger fails to make contact.

    Then the step is halved twice, so that the last pair is near the end.
    """
    frame, start = axes_along(axis.axis), 0.5 * (axis.low + axis.high)
    found: list[tuple[Contact, ...]] = []
    for sign in (1.0, -1.0):
        step, height = STEP * setting.width, start - 0.5 * sign * STEP * setting.width
        while step > LEAST_STEP * setting.width and len(found) < MOST_PAIRS:
            met = yield from _turned_pair(setting, axis, frame, height + sign * step, len(found))
            if met is None:
                step *= 0.5
                continue
            found.append(met)
            height += sign * step
    return found


def _turned_pair(
    setting: TouchSetting, axis: ConeFit, frame: Floats, height: float, number: int
) -> Generator[Move, Met, tuple[Contact, ...] | None]:
    """A pair at a height that touches the side; None where a finger does not, or has no room.

    It begins near what the first pairs let expect, and anew from far off if that is inside.
    """
    middle = axis.point + height * axis.axis
    wide = float(axis.radius(np.array([axis.low, axis.high]), np.zeros(2)).max())
    farthest = 0.9 * setting.reach
    for far in (min(AMPLE * wide + STANDOFF, farthest), farthest):
        for way in _ways(frame, number):
            met = yield from _pair(setting, middle, way, far)
            if met is not None:
                break
        if met is None or not any(one.outcome == "inside" for one in met):
            break
    if met is None or not all(_on_side(one, axis.axis) for one in met):
        return None
    return met


def _ways(frame: Floats, number: int) -> Iterator[Floats]:
    """Directions across the axis in which a pair may close, the wanted one first."""
    for turn in range(TURNS):
        angle = number * GOLDEN + math.pi * turn / TURNS
        yield math.cos(angle) * frame[:, 0] + math.sin(angle) * frame[:, 1]


def _leaning(setting: TouchSetting, fit: ConeFit) -> Generator[Move, Met, list[Floats]]:
    """Touches beyond both ends of the side, by a pair that leans as the profile does there.

    Where a side flares or closes, a finger that stands upright touches its widest place alone.
    """
    found: list[Floats] = []
    for sign in (1.0, -1.0):
        end = fit.high if sign > 0.0 else fit.low
        for number in range(MOST_LEANING):
            height = end + sign * (number - 1) * LEAN_STEP * setting.width
            angle = len(found) * GOLDEN
            moves = [_square_move(setting, fit, height, angle + turn) for turn in (0.0, math.pi)]
            thumb, index = moves
            if thumb is None or index is None:
                break
            met = yield from touch_pair((thumb, index))
            heights = [sign * (one.points - fit.point) @ fit.axis for one in met if one.met]
            if len(heights) < 2 or max(one.max() for one in heights) < sign * end:
                break
            found += [one.points for one in met if one.kind == "smooth"]
    return found


def _square_move(
    setting: TouchSetting, fit: ConeFit, height: float, azimuth: float
) -> FingerMove | None:
    """The move that meets the profile squarely at a height, m, and an azimuth, rad."""
    near = fit.radius(height + SLOPE * np.array([-1.0, 1.0]), np.full(2, azimuth))
    slope = float(near[1] - near[0]) / (2.0 * SLOPE)
    if near.min() <= 0.0 or abs(slope) > MOST_SLOPE:
        return None
    across = fit.across @ [math.cos(azimuth), math.sin(azimuth)]
    outward = (across - slope * fit.axis) / math.hypot(1.0, slope)
    place = fit.point + height * fit.axis + near.mean() * across
    move = kept_clear(setting, approach(place, outward, 2.0 * STANDOFF, 0.5 * STANDOFF))
    return move if move is not None and move.reach > 2.0 * STANDOFF else None


def best_cone(
    setting: TouchSetting, touches: list[Floats], axis: ConeFit
) -> tuple[ConeFit, dict[ConeKind, float]]:
    """The simplest kind of cone that fits nearly as well as the best, and residuals of all, m.

    Points far off, where touches reach over the rim of an end, are left out of a second fit.
    """
    fits = []
    for kind in KINDS:
        fit = fit_cone(touches, kind, axis.point, axis.axis, setting.sigma)
        if fit.kind != "revolution" and widest_gap(fit, touches) > GAP:
            continue
        fits.append(refitted(setting, fit, touches))
    least = min(one.rms for one in fits)
    chosen = next(one for one in fits if one.rms <= ENOUGH * least + LITTLE * setting.sigma)
    return chosen, {one.kind: one.rms for one in fits}


def refitted(
    setting: TouchSetting, fit: ConeFit, touches: list[Floats], *, held: bool = False
) -> ConeFit:
    """The cone fitted again without points on the rims of its ends."""
    near, rim = UNSUITED * setting.sigma, RIM * setting.width
    sides = [side_points(fit, one, near, rim) for one in touches]
    sides = [one for one in sides if len(one) > FEW_POINTS]
    if len(sides) < 4:
        return fit
    return fit_cone(sides, fit.kind, fit.point, fit.axis, setting.sigma, held=held)


def _misfit(setting: TouchSetting, fit: ConeFit, others: dict[ConeKind, float]) -> str:
    """Why the object is no generalised cone; empty if it may be one."""
    sigma = setting.sigma
    if fit.rms <= UNSUITED * sigma and fit.worst <= WORST * sigma:
        return ""
    told = ", ".join(f"{kind} {1e3 * rms:.3f}" for kind, rms in others.items())
    return (
        f"no generalised cone fits: residuals in mm rms are {told}, of the worst touch "
        f"{1e3 * fit.worst:.3f}, where one standard deviation is {1e3 * sigma:.3f}"
    )


def _squared(
    setting: TouchSetting, fit: ConeFit, touches: list[Floats]
) -> Generator[Move, Met, ConeFit | None]:
    """The cone whose axis is square to a plane end; None if none is touched.

    Through an apex, any axis has a section of its own on the same surface: "end face is a necessary
    contact feature" (Fearing; Fung, 1999, 1.4.3.1).
    """
    for sign in (1.0, -1.0):
        move = _end_move(setting, fit, sign)
        if move is None:
            continue
        contact = yield from touch(setting, move)
        plane = end_plane(setting, contact)
        if plane is None:
            continue
        axis = plane if plane @ fit.axis > 0.0 else -plane
        turned = fit_cone(touches, fit.kind, fit.point, axis, setting.sigma, held=True)
        squared = refitted(setting, turned, touches, held=True)
        if squared.rms <= UNSUITED * setting.sigma:
            return squared._replace(
                axis_error=math.hypot(contact.normal_error, setting.angle_error)
            )
    return None


def _end_move(setting: TouchSetting, fit: ConeFit, sign: float) -> FingerMove | None:
    """The move along the axis to an end; None if there is no room."""
    middle = fit.point + (fit.high if sign > 0.0 else fit.low) * fit.axis
    return kept_clear(setting, approach(middle, sign * fit.axis, 3.0 * STANDOFF, STANDOFF))


def end_plane(setting: TouchSetting, contact: Contact) -> Floats | None:
    """The outward unit normal (3,) of an end, if it is plane where it is touched."""
    errors = setting.noise, setting.point_error, setting.angle_error
    if len(contact.points) < FEW_POINTS:
        return None
    found = fit_plane([contact.points], contact.normal, *errors)
    flat = max(4.0 * setting.noise, PLANE * setting.sigma)
    return found.plane.normal if found.rms <= flat else None


class EndError(Exception):
    """An end is none of a right cone."""


def _end(setting: TouchSetting, fit: ConeFit, sign: float) -> Generator[Move, Met, SideEnd]:
    """Touch an end along the axis, and once more on four sides if it is round."""
    outward = sign * fit.axis
    height = fit.high if sign > 0.0 else fit.low
    middle = fit.point + height * fit.axis
    if outward @ UP < -TALL and middle[2] < setting.platform + setting.width:
        floor = float((setting.platform - fit.point[2]) / fit.axis[2])
        return SideEnd(floor, abs(floor - height))
    move = _end_move(setting, fit, sign)
    if move is None:
        return SideEnd(height, setting.width)
    contact = yield from touch(setting, move)
    heights = (contact.points - fit.point) @ fit.axis
    far = float(sign * (sign * heights).max(initial=-math.inf))
    if sign * (far - height) < -HOLLOW:
        deep = STANDOFF if math.isinf(far) else abs(far - height)
        raise EndError(f"it is hollow: a finger falls {1e3 * deep:.0f} mm or more into its end")
    if len(contact.hollow) >= FEW_HOLLOW:
        raise EndError("it is hollow: taxels in the middle of its end touch nothing")
    plane = end_plane(setting, contact)
    if plane is not None and abs(plane @ fit.axis) > SQUARE:
        level = float(heights.mean())
        yield from _checked_level(setting, fit, sign, level)
        return SideEnd(level, abs(far - height))
    if plane is not None:
        lean = math.degrees(math.acos(min(abs(float(plane @ fit.axis)), 1.0)))
        raise EndError(f"its end leans by {lean:.0f} degrees: it is no right cone")
    points = [contact.points]
    for azimuth in (0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi):
        across = fit.across @ [math.cos(azimuth), math.sin(azimuth)]
        rim = fit.radius(np.array([height]), np.array([azimuth]))[0]
        place = fit.point + 0.5 * (height + far) * fit.axis + 0.7 * rim * across
        beside = (across + outward) / math.sqrt(2.0)
        move = kept_clear(setting, approach(place, beside, 2.0 * STANDOFF, STANDOFF))
        if move is not None:
            more = yield from touch(setting, move)
            points += [more.points] if more.met else []
    edge = height - 0.1 * sign * setting.width
    shape = fit_round_end(fit, np.concatenate(points), far, edge)
    closes = shape.radius(np.linspace(edge, far, 20))[:-1].all()
    if shape.rms > UNSUITED * setting.sigma or not closes:
        return SideEnd(height, abs(far - height))
    return SideEnd(shape, 0.0)


def _checked_level(
    setting: TouchSetting, fit: ConeFit, sign: float, level: float
) -> Generator[Move, Met, None]:
    """Touch a plane end beside its middle; EndError if it is not as high there, m."""
    for azimuth in (0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi):
        across = fit.across @ [math.cos(azimuth), math.sin(azimuth)]
        rim = fit.radius(np.array([level]), np.array([azimuth]))[0]
        place = fit.point + level * fit.axis + BESIDE * rim * across
        move = kept_clear(setting, approach(place, sign * fit.axis, 3.0 * STANDOFF, STANDOFF))
        if move is None:
            continue
        contact = yield from touch(setting, move)
        heights = sign * ((contact.points - fit.point) @ fit.axis - level)
        if abs(float(heights.max(initial=-STANDOFF))) > WORST * setting.sigma:
            raise EndError("its end is not plane: it is hollow, or raised, beside its middle")


def _figures(fit: ConeFit, others: dict[ConeKind, float]) -> dict[str, float]:
    return {
        "residual_rms_m": fit.rms,
        "residual_worst_m": fit.worst,
        "axis_error_deg": math.degrees(fit.axis_error),
        **{f"residual_{kind}_m": rms for kind, rms in others.items()},
    }
