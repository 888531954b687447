"""Planes of ends that are not level, and the shear of space that makes them level.

An oblique top, or a flat one seen along an axis that is slightly off, is level after all heights
are moved by a slope that changes evenly from one end to the other:
z = zeta + (p + q zeta) . (x, y). Sides, rims and ends are fitted there and moved back. Each touch
of an end measures its slope there; flat touches with the same slope form a plane.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.rebuild.contours import ContactPoints, quadric_terms

ContactKind = Literal["flat", "bent", "edge"]
Orders = tuple[int, int]  # of the derivatives by each of the two parameters of a surface


@dataclass(frozen=True, slots=True, kw_only=True)
class EndContactSettings:
    """How touches of an end are classified by the residuals of their taxels."""

    min_axial_normal: float = 0.8  # axial component of the normals of an end, sloping or not
    min_taxels: int = 24  # of a touch; fewer touch but an edge
    # A touch is flat up to this residual from its plane, as a fraction of its width, or if a
    # quadric's residual is not smaller by more than the ratio. It lies across an edge if its
    # residual exceeds that of the flattest touch by more than the other ratio.
    max_flat_residual: float = 2e-4
    max_quadric_ratio: float = 1.4
    max_flattest_ratio: float = 2.0
    min_width_ratio: float = 0.1  # of a touch's narrow to its mean width, to measure a slope


@dataclass(frozen=True, slots=True, kw_only=True)
class EndPlaneSettings:
    """When touches of an end form a plane, and when planes shear the space between the ends."""

    contacts: EndContactSettings = EndContactSettings()
    max_angle: float = math.radians(2.0)  # [rad] between touches of one plane
    max_plane_distance: float = 0.02  # fraction of the extent, of contacts over or off the plane
    outer_depth: float = 0.1  # fraction of the extent; touches so far below the outermost count
    # Fewer touches form a plane only if no bent touch lies on it: a dome is flat in places. The
    # error of their slopes is the assumed one.
    min_touches: int = 3
    angle_uncertainty: float = math.radians(0.25)  # [rad] assumed of a single touch
    known_height_tolerance: float = 2e-3  # fraction of the extent, of contacts at a known height
    min_slope_sigmas: float = 3.0  # standard deviations of a slope that differs from 0
    min_shift: float = 1e-4  # fraction of the extent, by which a shear must move heights
    max_level_slope: float = 0.15  # of the more level end; if it is steeper, the axis leans
    max_slope: float = 1.0  # of the steeper end


class EndPlane(NamedTuple):
    """A plane over the slicing frame, z = height + slopes . (x, y)."""

    height: float  # at the origin [m]
    slopes: Floats  # (2,)
    error: float  # standard deviation of a slope

    def at(self, places: Floats) -> Floats:
        """Heights (n,) over places (n, 2) [m]."""
        return self.height + places @ self.slopes


def shear_between(
    contacts: ContactPoints,
    middle: Floats,
    ends: tuple[float | None, float | None],
    settings: EndPlaneSettings = EndPlaneSettings(),
) -> Shear | None:
    """Shear of the space between two ends; None where both are level, or not planes.

    By all taxels, with normals, and the object's middle (2,), in the slicing frame. `ends` are
    known heights [m] of the lower and the upper end: an end that was not touched is level there.
    One of unknown height is parallel to the other end.
    """
    extent = float(np.ptp(contacts.points[:, 2]))
    low, high = end_plane(contacts, -1.0, settings), end_plane(contacts, 1.0, settings)
    reach = float(np.linalg.norm(contacts.points[:, :2] - middle, axis=1).max())
    slopes = [(float(np.linalg.norm(plane.slopes)), plane.error) for plane in (low, high) if plane]
    if not any(
        slope > settings.min_slope_sigmas * error and slope * reach > settings.min_shift * extent
        for slope, error in slopes
    ):
        return None
    below = low or _substitute_plane(high, contacts, -1.0, ends[0], middle, settings)
    above = high or _substitute_plane(low, contacts, 1.0, ends[1], middle, settings)
    bottom, top = (float(plane.at(middle[None])[0]) for plane in (below, above))
    if not top > bottom:
        return None
    change = (above.slopes - below.slopes) / (top - bottom)
    shear = Shear(middle, below.slopes - bottom * change, change)
    slope, steeper = sorted(float(np.linalg.norm(plane.slopes)) for plane in (below, above))
    is_sound = slope < settings.max_level_slope and steeper < settings.max_slope
    return shear if is_sound and shear.reaches(contacts.points).all() else None


def end_plane(
    contacts: ContactPoints, sign: float, settings: EndPlaneSettings = EndPlaneSettings()
) -> EndPlane | None:
    """Plane of an end; None if its touches do not form one.

    `sign` is 1 for the upper end and -1 for the lower one.
    """
    end_contacts = end_contacts_of(contacts, sign, settings.contacts)
    flat = [contact for contact in end_contacts if contact.kind == "flat"]
    if not flat:
        return None
    extent = float(np.ptp(contacts.points[:, 2]))
    first = max(flat, key=lambda contact: sign * float(contact.center[2]))
    depth, distance = settings.outer_depth * extent, settings.max_plane_distance * extent
    near = [
        contact
        for contact in end_contacts
        if sign * float(first.center[2] - contact.center[2]) <= depth
    ]
    parallel = [contact for contact in flat if first.is_parallel(contact, settings.max_angle)]
    coplanar = [contact for contact in parallel if first.plane_distance(contact) <= distance]
    near_flat = [contact for contact in near if contact.kind == "flat"]
    tilted = [touch for touch in near_flat if not first.is_parallel(touch, settings.max_angle)]
    not_flat = [touch for touch in near if touch.kind != "flat"]
    bent = [touch for touch in not_flat if first.plane_distance(touch) <= distance]
    if len(tilted) >= len(coplanar) or (bent and len(coplanar) < settings.min_touches):
        return None
    slopes = np.stack([contact.slopes for contact in coplanar])
    mean = slopes.mean(axis=0)
    height = float(np.mean([contact.center[2] - contact.center[:2] @ mean for contact in coplanar]))
    scatter = math.tan(settings.angle_uncertainty)
    if len(coplanar) >= settings.min_touches:
        scatter = float(np.sqrt(np.mean((slopes - mean) ** 2)))
    plane = EndPlane(height, mean, float(scatter / np.sqrt(len(coplanar))))
    highest = float((sign * (contacts.points[:, 2] - plane.at(contacts.points[:, :2]))).max())
    return plane if highest < distance else None


def _substitute_plane(
    other: EndPlane | None,
    contacts: ContactPoints,
    sign: float,
    known_height: float | None,
    middle: Floats,
    settings: EndPlaneSettings,
) -> EndPlane:
    """Plane of an end whose touches form none: level if untouched, else parallel to the other."""
    assert other is not None
    if known_height is not None and is_known_untouched(contacts, sign, known_height, settings):
        return EndPlane(known_height, np.zeros(2), 0.0)
    farthest = sign * float((sign * contacts.points[:, 2]).max())
    return EndPlane(farthest - float(middle @ other.slopes), other.slopes, other.error)


def is_known_untouched(
    contacts: ContactPoints,
    sign: float,
    known_height: float | None,
    settings: EndPlaneSettings = EndPlaneSettings(),
) -> bool:
    """Whether an end has a known height, such as a platform's, and no taxel there faces it."""
    if known_height is None:
        return False
    assert contacts.normals is not None
    heights = sign * contacts.points[:, 2]
    tolerance = settings.known_height_tolerance * float(np.ptp(heights))
    axial = sign * contacts.normals[heights > sign * known_height - tolerance, 2]
    return not bool((axial > settings.contacts.min_axial_normal).any())


