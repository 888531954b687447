"""A fitted solid that is moved on to its contacts, and its moments.

What the fitted solid misses is a smooth field of displacements along its normals: a Gaussian
process that the contacts' residuals fix where they are. Away from them it returns to nothing, with
a standard deviation that grows with what the fit misses. So a bump that was touched moves the axis,
and a side that was not touched makes it uncertain. Rasmussen and Williams, *Gaussian processes for
machine learning*, 2006, (2.25) and (2.26).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.shapes import FittedSuperquadric, Mesh

MIN_VARIANCE_GAP = 1e-6  # [largest variance] smallest difference of two that is a divisor


@dataclass(frozen=True, slots=True, kw_only=True)
class SolidSettings:
    """How a fitted solid is moved on to its contacts."""

    mesh_level: int = 4  # of the tessellation over which volumes are summed; finer if larger
    foot_height: float = 0.015  # [diameter] above the lowest place, of what stands on the platform
    correlation_length: float = 0.2  # [diameter] of the displacements' squared exponential kernel
    error_ratio: float = 5.0  # standard deviation far from contacts, per rms residual of the fit


class CorrectedSolid(NamedTuple):
    """A solid with what its contacts added."""

    vertices: Floats  # (n, 3) [m]
    faces: Ints  # (m, 3)
    mass: MassProperties
    deviation: Floats  # (n,) [m] standard deviation of each vertex along its normal
    tilts: Floats  # (3, 3) [rad2] covariance of turns about the principal axes
    place_error: float  # [m] standard deviation of the centroid


class MassProperties(NamedTuple):
    """Moments of a solid of density 1."""

    volume: float  # [m3]
    centroid: Floats  # (3,) [m]
    axes: Floats  # (3, 3) principal axes as columns, the longest last; a rotation
    variances: Floats  # (3,) [m2] of the volume along them, ascending

    @property
    def is_sound(self) -> bool:
        """False for a surface that is turned inside out, or encloses nothing."""
        return self.volume > 0.0 and float(self.variances[0]) > 0.0


def mass_properties(vertices: Floats, faces: Ints) -> MassProperties:
    """Moments of the solid that a closed mesh bounds.

    `vertices` (n, 3) [m]. `faces` (m, 3): counter-clockwise seen from outside. Sums over the
    tetrahedra between faces and a point: the integral of x x^T over one is its volume / 20 times
    the sum of x_i x_i^T over its corners and of their sum with itself.
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
    variances, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0.0:
        axes = axes * [-1.0, 1.0, 1.0]
    return MassProperties(volume, centroid + start, axes, variances)


def solid_on_platform(
    fit: FittedSuperquadric,
    points: Floats,
    platform: float,
    noise: float,
    settings: SolidSettings = SolidSettings(),
) -> CorrectedSolid:
    """The solid through its contacts, among them one with the platform.

    That one is below the middle of all that is about as low: a corner would draw it aside.
    `points` (n, 3): contacts [m]. `platform`: its height [m]. `noise`: standard deviation of a
    contact [m].
    """
    mesh = fit.shape().mesh(settings.mesh_level)
    heights = mesh.vertices[:, 2]
    lowest = float(heights.min())
    diameter = float(np.ptp(mesh.vertices, axis=0).max())
    foot = heights <= lowest + settings.foot_height * diameter
    middle = np.average(mesh.vertices[foot, :2], axis=0, weights=_areas(*mesh)[0][foot])
    points = np.vstack([points, [*middle, lowest]])
    residuals = np.append(fit.residuals, lowest - platform)
    return correct_solid(mesh, points, residuals, fit.rms, noise, settings)


def correct_solid(
    mesh: Mesh,
    points: Floats,
    residuals: Floats,
    rms: float,
    noise: float,
    settings: SolidSettings = SolidSettings(),
) -> CorrectedSolid:
    """Move a solid's surface on to its contacts.

    `points` (n, 3): contacts [m]. `residuals` (n,): how far outside it each lies [m]. `rms`: what
    the fit misses [m]. `noise`: standard deviation of a contact [m].
    """
    vertices, faces = mesh
    area, normals = _areas(vertices, faces)
    reach = settings.correlation_length * float(np.ptp(vertices, axis=0).max())
    variance = (settings.error_ratio * max(rms, noise)) ** 2
    among = variance * _kernel(points, points, reach) + noise**2 * np.eye(len(points))
    towards = variance * _kernel(vertices, points, reach)
    gain = np.linalg.solve(among, towards.T).T
    moved = vertices + normals * (gain @ residuals)[:, None]
    remaining = np.maximum(variance - np.einsum("vn,vn->v", gain, towards), 0.0)
    mass = mass_properties(moved, faces)
    if not mass.is_sound:  # the contacts contradict the solid: it is left as it is
        moved, mass = vertices, mass_properties(vertices, faces)
    effects = _effects(mass, moved, area)
    # Single precision is enough: this is an estimate, of many places.
    places = (vertices - vertices.mean(axis=0)).astype(np.float32)
    covariance = (
        variance * effects @ (_kernel(places, places, reach) @ effects.T.astype(np.float32))
    )
    covariance -= (effects @ gain) @ (effects @ towards).T
    return CorrectedSolid(
        moved,
        faces,
        mass,
        np.sqrt(remaining),
        covariance[:3, :3],
        float(np.sqrt(max(np.trace(covariance[3:, 3:]), 0.0))),
    )


def _areas(vertices: Floats, faces: Ints) -> tuple[Floats, Floats]:
    """Area of the surface about each vertex (n,) [m2], and its normal (n, 3)."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    third = np.cross(b - a, c - a) / 6.0
    areas = np.zeros_like(vertices)
    for corner in faces.T:
        np.add.at(areas, corner, third)
    area = np.linalg.norm(areas, axis=1)
    return area, areas / np.maximum(area, np.finfo(float).tiny)[:, None]


def _kernel(a: Floats, b: Floats, reach: float) -> Floats:
    """Correlation (n, m) of displacements at places (n, 3) and (m, 3)."""
    kernel: Floats = a @ b.T
    kernel -= 0.5 * (a**2).sum(axis=1)[:, None]
    kernel -= 0.5 * (b**2).sum(axis=1)
    np.minimum(kernel, 0.0, out=kernel)
    kernel /= reach**2
    return np.exp(kernel, out=kernel)


def _effects(mass: MassProperties, vertices: Floats, area: Floats) -> Floats:
    """What a displacement of each vertex does, (6, n): turns of the principal axes, shifts.

    To first order: a layer of area A and thickness d at x adds A d x x^T to the second moment, and
    an axis turns by the mixed part over the gap of the two variances.
    """
    local = (vertices - mass.centroid) @ mass.axes
    variances = mass.variances
    min_gap = MIN_VARIANCE_GAP * variances[2]
    turns = [
        area * local[:, i] * local[:, j] / (mass.volume * max(variances[j] - variances[i], min_gap))
        for i, j in ((1, 2), (0, 2), (0, 1))
    ]
    return np.vstack([*turns, area * local.T / mass.volume])
