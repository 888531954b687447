"""Primitive solids, each centred on the origin of its frame.

Sphere, box, cylinder and cone are exact, and may be parts of a boolean. Capsule and torus are
facets, within a ten-thousandth of the radius from the surface.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from palpate.core import shapes
from palpate.core.arrays import Floats
from palpate.core.geometry import close_rings

Length = Annotated[float, Meta(gt=0, le=10, description="m")]
BOX_FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


@dataclass(frozen=True, slots=True, kw_only=True)
class FacetSettings:
    """Numbers of facets of capsules and tori."""

    n_around: int = 384  # the axis
    n_along: int = 192  # the rounded profile


class SphereSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A ball."""

    radius: Length  # [m]

    def build(self) -> shapes.Superquadric:
        """The ball."""
        return shapes.Superquadric(np.full(3, self.radius), np.ones(2))


class BoxSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A cuboid with sharp edges."""

    size: tuple[Length, Length, Length]  # edges along x, y, z [m]

    def build(self) -> shapes.Polyhedron:
        """The cuboid."""
        corners = 0.5 * np.array(self.size) * np.array(list(product((-1.0, 1.0), repeat=3)))
        return shapes.Polyhedron(corners, BOX_FACES)


class CylinderSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A round cylinder about z."""

    radius: Length  # [m]
    height: Length  # [m]

    def build(self) -> shapes.GeneralisedCylinder:
        """The cylinder."""
        return _turned(self.radius, self.height, 1.0)


class ConeSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A round cone about z, pointed or truncated."""

    radius: Length  # of the base [m]
    height: Length  # [m]
    top: Annotated[float, Meta(ge=0, le=10, description="m")] = 0.0  # radius of the upper end [m]

    def build(self) -> shapes.GeneralisedCylinder:
        """The cone."""
        return _turned(self.radius, self.height, self.top / self.radius)


def _turned(radius: float, height: float, top: float) -> shapes.GeneralisedCylinder:
    section = shapes.SuperellipseSection(np.array([radius, radius]), 1.0)
    ends = 0.5 * height * np.array([-1.0, 1.0])
    return shapes.GeneralisedCylinder(section, ends, np.array([1.0, top]))


class CapsuleSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A cylinder about z with a half ball at each end."""

    radius: Length  # [m]
    height: Length  # total [m]

    def __post_init__(self) -> None:
        if self.height < 2.0 * self.radius:
            raise ValueError(
                f"height of a capsule is {self.height:g} m; it must be at least twice its radius, "
                f"{2.0 * self.radius:g} m"
            )

    def build(self, facets: FacetSettings = FacetSettings()) -> shapes.TriangleShape:
        """The capsule as facets."""
        turn = np.linspace(0.0, 0.5 * math.pi, facets.n_along // 2, endpoint=False)
        upper = 0.5 * self.height - self.radius + self.radius * np.sin(turn)
        radii = self.radius * np.cos(turn)
        heights = np.append(-upper[::-1], upper)
        rings = _rings(heights, np.append(radii[::-1], radii), facets.n_around)
        pole = np.array([0.0, 0.0, 0.5 * self.height])
        return shapes.TriangleShape(*close_rings(-pole, rings, pole))


class TorusSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A ring around z."""

    radius: Length  # from the axis to the middle of the tube [m]
    tube: Length  # radius of the tube [m]

    def __post_init__(self) -> None:
        if self.tube >= self.radius:
            raise ValueError(
                f"tube of a torus is {self.tube:g} m; it must be less than its radius, "
                f"{self.radius:g} m"
            )

    def build(self, facets: FacetSettings = FacetSettings()) -> shapes.TriangleShape:
        """The torus as facets."""
        n_along, n_around = facets.n_along, facets.n_around
        turn = 2.0 * math.pi * np.arange(n_along) / n_along
        heights, radii = self.tube * np.sin(turn), self.radius + self.tube * np.cos(turn)
        rings = _rings(heights, radii, n_around)
        row, column = np.divmod(np.arange(n_along * n_around), n_around)
        right, up = (column + 1) % n_around, (row + 1) % n_along
        corners = (row, column), (row, right), (up, right), (up, column)
        a, b, c, d = (r * n_around + p for r, p in corners)
        faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
        return shapes.TriangleShape(rings.reshape(-1, 3), faces.astype(np.int32))


def _rings(heights: Floats, radii: Floats, n_around: int) -> Floats:
    """Points (rings, n_around, 3) on circles about z."""
    turn = 2.0 * math.pi * np.arange(n_around) / n_around
    circle = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(n_around)])
    points = np.asarray(radii[:, None, None] * circle)
    points[:, :, 2] = heights[:, None]
    return points
