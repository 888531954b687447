"""How far the facets of a mesh leave the smooth surface that they stand for."""

from __future__ import annotations

import math

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.measure.triangles import areas_and_normals
from palpate.core.measure.vertex_normals import corner_normals

SHARP = math.radians(30.0)
"""Neighbouring faces that meet at more than this meet at an edge of the solid."""


def facet_sag(vertices: Floats, faces: Ints) -> float:
    """Mean distance between a mesh and the surface that its corners' normals tell, m.

    Parameters
    ----------
    vertices : (n, 3) array
        m.
    faces : (m, 3) array
        Rows of `vertices`, turned alike.

    Notes
    -----
    A linear triangle misses a curved one by half the sum over its edges e of l_i l_j II(e, e),
    with the barycentric coordinates l at the edge's ends; their product is 1/12 on average.
    How the normal turns along an edge tells II(e, e).
    """
    corners = vertices[faces]
    normals = corner_normals(vertices, faces, SHARP)
    edges = np.roll(corners, -1, axis=1) - corners
    turned = np.roll(normals, -1, axis=1) - normals
    sag = np.abs(np.einsum("mij,mij->m", turned, edges)) / 24.0
    areas = areas_and_normals(corners)[0]
    total = float(areas.sum())
    return float(areas @ sag) / total if total > 0.0 else 0.0
