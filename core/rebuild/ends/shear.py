"""Sloping ends: the planes in which an object ends, and the shear of space that makes both level.

An oblique top, or a flat one seen along an axis that is a little off, is level after every
height has been moved by a slope that changes evenly from the one end to the other: z = zeta + (p
+ q zeta) . (x, y). Sides, rims and ends are fitted there and carried back. Each touch of an end
tells how that leans there, whatever the error of its place; touches that are flat and lean alike
make a plane.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild.contours import ContactPoints, quadric_terms

TOGETHER = 0.02  # Of the extent: how far off their plane they, or others above it, may lie
OUTER = 0.1  # Of the extent: so far below the outermost touch others must lean alike
# Touches that tell themselves how sure their mean is; of fewer, each may be wrong by this, and none
# that is not flat may lie beside them: a dome looks flat somewhere.
FEW, UNSURE = 3, math.radians(0.25)
SHORT = 2e-3  # Of the extent: what was touched so near to a given height is of that end
SURE = 3.0  # Standard deviations by which a slope must differ from none
LEAST = 1e-4  # Of the extent: what heights must be moved by to be worth it
LEVEL = 0.15  # Slope up to which an end is nearly level: one must be, else the axis leans
STEEPEST = 1.0  # Slope beyond which nothing was understood
ContactKind = Literal["flat", "bent", "edge"]
FACING = 0.8  # Part of a normal along the axis from which on a taxel lies on an end, sloping or not
FEWEST = 24  # Taxels of a touch: fewer met but an edge
# A touch is flat if its taxels lie no farther off a plane than this share of its width; with noise,
# if a bent surface follows them no better than by the second factor, nor the best touch its plane
# by the third: else it lies across an edge.
FLAT, BENT, WORSE = 2e-4, 1.4, 2.0
ALIKE = math.radians(2.0)  # How much otherwise than the outermost touches of a plane may lean
# A flat touch that leans less is level; of those that lean more each is as high as its highest
# taxel.
CONTACT_LEVEL = math.radians(0.5)
THIN = 0.1  # Of its width: what a touch must be wide at least, the other way, to lean in some way
LEAST_STRETCH = 0.25  # How far heights may be pressed together; farther aside both ends would meet
By = tuple[int, int]  # How often a surface is differentiated, by each of its two parameters


class EndPlane(NamedTuple):
    """A plane over the slicing frame, z = height + slopes . (x, y)."""

    height: float  # At the origin, m
    slopes: Floats  # (2,)
    error: float  # Standard deviation of a slope

    def at(self, places: Floats) -> Floats:
        """Heights (n,) over places (n, 2), m."""
        return self.height + places @ self.slopes


def shear_between(
    contacts: ContactPoints, middle: Floats, ends: tuple[float | None, float | None]
) -> Shear | None:
    """The shear of the space between the ends; None where both are level, or not planes.

    By all taxels, with normals, and the object's middle (2,), seen from the slicing frame. An end
    where no taxel was is level at the height in `ends`, m, as touched by whatever means; one of
    which nothing is known is like the other.
    """
    extent = float(np.ptp(contacts.points[:, 2]))
    low, high = end_plane(contacts, -1.0), end_plane(contacts, 1.0)
    away = contacts.points[:, :2] - middle
    reach = float(np.linalg.norm(away, axis=1).max())
    if not any(_slants(plane, reach, extent) for plane in (low, high)):
        return None
    below = low or _like(high, contacts, -1.0, ends[0], middle)
    above = high or _like(low, contacts, 1.0, ends[1], middle)
    bottom, top = (float(plane.at(middle[None])[0]) for plane in (below, above))
    if not top > bottom:
        return None
    change = (above.slopes - below.slopes) / (top - bottom)
    shear = Shear(middle, below.slopes - bottom * change, change)
    steep = sorted(float(np.linalg.norm(plane.slopes)) for plane in (below, above))
    sound = bool(shear.reaches(contacts.points).all()) and steep[0] < LEVEL and steep[1] < STEEPEST
    return shear if sound else None


def end_plane(contacts: ContactPoints, way: float) -> EndPlane | None:
    """The plane of an end, way 1 or -1; None if it was not touched as one."""
    end_contacts = end_contacts_of(contacts, way)
    flat = [one for one in end_contacts if one.kind == "flat"]
    if not flat:
        return None
    extent = float(np.ptp(contacts.points[:, 2]))
    first = max(flat, key=lambda contact: way * float(contact.place[2]))
    near = [
        one for one in end_contacts if way * float(first.place[2] - one.place[2]) <= OUTER * extent
    ]
    alike = [one for one in flat if first.leans_as(one) and first.misses(one) <= TOGETHER * extent]
    others = [one for one in near if one.kind == "flat" and not first.leans_as(one)]
    beside = [one for one in near if one.kind != "flat" and first.misses(one) <= TOGETHER * extent]
    if len(others) >= len(alike) or (beside and len(alike) < FEW):
        return None
    slopes = np.stack([one.slopes for one in alike])
    mean = slopes.mean(axis=0)
    height = float(np.mean([one.place[2] - one.place[:2] @ mean for one in alike]))
    scatter = np.sqrt(np.mean((slopes - mean) ** 2)) if len(alike) >= FEW else math.tan(UNSURE)
    plane = EndPlane(height, mean, float(scatter / np.sqrt(len(alike))))
    beyond = float((way * (contacts.points[:, 2] - plane.at(contacts.points[:, :2]))).max())
    return plane if beyond < TOGETHER * extent else None


def _slants(plane: EndPlane | None, reach: float, extent: float) -> bool:
    if plane is None:
        return False
    slope = float(np.linalg.norm(plane.slopes))
    return slope > SURE * plane.error and slope * reach > LEAST * extent


def _like(
    other: EndPlane | None, contacts: ContactPoints, way: float, given: float | None, middle: Floats
) -> EndPlane:
    """What stands for an end that is no plane: level if only given, else as the other one."""
    assert other is not None
    if given is not None and only_given(contacts, way, given):
        return EndPlane(given, np.zeros(2), 0.0)
    farthest = way * float((way * contacts.points[:, 2]).max())
    return EndPlane(farthest - float(middle @ other.slopes), other.slopes, other.error)


def only_given(contacts: ContactPoints, way: float, given: float | None) -> bool:
    """Whether an end is known by a given height alone, as by a platform: no taxel there faces."""
    if given is None:
        return False
    assert contacts.normals is not None
    heights = way * contacts.points[:, 2]
    there = heights > way * given - SHORT * float(np.ptp(heights))
    return not bool((way * contacts.normals[there, 2] > FACING).any())


class EndContact(NamedTuple):
    """A touch of an end."""

    touch: int  # Its number
    place: Floats  # Mean of its taxels, (3,), m
    slopes: Floats  # (2,)
    off: float  # How far its taxels lie off a plane, root mean square, m
    width: float  # Of its taxels, root mean square from their middle, m
    # flat: they lie in a plane; bent: a smooth surface follows them better; edge: neither, or they
    # lie in a line.
    kind: ContactKind

    def misses(self, other: EndContact) -> float:
        """How far another touch lies off its plane, along the axis, m."""
        height = self.place[2] + (other.place - self.place)[:2] @ self.slopes
        return abs(float(other.place[2] - height))

    @property
    def level(self) -> bool:
        """Whether all its taxels tell one height."""
        return self.kind == "flat" and float(np.linalg.norm(self.slopes)) < math.tan(CONTACT_LEVEL)

    def leans_as(self, other: EndContact) -> bool:
        """Whether another touch leans like it."""
        return float(np.linalg.norm(other.slopes - self.slopes)) < math.tan(ALIKE)


def end_contacts_of(contacts: ContactPoints, way: float) -> list[EndContact]:
    """The touches that face an end, way 1 or -1, with enough taxels to tell how it leans there."""
    assert contacts.normals is not None
    facing = way * contacts.normals[:, 2] > FACING
    counts = np.bincount(contacts.touch[facing], minlength=1)
    numbers = np.flatnonzero(counts >= FEWEST)
    end_contacts = [
        _end_contact(int(each), contacts.points[facing & (contacts.touch == each)])
        for each in numbers
    ]
    best = min((one.off for one in end_contacts), default=0.0)
    least = [FLAT * one.width for one in end_contacts]
    return [
        one._replace(kind="edge") if one.kind == "flat" and one.off > WORSE * best + small else one
        for one, small in zip(end_contacts, least, strict=True)
    ]


def _end_contact(touch: int, points: Floats) -> EndContact:
    """A touch by its taxels (n, 3) that face an end."""
    place = points.mean(axis=0)
    away, z = (points - place)[:, :2], points[:, 2] - place[2]
    width = float(np.sqrt(np.mean((away**2).sum(axis=1))))
    # In its own width, so that the unit of length does not matter.
    x, y = away.T / (width or 1.0)
    rows = quadric_terms(x, y)
    plane, bent = (np.linalg.lstsq(rows[:, :count], z, rcond=None)[0] for count in (3, 6))
    off = float(np.sqrt(np.mean((z - rows[:, :3] @ plane) ** 2)))
    left = float(np.sqrt(np.mean((z - rows @ bent) ** 2)))
    narrow = float(np.linalg.eigvalsh(np.cov(x, y))[0]) < THIN**2
    is_bent = off > BENT * left + FLAT * width
    kind: ContactKind = "edge" if narrow else "bent" if is_bent else "flat"
    return EndContact(touch, place, plane[1:] / (width or 1.0), off, width, kind)


class Shear(NamedTuple):
    """By how much heights are moved; places are seen from the slicing frame, m."""

    middle: Floats  # Where nothing is moved, (2,)
    slopes: Floats  # At the height 0 of the levelled space, (2,)
    change: Floats  # By which they change with each m of it, (2,)

    def levelled(self, points: Floats) -> Floats:
        """Points (n, 3) in the levelled space."""
        away = points[:, :2] - self.middle
        heights = (points[:, 2] - away @ self.slopes) / (1.0 + away @ self.change)
        return np.column_stack([points[:, :2], heights])

    def reaches(self, points: Floats) -> Bools:
        """Which points (n, 3) it carries: those before the line in which both ends would meet."""
        return 1.0 + (points[:, :2] - self.middle) @ self.change > LEAST_STRETCH

    def sheared(self, points: Floats) -> Floats:
        """Points (n, 3) of the levelled space where they are."""
        away = points[:, :2] - self.middle
        moved = np.einsum("ni,ni->n", self._at(points[:, 2]), away)
        return np.column_stack([points[:, :2], points[:, 2] + moved])

    def levelled_contacts(self, contacts: ContactPoints) -> ContactPoints:
        """Contact points in the levelled space, normals square to what is the surface there."""
        points = self.levelled(contacts.points)
        if contacts.normals is None:
            return contacts._replace(points=points)
        upward = contacts.normals[:, 2:]
        level = contacts.normals[:, :2] + upward * self._at(points[:, 2])
        stretch = 1.0 + (points[:, :2] - self.middle) @ self.change
        normals = np.column_stack([level, upward[:, 0] * stretch])
        return contacts._replace(
            points=points, normals=normals / np.linalg.norm(normals, axis=1, keepdims=True)
        )

    def steepness(self, height: float) -> float:
        """How steep a plane is that is level at a height of the levelled space, m."""
        return float(np.linalg.norm(self._at(np.array([height]))))

    def carried(self, at: Callable[[By], Floats], by: By) -> Floats:
        """Points (n, 3) of a surface of the levelled space, or derivatives, where they are.

        `at` gives the same of the levelled space, for any derivatives; `by` is together up to 2.
        """
        points = at((0, 0))
        if by == (0, 0):
            return self.sheared(points)
        found = at(by).copy()
        stretch = 1.0 + (points[:, :2] - self.middle) @ self.change
        along = np.einsum("ni,ni->n", self._at(points[:, 2]), found[:, :2])
        found[:, 2] = found[:, 2] * stretch + along
        if sum(by) == 2:
            halves = ((1, 0), (0, 1)) if by == (1, 1) else ((by[0] // 2, by[1] // 2),) * 2
            one, other = (at(each) for each in halves)
            found[:, 2] += one[:, 2] * (other[:, :2] @ self.change)
            found[:, 2] += other[:, 2] * (one[:, :2] @ self.change)
        return found

    def _at(self, heights: Floats) -> Floats:
        """Slopes (n, 2) at heights (n,) of the levelled space."""
        return self.slopes + heights[:, None] * self.change


def levelled(shear: Shear | None, contacts: ContactPoints) -> ContactPoints:
    """Contact points in the levelled space; as they are if there is no shear."""
    return contacts if shear is None else shear.levelled_contacts(contacts)