class EndContact(NamedTuple):
    """A touch of an end."""

    touch: int  # its number
    center: Floats  # mean of its taxels, (3,) [m]
    slopes: Floats  # of its plane, (2,)
    residual: float  # root mean square distance of its taxels from that plane [m]
    width: float  # root mean square distance of its taxels from the center [m]
    # flat: the taxels lie on a plane; bent: they lie on a quadric; edge: on neither, or in a line.
    kind: ContactKind

    def plane_distance(self, other: EndContact) -> float:
        """Distance along the axis of another touch from its plane [m]."""
        height = self.center[2] + (other.center - self.center)[:2] @ self.slopes
        return abs(float(other.center[2] - height))

    def is_level(self, max_angle: float) -> bool:
        """Whether all its taxels lie at one height, up to an angle [rad]."""
        return self.kind == "flat" and float(np.linalg.norm(self.slopes)) < math.tan(max_angle)

    def is_parallel(self, other: EndContact, max_angle: float) -> bool:
        """Whether another touch has the same slopes, up to an angle [rad]."""
        return float(np.linalg.norm(other.slopes - self.slopes)) < math.tan(max_angle)


def end_contacts_of(
    contacts: ContactPoints, sign: float, settings: EndContactSettings = EndContactSettings()
) -> list[EndContact]:
    """Touches that face an end, 1 or -1, with enough taxels to measure a slope; needs normals."""
    assert contacts.normals is not None
    facing = np.flatnonzero(sign * contacts.normals[:, 2] > settings.min_axial_normal)
    counts = np.bincount(contacts.touch[facing], minlength=1)
    touches = np.flatnonzero(counts >= settings.min_taxels)
    if not len(touches):
        return []
    facing = facing[counts[contacts.touch[facing]] >= settings.min_taxels]
    facing = facing[np.argsort(contacts.touch[facing], kind="stable")]
    numbers, n_taxels = touches.astype(np.int32), counts[touches].astype(np.int32)
    end_contacts = _end_contacts(numbers, n_taxels, contacts.points[facing], settings)
    flattest = min(contact.residual for contact in end_contacts)

    def is_uneven(contact: EndContact) -> bool:
        limit = settings.max_flattest_ratio * flattest + settings.max_flat_residual * contact.width
        return contact.kind == "flat" and contact.residual > limit

    return [
        contact._replace(kind="edge") if is_uneven(contact) else contact for contact in end_contacts
    ]


