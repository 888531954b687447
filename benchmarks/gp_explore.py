"""Explore with the surface's own variance: touch where the least is known of it.

Dragiev, Toussaint and Gienger, 2011; Yi, Calandra, Veiga, van Hoof, Hermans, Zhang and Peters,
*Active tactile object exploration with Gaussian processes*, 2016. To be fair, it is told the box
that the object stands in, it may pass through the object on its way, and of each touch it gets
points spread over the whole patch, with their normals.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from gp_finger import Finger, Touched
from gp_kernels import Kernel, matern, thin_plate
from gp_surface import UNKNOWN, Ball, Implicit, Observed

from palpate.core.arrays import Floats
from palpate.core.shapes.protocol import Mesh

CANDIDATES = 400
NEWTON = 8
"""Steps with which candidates are brought onto the surface."""
NEAR = 5e-4
"""Candidates that are still farther from it are left out, m."""
CLEAR = 8e-3
"""The pad starts this far before the surface, and two standard deviations, m."""
FARTHER = 0.02
"""And so much farther if it began inside, m."""
BEYOND = 0.012
"""How far behind the expected surface a touch may go, m."""
MARGIN = 6e-3
"""Around the object's box, m."""
PLACE_ERROR, SLOPE_ERROR = 2e-5, 0.03
"""Of the points and of the normals of an exact finger, m and 1."""
EMPTY, EMPTY_ERROR = 4e-3, 3e-3
"""What a miss says of the place where it ended, m."""


class Tuning(NamedTuple):
    """What two objects were used for: see `gp_peer`."""

    kernel: str = "matern"
    """Matern or thin plate."""
    length: float = 1.0
    """Of the kernel, over the object's largest extent."""
    points: int = 9
    """Of each touch."""
    travel: float = 0.01
    """How much deviation a metre of travel outweighs, m; 0 for the greatest variance alone."""


class State(NamedTuple):
    """What it has come to."""

    surface: Implicit
    """The surface so far."""
    touches: int
    """Touches made."""
    way: float
    """Of the finger, m."""


class Explorer:
    """Touch by touch.

    Parameters
    ----------
    finger : Finger
        What it touches with.
    box : (2, 3) array
        The object's true box, m.
    noise : float
        Standard deviation of a touch's place, m.
    tuning : Tuning
        How it does it.
    """

    def __init__(self, finger: Finger, box: Floats, noise: float, tuning: Tuning):
        self._finger, self._noise, self._tuning = finger, noise, tuning
        self._box = box + MARGIN * np.array([[-1.0], [1.0]])
        self._floor = float(box[0, 2])
        self._rng = np.random.default_rng(0)
        radius = 0.5 * float(np.ptp(box, axis=0).mean())
        ball = Ball(box.mean(axis=0), radius)
        self._surface = Implicit(_kernel(tuning, box), ball)
        self._touches, self._way = 0, 0.0
        self._last = ball.centre

    def until(self, over: Callable[[State], bool]) -> State:
        """Go on until a state is enough."""
        while not over(self._state()):
            self._touch_next()
        return self._state()

    def mesh(self) -> Mesh:
        """The surface so far."""
        return self._surface.mesh(self._box, self._floor)

    def _state(self) -> State:
        return State(self._surface, self._touches, self._way)

    def _touch_next(self) -> None:
        place, normal, deviation = self._choose()
        standoff = CLEAR + 2.0 * min(deviation, 0.5 * FARTHER)
        while True:
            touched = self._finger.touch(place, normal, standoff, BEYOND)
            self._touches, self._way = self._touches + 1, self._way + touched.way
            if touched.outcome != "inside":
                break
            standoff += FARTHER
        self._last = place
        self._surface.observe(self._seen(touched))

    def _choose(self) -> tuple[Floats, Floats, float]:
        """Of places on the surface, the one of which the least is known."""
        places = self._rng.uniform(self._box[0], self._box[1], (CANDIDATES, 3))
        for _ in range(NEWTON):
            value, gradient = self._surface.at(places)
            steep = np.maximum((gradient**2).sum(axis=1), 0.1)
            places = places - (value / steep)[:, None] * gradient
        value, gradient = self._surface.at(places)
        inside = (places >= self._box[0]) & (places <= self._box[1])
        good = (np.abs(value) < NEAR) & inside.all(axis=1) & (places[:, 2] > self._floor)
        if not good.any():
            good = np.abs(value) <= np.abs(value).min()
        places, gradient = places[good], gradient[good]
        deviation = self._surface.deviations(places)
        away = np.linalg.norm(places - self._last, axis=1)
        best = int(np.argmax(deviation - self._tuning.travel * away))
        normal = gradient[best] / max(float(np.linalg.norm(gradient[best])), 1e-9)
        return places[best], normal, float(deviation[best])

    def _seen(self, touched: Touched) -> Observed:
        """What a touch tells: all of its points are off together, as the arm is."""
        points, normals, _ = touched.felt
        if not len(points):
            lost = np.array([UNKNOWN])
            error = np.array([EMPTY_ERROR])
            return Observed(
                touched.end[None], np.array([EMPTY]), error, 0.0, np.zeros((1, 3)), lost
            )
        assert normals is not None
        some = spread(points, self._tuning.points)
        count = len(some)
        return Observed(
            places=points[some],
            values=np.zeros(count),
            value_errors=np.full(count, PLACE_ERROR),
            shared=self._noise,
            gradients=normals[some],
            gradient_errors=np.full(count, SLOPE_ERROR if touched.smooth else UNKNOWN),
        )


def spread(points: Floats, count: int) -> list[int]:
    """Points (n, 3) far from one another, the first in the middle: their numbers."""
    away = np.linalg.norm(points - points.mean(axis=0), axis=1)
    found = [int(np.argmin(away))]
    nearest = np.linalg.norm(points - points[found[0]], axis=1)
    while len(found) < min(count, len(points)):
        found.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, np.linalg.norm(points - points[found[-1]], axis=1))
    return found


def _kernel(tuning: Tuning, box: Floats) -> Kernel:
    extent = np.ptp(box, axis=0)
    if tuning.kernel == "matern":
        return matern(tuning.length * float(extent.max()))
    return thin_plate(tuning.length * float(np.linalg.norm(extent + 2.0 * MARGIN)))
