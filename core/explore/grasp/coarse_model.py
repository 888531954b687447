"""The coarse model of an object: a solid through its first contacts, and what it misses.

What the solid misses is a smooth field of displacements along its normals: a Gaussian process
that the contacts' residuals pin down where they are; elsewhere it returns to nothing, and may
be anything of the size of what the fit misses. So a bump that was touched moves the axis, and a
side that was not makes it uncertain. Rasmussen and Williams, *Gaussian processes for machine
learning*, 2006, (2.25) and (2.26).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.shapes import Mesh

REACH = 0.2  # Of the diameter: how far one residual speaks for its neighbourhood
# A fit follows the contacts: away from them it is off by this many times what it shows there.
UNSEEN = 5.0
TIED = 1e-6  # Of the largest variance: no gap between two counts as smaller


class CorrectedSolid(NamedTuple):
    """A solid with what its contacts added."""

    vertices: Floats  # (n, 3), m
    faces: Ints  # (m, 3)
    mass: MassProperties  # What it bounds
    deviation: Floats  # Standard deviation of each vertex along its normal, (n,), m
    # Covariance of the body's principal axes: turns about the first, second and third of them, (3,
    # 3), rad2.
    tilts: Floats
    shift: float  # Standard deviation of its centroid, m


def correct_solid(
    mesh: Mesh, points: Floats, residuals: Floats, rms: float, noise: float
) -> CorrectedSolid:
    """Move a solid's surface on to its contacts.

    `points` (n, 3): contacts, m. `residuals` (n,): how far outside it each lies, m. `rms`: what the
    fit misses, m. `noise`: standard deviation of a contact, m.
    """
    vertices, faces = mesh
    area, normals = _areas(vertices, faces)
    reach = REACH * float(np.ptp(vertices, axis=0).max())
    size = (UNSEEN * max(rms, noise)) ** 2
    among = size * _kernel(points, points, reach) + noise**2 * np.eye(len(points))
    towards = size * _kernel(vertices, points, reach)
    gain = np.linalg.solve(among, towards.T).T
    moved = vertices + normals * (gain @ residuals)[:, None]
    left = np.maximum(size - np.einsum("vn,vn->v", gain, towards), 0.0)
    mass = mass_properties(moved, faces)
    if not mass.sound:  # the contacts contradict the solid: it is left as it is
        moved, mass = vertices, mass_properties(vertices, faces)
    effects = _effects(mass, moved, area)
    covariance = size * effects @ (_kernel(vertices, vertices, reach) @ effects.T)
    covariance -= (effects @ gain) @ (effects @ towards).T
    return CorrectedSolid(
        moved,
        faces,
        mass,
        np.sqrt(left),
        covariance[:3, :3],
        float(np.sqrt(max(np.trace(covariance[3:, 3:]), 0.0))),
    )


def _areas(vertices: Floats, faces: Ints) -> tuple[Floats, Floats]:
    """Area of the surface about each vertex, (n,), and its normal, (n, 3)."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    third = np.cross(b - a, c - a) / 6.0
    areas = np.zeros_like(vertices)
    for corner in faces.T:
        np.add.at(areas, corner, third)
    area = np.linalg.norm(areas, axis=1)
    return area, areas / np.maximum(area, np.finfo(float).tiny)[:, None]


def _kernel(one: Floats, other: Floats, reach: float) -> Floats:
    """Correlation (n, m) of displacements at two sets of places."""
    squares = (one**2).sum(axis=1)[:, None] + (other**2).sum(axis=1) - 2.0 * one @ other.T
    result: Floats = np.exp(-0.5 * np.maximum(squares, 0.0) / reach**2)
    return result


def _effects(mass: MassProperties, vertices: Floats, area: Floats) -> Floats:
    """What a displacement of each vertex does, (6, n): turns of the principal axes, shifts.

    To first order: a layer of area A and thickness d at x adds A d x x^T to the second moment,
    and an axis turns by the mixed part over the gap of the two variances.
    """
    at = (vertices - mass.centroid) @ mass.axes
    spread = mass.spread
    least = TIED * spread[2]
    turns = [
        area * at[:, i] * at[:, j] / (mass.volume * max(spread[j] - spread[i], least))
        for i, j in ((1, 2), (0, 2), (0, 1))
    ]
    return np.vstack([*turns, area * at.T / mass.volume])


class MassProperties(NamedTuple):
    """A solid of density 1."""

    volume: float  # m3
    centroid: Floats  # (3,), m
    axes: Floats  # Principal axes as columns, the longest last; a rotation
    spread: Floats  # Variances of the volume along them, ascending, (3,), m2

    @property
    def sound(self) -> bool:
        """False for a surface that is turned inside out, or encloses nothing."""
        return self.volume > 0.0 and float(self.spread[0]) > 0.0


def mass_properties(vertices: Floats, faces: Ints) -> MassProperties:
    """What a closed mesh bounds.

    `vertices` (n, 3): m. `faces` (m, 3): counter-clockwise seen from outside.

    Sums over the tetrahedra between faces and a point: the integral of x x^T over one is its volume
    / 20 times the sum of x_i x_i^T over its corners and of their sum with itself.
    """
    start = vertices.mean(axis=0)
    corners = (vertices - start)[faces]
    a, b, c = corners.transpose(1, 0, 2)
    volumes = np.einsum("mi,mi->m", a, np.cross(b, c)) / 6.0
    volume = float(volumes.sum())
    total = corners.sum(axis=1)
    centroid = volumes @ total / (4.0 * volume)
    second = np.einsum("m,mki,mkj->ij", volumes, corners, corners)
    second += np.einsum("m,mi,mj->ij", volumes, total, total)
    covariance = second / (20.0 * volume) - np.outer(centroid, centroid)
    spread, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0.0:
        axes = axes * [-1.0, 1.0, 1.0]
    return MassProperties(volume, centroid + start, axes, spread)
