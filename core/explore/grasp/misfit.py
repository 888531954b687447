"""What a fitted solid misses: a smooth field of displacements along its normals, with its doubt.

The field is a Gaussian process that the contacts' residuals pin down where they are; elsewhere it
returns to nothing, and may be anything of the size of what the fit misses. So a bump that was felt
moves the axis, and a side that was not felt makes it uncertain.

Rasmussen and Williams, *Gaussian processes for machine learning*, 2006, (2.25) and (2.26).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.explore.grasp.moments import Body, body_of
from palpate.core.shapes.protocol import Mesh

REACH = 0.2
"""Of the diameter: how far one residual speaks for its neighbourhood."""
UNSEEN = 5.0
"""A fit follows the contacts: away from them it is off by this many times what it shows there."""
TIED = 1e-6
"""Of the largest variance: no gap between two counts as smaller."""


class Corrected(NamedTuple):
    """A solid with what its contacts added."""

    vertices: Floats
    """(n, 3), m."""
    faces: Ints
    """(m, 3)."""
    body: Body
    """What it bounds."""
    deviation: Floats
    """Standard deviation of each vertex along its normal, (n,), m."""
    tilts: Floats
    """Covariance of the body's principal axes: turns about the first, second and third of them,
    (3, 3), rad2."""
    shift: float
    """Standard deviation of its centroid, m."""


def corrected(mesh: Mesh, points: Floats, residuals: Floats, rms: float, noise: float) -> Corrected:
    """Move a solid's surface on to its contacts.

    Parameters
    ----------
    mesh : Mesh
        The fitted solid.
    points : (n, 3) array
        Contacts, m.
    residuals : (n,) array
        How far outside it each lies, m.
    rms : float
        What the fit misses, m.
    noise : float
        Standard deviation of a contact, m.
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
    body = body_of(moved, faces)
    if not body.sound:  # the contacts contradict the solid: it is left as it is
        moved, body = vertices, body_of(vertices, faces)
    effects = _effects(body, moved, area)
    covariance = size * effects @ (_kernel(vertices, vertices, reach) @ effects.T)
    covariance -= (effects @ gain) @ (effects @ towards).T
    return Corrected(
        moved,
        faces,
        body,
        np.sqrt(left),
        covariance[:3, :3],
        float(np.sqrt(max(np.trace(covariance[3:, 3:]), 0.0))),
    )


def _effects(body: Body, vertices: Floats, area: Floats) -> Floats:
    """What a displacement of each vertex does, (6, n): turns of the principal axes, shifts.

    To first order: a layer of area A and thickness d at x adds A d x x^T to the second moment,
    and an axis turns by the mixed part over the gap of the two variances.
    """
    at = (vertices - body.centroid) @ body.axes
    spread = body.spread
    least = TIED * spread[2]
    turns = [
        area * at[:, i] * at[:, j] / (body.volume * max(spread[j] - spread[i], least))
        for i, j in ((1, 2), (0, 2), (0, 1))
    ]
    return np.vstack([*turns, area * at.T / body.volume])


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
