"""Solids by their usual names and measures, each centred on the origin of its frame.

Sphere, box, cylinder and cone are exact, and may be parts of a boolean. Capsule and torus are
facets, so many that they lie within a ten-thousandth of the radius off the surface.
"""

from __future__ import annotations

import math
from itertools import product
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from palpate.core import shapes
from palpate.core.arrays import Floats
from palpate.core.geometry import close_rings

Length = Annotated[float, Meta(gt=0, le=10, description="m")]
AROUND, ALONG = 384, 192  # Facets around the axis, and along the rounded profile
BOX_FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


class SphereSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A ball."""

    radius: Length  # m

    def build(self) -> shapes.Superquadric:
        """The ball."""
        return shapes.Superquadric(np.full(3, self.radius), np.ones(2))


class BoxSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A cuboid with sharp edges."""

    size: tuple[Length, Length, Length]  # Whole edges along x, y, z, m

    def build(self) -> shapes.Polyhedron:
        """The cuboid."""
        corners = 0.5 * np.array(self.size) * np.array(list(product((-1.0, 1.0), repeat=3)))
        return shapes.Polyhedron(corners, BOX_FACES)


class CylinderSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A round cylinder about z."""

    radius: Length  # m
    height: Length  # m

    def build(self) -> shapes.GeneralisedCylinder:
        """The cylinder."""
        return _turned(self.radius, self.height, 1.0)


class ConeSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A round cone about z, pointed or cut off."""

    radius: Length  # Of the base, m
    height: Length  # m
    top: Annotated[float, Meta(ge=0, le=10, description="m")] = 0.0  # Radius of the upper end, m

    def build(self) -> shapes.GeneralisedCylinder:
        """The cone."""
        return _turned(self.radius, self.height, self.top / self.radius)


def _turned(radius: float, height: float, top: float) -> shapes.GeneralisedCylinder:
    section = shapes.SuperellipseSection(np.array([radius, radius]), 1.0)
    ends = 0.5 * height * np.array([-1.0, 1.0])
    return shapes.GeneralisedCylinder(section, ends, np.array([1.0, top]))


class CapsuleSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A cylinder about z with a half ball at either end."""

    radius: Length  # m
    height: Length  # Over all, m

    def __post_init__(self) -> None:
        if self.height < 2.0 * self.radius:
            raise ValueError(
                f"height of a capsule is {self.height:g} m; it must be at least twice its radius, "
                f"{2.0 * self.radius:g} m"
            )

    def build(self) -> shapes.TriangleShape:
        """The capsule as facets."""
        turn = np.linspace(0.0, 0.5 * math.pi, ALONG // 2, endpoint=False)
        upper = 0.5 * self.height - self.radius + self.radius * np.sin(turn)
        radii = self.radius * np.cos(turn)
        rings = _rings(np.append(-upper[::-1], upper), np.append(radii[::-1], radii))
        pole = np.array([0.0, 0.0, 0.5 * self.height])
        return shapes.TriangleShape(*close_rings(-pole, rings, pole))


class TorusSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A ring that lies around z."""

    radius: Length  # From the axis to the middle of the tube, m
    tube: Length  # Radius of the tube, m

    def __post_init__(self) -> None:
        if self.tube >= self.radius:
            raise ValueError(
                f"tube of a torus is {self.tube:g} m; it must be less than its radius, "
                f"{self.radius:g} m"
            )

    def build(self) -> shapes.TriangleShape:
        """The torus as facets."""
        turn = 2.0 * math.pi * np.arange(ALONG) / ALONG
        rings = _rings(self.tube * np.sin(turn), self.radius + self.tube * np.cos(turn))
        ring, place = np.divmod(np.arange(ALONG * AROUND), AROUND)
        on, up = (place + 1) % AROUND, (ring + 1) % ALONG
        a, b, c, d = (r * AROUND + p for r, p in ((ring, place), (ring, on), (up, on), (up, place)))
        faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
        return shapes.TriangleShape(rings.reshape(-1, 3), faces.astype(np.int32))


def _rings(heights: Floats, radii: Floats) -> Floats:
    """Points (rings, AROUND, 3) on circles about z."""
    turn = 2.0 * math.pi * np.arange(AROUND) / AROUND
    circle = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(AROUND)])
    points = np.asarray(radii[:, None, None] * circle)
    points[:, :, 2] = heights[:, None]
    return points