def _end_contacts(
    touches: Ints, counts: Ints, points: Floats, settings: EndContactSettings
) -> list[EndContact]:
    """Touches by their taxels (n, 3) that face an end: `counts` of each, in the touches' order."""
    begins = np.cumsum(counts) - counts
    row = np.repeat(np.arange(len(counts)), counts)
    column = np.arange(len(points)) - begins[row]
    centers = np.add.reduceat(points, begins) / counts[:, None]
    away = points - centers[row]
    squares = np.add.reduceat(np.square(away[:, :2]).sum(axis=1), begins) / counts
    widths = np.sqrt(squares)
    scale = np.where(widths > 0.0, widths, 1.0)  # the width is the unit of each touch
    local = away[:, :2] / scale[row, None]
    # Of one more column the last entries of the QR factor are the residuals of plane and quadric.
    equations = np.zeros((len(counts), int(counts.max()), 7))
    equations[row, column] = np.column_stack([quadric_terms(*local.T), away[:, 2]])
    factor = np.asarray(np.linalg.qr(equations, mode="r"), np.float64)
    residuals = np.linalg.norm(factor[:, 3:, 6], axis=1) / np.sqrt(counts)
    of_quadric = np.abs(factor[:, 6, 6]) / np.sqrt(counts)
    planes = np.einsum("tij,tj->ti", np.linalg.pinv(factor[:, :3, :3]), factor[:, :3, 6])
    slopes = planes[:, 1:] / scale[:, None]
    moments = np.add.reduceat(local[:, :, None] * local[:, None], begins)
    smallest = np.linalg.eigvalsh(moments / (counts - 1)[:, None, None])[:, 0]
    is_bent = (
        residuals > settings.max_quadric_ratio * of_quadric + settings.max_flat_residual * widths
    )
    kind = np.where(smallest < settings.min_width_ratio**2, 2, is_bent.astype(int))
    kinds: list[ContactKind] = ["flat", "bent", "edge"]
    figures = zip(touches, centers, slopes, residuals, widths, kind, strict=True)
    return [
        EndContact(int(touch), center, slope, float(residual), float(width), kinds[number])
        for touch, center, slope, residual, width, number in figures
    ]


