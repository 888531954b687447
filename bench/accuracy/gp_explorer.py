"""A peer that explores by a Gaussian process: it touches where its surface is known least.

Dragiev, Toussaint and Gienger, 2011; Yi, Calandra, Veiga, van Hoof, Hermans, Zhang and Peters,
*Active tactile object exploration with Gaussian processes*, 2016. To be fair, it is told the box
that the object stands in, it may pass through the object on its way, and of each touch it gets
points spread over the whole patch, with their normals.

Its numbers were chosen on the ellipsoid and the groove, with noise and 6 m of way: of a Matern and
a thin-plate kernel, of lengths from 0.35 to 2 of the object's extent, of 5 and 9 points for each
touch, and of nearer places preferred or not.

The surface is implicit: 0 on the object, negative inside, about 1 m a metre. Williams and
Fitzgibbon, *Gaussian process implicit surfaces*, 2006; with normals as observed gradients,
Dragiev, Toussaint and Gienger, *Gaussian process implicit surfaces for shape estimation and
grasping*, 2011. Before anything is touched it is a ball. A kernel is a function of the distance r.
Between values it is k; between a value at x and a gradient at y, -g (x - y); between two gradients,
-(h d d' + g 1), where g is k' / r, h is (k'' - g) / r^2 and d is x - y.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.ndimage import map_coordinates, spline_filter

from palpate.bench.loop import InProcessLoop, touching_nodes
from palpate.core.arrays import Floats
from palpate.core.explore.tracing import TOUCH_DEPTH
from palpate.core.poses import Pose, pad_rotation
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.shapes import Mesh, isosurface
from palpate.launch.scene import load_scene
from palpate.messages.types import SurfacePatch, TactileFrame, TouchGoal
from palpate.nodes import simulator
from palpate.nodes.specs.sensors import pad_of_spec

CANDIDATES = 400
NEWTON = 8  # Steps with which candidates are brought onto the surface
NEAR = 5e-4  # Candidates that are still farther from it are left out, m
CLEAR = 8e-3  # The pad starts this far before the surface, and two standard deviations, m
FARTHER = 0.02  # And so much farther if it began inside, m
BEYOND = 0.012  # How far behind the expected surface a touch may go, m
MARGIN = 6e-3  # Around the object's box, m
POINT_ERROR, SLOPE_ERROR = 2e-5, 0.03  # Of points and normals of an exact finger, m and 1
EMPTY, EMPTY_ERROR = 4e-3, 3e-3  # What a miss tells of the place where it ended, m
LEAST_UP = -0.7  # Of a normal's z: the finger comes from no farther below
TOUCH_POINTS = 9  # Of each touch
AT_ONCE = 4096  # Places that are evaluated together
UNKNOWN = 1e3  # Standard deviation of a gradient that nobody measured
CELL = 2e-3  # Of the grid whose cubic interpolation the mesh is made of, m: far below the kernel's
LEVEL = 7  # Of the mesh: cells of 0.8 mm, with their corners on the surface
STEP = 1e-3  # Of a way along a cell's edge, over which the slope is taken
# Of distances in m, of their shape each: k, g and h.
Kernel = Callable[[Floats], tuple[Floats, Floats, Floats]]


class Explorer:
    """Touch by touch.

    `finger`: what it touches with. `box` (2, 3): the object's true box, m. `noise`: standard
    deviation of a touch's place, m. `travel`: how much deviation a metre of travel outweighs, m.
    """

    def __init__(self, finger: GuardedFinger, box: Floats, noise: float, travel: float):
        self.finger, self._noise, self._travel = finger, noise, travel
        self._box = box + MARGIN * np.array([[-1.0], [1.0]])
        self._floor = float(box[0, 2])
        self._rng = np.random.default_rng(0)
        ball = BallPrior(box.mean(axis=0), 0.5 * float(np.ptp(box, axis=0).mean()))
        self._surface = GpSurface(matern(float(np.ptp(box, axis=0).max())), ball)
        self._last = ball.centre

    def touch_until(self, count: int) -> None:
        """Go on until the finger has touched so often."""
        while len(self.finger.touched) < count:
            self._touch_next()

    def mesh(self) -> Mesh:
        """The surface so far."""
        return self._surface.mesh(self._box, self._floor)

    def _touch_next(self) -> None:
        place, normal, deviation = self._choose()
        standoff = CLEAR + 2.0 * min(deviation, 0.5 * FARTHER)
        while True:
            touched = self.finger.touch(place, normal, standoff, BEYOND)
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
        best = int(np.argmax(deviation - self._travel * away))
        normal = gradient[best] / max(float(np.linalg.norm(gradient[best])), 1e-9)
        return places[best], normal, float(deviation[best])

    def _seen(self, touched: TouchResult) -> Observations:
        """What a touch tells: all of its points are off together, as the arm is."""
        points, normals, _ = touched.contact
        if not len(points):
            nowhere = touched.end[None], np.array([EMPTY]), np.array([EMPTY_ERROR])
            return Observations(*nowhere, 0.0, np.zeros((1, 3)), np.array([UNKNOWN]))
        assert normals is not None
        some = farthest_points(points, TOUCH_POINTS)
        count = len(some)
        return Observations(
            places=points[some],
            values=np.zeros(count),
            value_errors=np.full(count, POINT_ERROR),
            shared=self._noise,
            gradients=normals[some],
            gradient_errors=np.full(count, SLOPE_ERROR if touched.smooth else UNKNOWN),
        )


def farthest_points(points: Floats, count: int) -> list[int]:
    """Points (n, 3) far from one another, the first in the middle: their numbers."""
    away = np.linalg.norm(points - points.mean(axis=0), axis=1)
    found = [int(np.argmin(away))]
    nearest = np.linalg.norm(points - points[found[0]], axis=1)
    while len(found) < min(count, len(points)):
        found.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, np.linalg.norm(points - points[found[-1]], axis=1))
    return found


class TouchResult(NamedTuple):
    """What one touch came to."""

    outcome: str  # As in a tactile frame
    end: Floats  # Where the middle of the face then was, (3,), m
    contact: ContactPoints  # Everything that touched; none after a miss
    smooth: bool  # Whether the normals are to be trusted


class GuardedFinger:
    """Simulator, filter and curvature as plain calls, in the scene that is explored."""

    def __init__(self, scene: Path):
        spec = load_scene(scene).spec
        self.touched: list[ContactPoints] = []  # What each touch met, with normals
        self.robot_time = 0.0  # At the end of the last of them, s
        self._pad = pad_of_spec(spec.sensor)
        same = {name: getattr(spec, name) for name in ("object", "sensor", "effects", "seed")}
        self._loop = InProcessLoop(touching_nodes(simulator.Params(reach=spec.world.reach, **same)))

    def touch(self, place: Floats, normal: Floats, standoff: float, beyond: float) -> TouchResult:
        """Come along an outward unit normal to a place where the surface is expected.

        `standoff` and `beyond`: how far before it the pad starts and behind it the way ends, m.
        """
        upward = max(float(normal[2]), LEAST_UP)
        heading = float(np.arctan2(normal[1], normal[0]))
        axes = pad_rotation(heading, float(np.arcsin(min(upward, 1.0))))
        goal = TouchGoal(
            goal=len(self.touched),
            touch=0,
            finger=1,
            pose=Pose(place - standoff * axes[:, 2], axes).array,
            reach=standoff + beyond,
            depth=TOUCH_DEPTH,
            direction=axes[:, 1],
            not_before=0.0,
        )
        published = self._loop.publish("/finger/goal", goal)
        frame: TactileFrame = published["/touch/raw"]
        patch: SurfacePatch = published["/touch/patch"]
        contact = ContactPoints.of_touch(patch.points, patch.normals)
        self.touched.append(contact)
        self.robot_time = frame.robot_time
        return TouchResult(frame.outcome, patch.pose[:3], contact, patch.kind == "smooth")


class BallPrior(NamedTuple):
    """What is expected before anything is touched."""

    centre: Floats  # (3,), m
    radius: float  # m

    def at(self, places: Floats) -> tuple[Floats, Floats]:
        """Values (n,) and gradients (n, 3) at places (n, 3)."""
        away = places - self.centre
        value = (np.einsum("ni,ni->n", away, away) - self.radius**2) / (2.0 * self.radius)
        return value, away / self.radius


class Observations(NamedTuple):
    """What was found out, at places (n, 3)."""

    places: Floats  # m
    values: Floats  # (n,), m
    value_errors: Floats  # Standard deviations of each by itself, (n,), m
    shared: float  # Standard deviation of what all are off by together, m
    gradients: Floats  # (n, 3)
    gradient_errors: Floats  # Standard deviations, (n,)


class GpSurface:
    """A surface and what it knows of itself; `ball` is what is expected."""

    def __init__(self, kernel: Kernel, ball: BallPrior):
        self._kernel, self._ball = kernel, ball
        self._places, self._rest = np.zeros((0, 3)), np.zeros((0, 4))
        self._whole, self._bare = CholeskyFactor(), CholeskyFactor()
        self._weights = np.zeros((0, 4))

    def observe(self, seen: Observations) -> None:
        """Take in what was found out."""
        value, gradient = self._ball.at(seen.places)
        spread = np.column_stack([seen.value_errors, *3 * [seen.gradient_errors]])
        for factor, gradients in ((self._whole, True), (self._bare, False)):
            across = covariance_block(self._kernel, seen.places, self._places, gradients)
            own = covariance_block(self._kernel, seen.places, seen.places, gradients)
            own[np.diag_indices(len(own))] += (spread if gradients else spread[:, :1]).ravel() ** 2
            step = 4 if gradients else 1
            own[::step, ::step] += seen.shared**2
            factor.append(across, own)
        rest = np.column_stack([seen.values - value, seen.gradients - gradient])
        self._places = np.concatenate([self._places, seen.places])
        self._rest = np.concatenate([self._rest, rest])
        self._weights = self._whole.solve(self._rest.ravel()).reshape(-1, 4)

    def at(self, places: Floats) -> tuple[Floats, Floats]:
        """Values (n,) and gradients (n, 3) at places (n, 3)."""
        value, gradient = self._ball.at(places)
        for start in range(0, len(places) if len(self._places) else 0, AT_ONCE):
            some = slice(start, start + AT_ONCE)
            more, steeper = self._found(places[some])
            value[some] += more
            gradient[some] += steeper
        return value, gradient

    def deviations(self, places: Floats) -> Floats:
        """Standard deviations (n,) of the values at places (n, 3), by the values observed, m.

        Gradients are left out: it would take sixteen times as long, and order places alike.
        """
        half = self._bare.half(covariance_block(self._kernel, self._places, places, False))
        prior, _, _ = self._kernel(np.zeros(1))
        return np.asarray(np.sqrt(np.maximum(prior - np.einsum("ij,ij->j", half, half), 0.0)))

    def mesh(self, box: Floats, floor: float) -> Mesh:
        """The surface within a box (2, 3), cut off at the height of what the object stands on."""
        size = np.ceil((box[1] - box[0]) / CELL).astype(int) + 1
        axes = [np.linspace(box[0, i], box[1, i], size[i]) for i in range(3)]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        field = spline_filter(self.at(grid.reshape(-1, 3))[0].reshape(size))
        scale = (size - 1) / (box[1] - box[0])

        def at(places: Floats) -> Floats:
            nodes = ((places - box[0]) * scale).T
            value = map_coordinates(field, nodes, prefilter=False, mode="nearest")
            return np.asarray(np.maximum(value, floor - places[:, 2]))

        def inside_out(places: Floats, ways: Floats) -> tuple[Floats, Floats]:
            ahead, behind = at(places + STEP * ways), at(places - STEP * ways)
            return at(places), (ahead - behind) / (2.0 * STEP)

        return isosurface(inside_out, box, LEVEL)

    def _found(self, places: Floats) -> tuple[Floats, Floats]:
        """What observations add to the ball: never the whole matrix between the places."""
        value, slope = self._weights[:, 0], self._weights[:, 1:]
        squares = (places**2).sum(axis=1)[:, None] + (self._places**2).sum(axis=1)
        r = np.sqrt(np.maximum(squares - 2.0 * places @ self._places.T, 0.0))
        k, g, h = self._kernel(r)
        along = places @ slope.T - np.einsum("mi,mi->m", self._places, slope)  # d . slope
        # A gradient's part, -g d . slope; the derivatives of all that by the place.
        more = k @ value - (g * along).sum(axis=1)
        # -(g d . slope)' = -h (d . slope) d - g slope, for (k' / r)' = h r.
        away = g * value - h * along
        steeper = away.sum(axis=1)[:, None] * places - away @ self._places - g @ slope
        return more, steeper


def covariance_block(kernel: Kernel, one: Floats, other: Floats, gradients: bool) -> Floats:
    """Covariance between places (n, 3) and (m, 3).

    Returns (4 n, 4 m), of each place first the value and then the gradient.
    """
    away = one[:, None] - other[None]
    k, g, h = kernel(np.sqrt(np.einsum("nmi,nmi->nm", away, away)))
    if not gradients:
        return k
    found = np.empty((len(one), 4, len(other), 4))
    found[:, 0, :, 0] = k
    toward = -g[..., None] * away
    found[:, 0, :, 1:] = toward
    found[:, 1:, :, 0] = -toward.transpose(0, 2, 1)
    for i in range(3):
        for j in range(3):
            found[:, 1 + i, :, 1 + j] = -h * away[..., i] * away[..., j] - (g if i == j else 0.0)
    return found.reshape(4 * len(one), 4 * len(other))


def matern(length: float) -> Kernel:
    """Matern, nu = 5/2, whose gradients have unit variance: of a distance, in its own unit."""

    def parts(r: Floats) -> tuple[Floats, Floats, Floats]:
        s = np.sqrt(5.0) / length * r
        fall = np.exp(-s)
        scale = 0.6 * length**2
        k = scale * (1.0 + s + s * s / 3.0) * fall
        return k, -(1.0 + s) * fall, 5.0 / length**2 * fall

    return parts


class CholeskyFactor:
    """Lower factor L of a positive definite matrix L L'."""

    def __init__(self) -> None:
        self.lower = np.zeros((0, 0))  # L, whole and in rows: scipy copies no such factor

    def append(self, across: Floats, own: Floats) -> None:
        """Add rows: their covariance with those before, (m, size), and their own, (m, m)."""
        left = self.half(across.T).T
        corner = cholesky(own - left @ left.T, lower=True)
        self.lower = np.block([[self.lower, np.zeros_like(left.T)], [left, corner]])

    def half(self, right: Floats) -> Floats:
        """Solve L x = right."""
        return solve_triangular(self.lower, right, lower=True, check_finite=False)

    def solve(self, right: Floats) -> Floats:
        """Solve L L' x = right."""
        half = self.half(right)
        return solve_triangular(self.lower, half, lower=True, trans=1, check_finite=False)
