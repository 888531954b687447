"""What fusing the curvature of overlapping touches is worth, on surfaces that are known."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.touch.curvature import feel_patch
from palpate.core.touch.forms import Principal, ShapeOperator, principal
from palpate.core.touch.fusion import Place, begin_fusion, fuse
from palpate.core.touch.pad import Pad

PAD = Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
DEPTH = 1.5e-3
STEP = 3e-3
"""Way between two touches, m: four fifths of the pad overlap."""
TOUCHES = 12
TILT = 0.05
"""Spread of the pad's lean from the surface, rad."""


class Walk(NamedTuple):
    """A quadric x'Mx = 1 with principal axes along x, y, z, and where the finger begins."""

    inverse_squares: tuple[float, float, float]
    """Diagonal of M, 1/m^2."""
    start: tuple[float, float, float]
    """Direction from the middle in which the walk begins; it goes round the z axis."""


WALKS: Mapping[str, Walk] = {
    "sphere": Walk((0.03**-2, 0.03**-2, 0.03**-2), (1.0, 0.0, 0.0)),
    "cylinder": Walk((0.025**-2, 0.025**-2, 0.0), (1.0, 0.0, 0.0)),
    "ellipsoid": Walk((0.05**-2, 0.04**-2, 0.03**-2), (0.3, 1.0, 0.1)),
    "saddle": Walk((0.03**-2, 0.03**-2, -(0.05**-2)), (1.0, 0.0, 0.0)),
    "sharp end": Walk((0.045**-2, 0.02**-2, 0.03**-2), (0.5, 0.9, 0.0)),
}
"""The last one passes the end of a long ellipsoid, where curvature grows fivefold and falls
again within the length of two pads."""


class Score(NamedTuple):
    """Errors of the principal curvatures over many walks."""

    single: float
    """Root mean square error of one touch, 1/m."""
    fused: float
    """The same, fused with the touches before it; from the fourth touch on."""
    surprise: float
    """Mean normalised squared innovation; 3 if the errors are what they are said to be."""


def score_fusion(name: str, noise: float, walks: int, seed: int = 0) -> Score:
    """Walk over a surface of `WALKS` several times and compare.

    Parameters
    ----------
    name : str
        The surface.
    noise : float
        Standard deviation of one taxel, m.
    walks : int
        How often.
    seed : int
        Of noise and leaning.
    """
    rng = np.random.default_rng(seed)
    errors, surprises = [], []
    for _ in range(walks):
        fused = None
        for number, (felt, truth) in enumerate(_touches(rng, WALKS[name], noise)):
            fused = begin_fusion(felt) if fused is None else fuse(fused, felt)
            if number < 3:
                continue
            wanted = np.array([truth.k1, truth.k2])
            alone = principal(felt.shape)
            errors.append([np.array(alone[:2]) - wanted, np.array(fused.principal[:2]) - wanted])
            surprises.append(fused.surprise)
    single, both = np.sqrt(np.mean(np.square(errors), axis=(0, 2)))
    return Score(float(single), float(both), float(np.mean(surprises)))


def _touches(
    rng: np.random.Generator, walk: Walk, noise: float
) -> Iterator[tuple[Place, Principal]]:
    """Touches along a walk, and the true curvature at the place of each."""
    matrix = np.diag(walk.inverse_squares)
    point = np.array(walk.start) / math.sqrt(float(np.array(walk.start) @ matrix @ walk.start))
    for _ in range(TOUCHES):
        axes = _leaning(rng, -matrix @ point)
        height = _height(matrix, point, axes)
        advance = float(height.min()) + DEPTH
        compression = advance - height
        touched = compression > 50e-6
        compression = compression + noise * rng.normal(size=height.shape)
        patch = feel_patch(PAD, np.where(touched, -compression, 0.0), touched, axes[:, 0], noise)
        if patch.shape is not None and patch.shape_covariance is not None:
            tangents, normal = patch.shape.tangents @ axes.T, axes @ patch.shape.normal
            shape = ShapeOperator(tangents, normal, patch.shape.parts)
            place = point + axes @ (patch.place + np.array([0.0, 0.0, advance]))
            yield Place(place, shape, patch.shape_covariance), _truth(matrix, place)
        along = np.cross([0.0, 0.0, 1.0], matrix @ point)
        point = point + STEP * along / np.linalg.norm(along)
        point = point / math.sqrt(float(point @ matrix @ point))


def _leaning(rng: np.random.Generator, into: Floats) -> Floats:
    """Axes of a pad, as columns, that leans a little from the surface and is turned anyhow."""
    into = into / np.linalg.norm(into) + TILT * rng.normal(size=3)
    into = into / np.linalg.norm(into)
    x = np.cross(into, rng.normal(size=3))
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(into, x), into])


def _height(matrix: Floats, point: Floats, axes: Floats) -> Floats:
    """The surface over a pad's plane through a point, (rows, cols), m."""
    x, y = PAD.grid()
    place = point + x[..., None] * axes[:, 0] + y[..., None] * axes[:, 1]
    into = axes[:, 2]
    a = float(into @ matrix @ into)
    b = place @ matrix @ into
    c = np.einsum("rci,ij,rcj->rc", place, matrix, place) - 1.0
    # The root that is small where c is: it is the near side, and the only one on a cylinder.
    height: Floats = c / (-b + np.sqrt(np.maximum(b * b - a * c, 0.0)))
    return height


def _truth(matrix: Floats, place: Floats) -> Principal:
    """Principal curvatures of the quadric nearest to a place."""
    gradient = matrix @ place
    size = float(np.linalg.norm(gradient))
    normal = gradient / size
    frame = np.linalg.svd(normal[None])[2][1:]
    k = frame @ matrix @ frame.T / size
    parts = (float(k[0, 0]), float(k[0, 1]), float(k[1, 1]))
    return principal(ShapeOperator(frame, normal, parts))