class Shear(NamedTuple):
    """A shift of heights that is linear in x and y; places are in the slicing frame [m]."""

    middle: Floats  # where heights are not moved, (2,)
    slopes: Floats  # at the height 0 of the levelled space, (2,)
    change: Floats  # of the slopes, per metre of that height, (2,)

    def levelled(self, points: Floats) -> Floats:
        """Points (n, 3) moved into the levelled space."""
        away = points[:, :2] - self.middle
        heights = (points[:, 2] - away @ self.slopes) / self._stretch(points)
        return np.column_stack([points[:, :2], heights])

    def reaches(self, points: Floats, min_stretch: float = 0.25) -> Bools:
        """Mask (n,) of the points (n, 3) whose heights are stretched by `min_stretch` or more.

        Farther from the middle both ends meet in a line, where the stretch is 0.
        """
        return self._stretch(points) > min_stretch

    def sheared(self, points: Floats) -> Floats:
        """Points (n, 3) of the levelled space moved back."""
        away = points[:, :2] - self.middle
        shift = np.einsum("ni,ni->n", self._at(points[:, 2]), away)
        return np.column_stack([points[:, :2], points[:, 2] + shift])

    def levelled_contacts(self, contacts: ContactPoints) -> ContactPoints:
        """Contact points in the levelled space, with the normals of the surface there."""
        points = self.levelled(contacts.points)
        if contacts.normals is None:
            return contacts._replace(points=points)
        axial = contacts.normals[:, 2:]
        radial = contacts.normals[:, :2] + axial * self._at(points[:, 2])
        normals = np.column_stack([radial, axial[:, 0] * self._stretch(points)])
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        return contacts._replace(points=points, normals=normals)

    def steepness(self, height: float) -> float:
        """Slope of the plane that is level at a height of the levelled space [m]."""
        return float(np.linalg.norm(self._at(np.array([height]))))

    def carried(self, at: Callable[[Orders], Floats], by: Orders) -> Floats:
        """Points `at((0, 0))` (n, 3) of the levelled space moved back, or their derivatives."""
        points = at((0, 0))
        if by == (0, 0):
            return self.sheared(points)
        derivative = at(by).copy()
        along = np.einsum("ni,ni->n", self._at(points[:, 2]), derivative[:, :2])
        derivative[:, 2] = derivative[:, 2] * self._stretch(points) + along
        if sum(by) == 2:
            halves = ((1, 0), (0, 1)) if by == (1, 1) else ((by[0] // 2, by[1] // 2),) * 2
            a, b = (at(half) for half in halves)
            derivative[:, 2] += a[:, 2] * (b[:, :2] @ self.change)
            derivative[:, 2] += b[:, 2] * (a[:, :2] @ self.change)
        return derivative

    def _at(self, heights: Floats) -> Floats:
        """Slopes (n, 2) at heights (n,) of the levelled space."""
        return self.slopes + heights[:, None] * self.change

    def _stretch(self, points: Floats) -> Floats:
        """Derivative (n,) of heights by those of the levelled space, at points (n, 2 or 3)."""
        return np.asarray(1.0 + (points[:, :2] - self.middle) @ self.change)


def levelled(shear: Shear | None, contacts: ContactPoints) -> ContactPoints:
    """Contact points in the levelled space; unchanged if there is no shear."""
    return contacts if shear is None else shear.levelled_contacts(contacts)
