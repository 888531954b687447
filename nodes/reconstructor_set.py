"""From what was felt to a model: what touched an end, and in which frame it was sliced."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.frames import split_pose
from palpate.core.rebuild.coarse import fit_coarse
from palpate.core.rebuild.felt.felt_points import FeltPoints, stack_points
from palpate.core.rebuild.reconstruct import reconstruct
from palpate.core.rebuild.solid import Solid
from palpate.messages.types import Contour, Probe, Superquadric

CONTACT_ERROR = 0.1e-3
"""Standard deviation of a contact of the hand, m."""
UPRIGHT = 1e-12
"""By how much the cosine of an upright frame's lean may be less than 1."""
HIT = ("hit", "bottomed")
"""How a probe ended that met the object."""


def coarse_model(number: int, contacts: Floats) -> Superquadric:
    """The message for the superquadric through contacts (n, 3), m."""
    found = fit_coarse(contacts, CONTACT_ERROR)
    return Superquadric(
        number=number,
        size=found.size,
        exponents=found.exponents,
        pose=found.pose,
        taper=found.taper,
        bend=found.bend.curvature,
        bend_direction=found.bend.direction,
        doubts=found.doubts,
        residual=found.rms,
        residuals=found.residuals,
        rank=found.rank,
    )


def rebuilt_from(
    contours: Sequence[Contour],
    probes: Sequence[Probe],
    felt: Mapping[int, Sequence[FeltPoints]],
    platform: float,
) -> Solid:
    """The solid of a set.

    Parameters
    ----------
    contours : sequence of Contour
        At least one.
    probes : sequence of Probe
        Single touches beside them.
    felt : map
        What each touch of a contour or probe felt, by its number.
    platform : float
        Height on which the object stands, m.

    Raises
    ------
    ValueError
        If the contours were not traced in one frame, or as `reconstruct` does.
    """
    frame = frame_of(contours)
    numbers = [one.id for one in contours] + [one.id for one in probes]
    touched = [each for number in numbers for each in felt[number]]
    return reconstruct(
        [contour.points for contour in contours],
        patches=stack_points(touched),
        tops=touched_ends(contours, probes, felt, platform),
        frame=frame,
    )


def frame_of(contours: Sequence[Contour]) -> Floats:
    """Pose (7,) of the frame in which all contours were traced.

    Raises
    ------
    ValueError
        If they were not all traced in the same.
    """
    first = contours[0]
    for other in contours[1:]:
        if not np.array_equal(other.frame, first.frame):
            raise ValueError(
                f"contours must be traced in one slicing frame, but that of contour {other.id} "
                f"is not that of contour {first.id}"
            )
    return first.frame


def is_upright(frame: Floats) -> bool:
    """Whether heights in a frame are the world's, so that an object stands on its lower end."""
    return bool(split_pose(frame)[1][2, 2] >= 1.0 - UPRIGHT)


def touched_ends(
    contours: Sequence[Contour],
    probes: Sequence[Probe],
    felt: Mapping[int, Sequence[FeltPoints]],
    platform: float | None,
) -> Floats | None:
    """Where the ends of an object were touched, (k, 3), m; None if they were not.

    Parameters
    ----------
    contours, probes, felt
        As for `rebuilt_from`; of probes that felt nothing known, their own point counts.
    platform : float or None
        Height on which the object stands, m, if that is known: a touch of its lower end if it
        stands upright.

    Raises
    ------
    ValueError
        If the contours were not traced in one frame.
    """
    frame = frame_of(contours)
    tops = list(_probed(contours, probes, felt, frame))
    if platform is not None and is_upright(frame):
        tops.append(np.array([*frame[:2], platform]))
    return np.array(tops) if tops else None


def _probed(
    contours: Sequence[Contour],
    probes: Sequence[Probe],
    felt: Mapping[int, Sequence[FeltPoints]],
    frame: Floats,
) -> Iterator[Floats]:
    """Farthest point (3,) of each probe that felt an end: beyond the contours."""
    position, axes = split_pose(frame)
    levels = [contour.height for contour in contours]
    low, high = min(levels), max(levels)
    for probe in probes:
        if probe.outcome not in HIT:
            continue
        way = 1.0 if (probe.point - position) @ axes[:, 2] > 0.5 * (low + high) else -1.0
        touched = [one.points for one in felt.get(probe.id, ()) if len(one.points)]
        points = np.concatenate(touched) if touched else probe.point[None]
        reached = way * (points - position) @ axes[:, 2]
        if reached.max() > max(way * low, way * high):
            yield points[int(reached.argmax())]
