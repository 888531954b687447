"""What a perfect finger would have felt of a superquadric that stands on height 0."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.felt_points import FeltPoints, stack_points
from palpate.core.rebuild.solid import Evidence, FeltContour
from palpate.core.shapes.superquadric import Superquadric

BAND = 6e-3
"""Half the height of the band that is felt along a contour, m."""
AROUND = 120


class Oracle:
    """Points and normals of a superquadric whose foot is the origin."""

    def __init__(self, size: Sequence[float], exponents: Sequence[float], scale: float = 1.0):
        self.shape: Superquadric = Superquadric(scale * np.array(size), np.array(exponents))
        self.scale = scale
        self.middle = np.array([0.0, 0.0, self.shape.size[2]])

    def section(self, share: float) -> Floats:
        """Points (n, 3) at a height, given as a share of the half height over the middle."""
        height = share * self.shape.size[2]
        turn = 2 * np.pi * np.arange(AROUND) / AROUND
        away = np.column_stack([np.cos(turn), np.sin(turn)]) * self.shape.size[:2]
        low, high = np.zeros(AROUND), np.full(AROUND, 1.5)
        for _ in range(60):
            middle = 0.5 * (low + high)
            inside = self.shape.gauge(self._at(away * middle[:, None], height)) <= 1.0
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        return np.asarray(self._at(away * low[:, None], height) + self.middle)

    def felt(self, points: Floats) -> FeltPoints:
        """The points with their outward normals, by central differences of the gauge."""
        local, step = points - self.middle, 1e-6 * self.scale
        gradient = np.stack(
            [
                self.shape.gauge(local + step * axis) - self.shape.gauge(local - step * axis)
                for axis in np.eye(3)
            ],
            axis=-1,
        )
        return FeltPoints(points, gradient / np.linalg.norm(gradient, axis=1, keepdims=True))

    def slice(self, share: float) -> FeltContour:
        """A contour."""
        felt = self.felt(self.section(share))
        return FeltContour(float(felt.points[0, 2]), felt.points)

    def band(self, share: float) -> FeltPoints:
        """What the touches along a contour feel above and below it."""
        half = BAND * self.scale / self.shape.size[2]
        around = np.linspace(share - half, share + half, 9)
        near = [self.section(one) for one in around if abs(one) < 1.0]
        return self.felt(np.concatenate(near))

    def top(self) -> FeltPoints:
        """What touches from above feel over the middle 0.4 of the width."""
        along = np.linspace(-0.42, 0.42, 12)
        places = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
        origins = self._at(places * self.shape.size[:2], 3 * self.shape.size[2])
        ranges = self.shape.cast(origins, np.array([0.0, 0.0, -1.0]), 9 * self.shape.size[2])
        return self.felt(origins - ranges[:, None] * [0.0, 0.0, 1.0] + self.middle)

    def evidence(self, shares: Sequence[float], top: bool = True) -> Evidence:
        """Contours at these heights, all that was felt along them, and touches from above."""
        return Evidence(
            contours=tuple(self.slice(share) for share in shares),
            side=stack_points([self.band(share) for share in shares]),
            cap=self.top() if top else stack_points([]),
            platform=0.0,
        )

    def distances(self, points: Floats) -> Floats:
        """Radial distance of points (n, 3) from the surface, m."""
        local = points - self.middle
        return np.asarray(np.linalg.norm(local, axis=1) * (1 - 1 / self.shape.gauge(local)))

    @staticmethod
    def _at(places: Floats, height: float) -> Floats:
        return np.column_stack([places, np.full(len(places), height)])


@pytest.fixture(scope="session")
def oracle() -> Callable[..., Oracle]:
    return Oracle
