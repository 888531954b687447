"""A method that explores with a Gaussian process: it touches where its surface is least certain.

Dragiev, Toussaint and Gienger, 2011; Yi, Calandra, Veiga, van Hoof, Hermans, Zhang and Peters,
*Active tactile object exploration with Gaussian processes*, 2016. To be fair, it is given the
object's bounding box, its travel may pass through the object, and of each touch it gets points
spread over the whole patch, with normals.

Its settings were chosen on the ellipsoid and the groove, with noise and 6 m of travel: of a Matern
and a thin-plate kernel, of lengths from 0.35 to 2 of the object's extent, of 5 and 9 points of each
touch, and with and without a preference for short travel.

The surface is implicit: 0 on the object, negative inside, with a slope of about 1. Williams and
Fitzgibbon, *Gaussian process implicit surfaces*, 2006; with normals as observed gradients,
Dragiev, Toussaint and Gienger, *Gaussian process implicit surfaces for shape estimation and
grasping*, 2011. Its prior is a ball. A kernel is a function of the distance r. Between values it
is k; between a value at x and a gradient at y, -g (x - y); between two gradients, -(h d d' + g 1),
where g is k' / r, h is (k'' - g) / r^2 and d is x - y.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
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

# From distances [m] to k, g and h, each of the same shape.
Kernel = Callable[[Floats], tuple[Floats, Floats, Floats]]


@dataclass(frozen=True, slots=True, kw_only=True)
class ChoiceSettings:
    """How the next touch is chosen."""

    n_candidates: int = 400  # random points that are moved onto the surface; touch one of them
    n_newton_steps: int = 8  # by which each point is moved onto the surface
    min_squared_slope: float = 0.1  # smallest divisor of a step; larger: shorter steps where flat
    max_value: float = 5e-4  # [m] largest absolute implicit function of a candidate
    travel_weight: float = 0.01  # [m of standard deviation / m of travel]; larger: shorter moves
    margin: float = 6e-3  # [m] around the object's box
    seed: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class ApproachSettings:
    """How the finger approaches a point where the surface is expected."""

    # [m] from the expected surface to the start of the pad, added to two standard deviations.
    clearance: float = 8e-3
    clearance_step: float = 0.02  # [m] added after each start inside of the object
    overshoot: float = 0.012  # [m] behind the expected surface, at which a touch ends


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservationSettings:
    """What the surface learns of a touch; errors are standard deviations."""

    n_points: int = 9  # observed of each touch
    pose_error: float = 1e-4  # [m] common to all points of a touch
    point_error: float = 2e-5  # [m] of a point, by an exact finger
    slope_error: float = 0.03  # of each component of a unit normal
    unknown_slope_error: float = 1e3  # the same of a normal that was not measured
    miss_value: float = 4e-3  # [m] of the implicit function where a miss ends
    miss_error: float = 3e-3  # [m] of that value


class Explorer:
    """Explores touch by touch, with a finger and the object's true bounding box (2, 3) [m]."""

    def __init__(
        self,
        finger: GuardedFinger,
        box: Floats,
        choice: ChoiceSettings = ChoiceSettings(),
        approach: ApproachSettings = ApproachSettings(),
        observation: ObservationSettings = ObservationSettings(),
    ):
        self.finger = finger
        self._choice, self._approach, self._observation = choice, approach, observation
        self._box = box + choice.margin * np.array([[-1.0], [1.0]])
        self._floor = float(box[0, 2])
        self._rng = np.random.default_rng(choice.seed)
        ball = BallPrior(box.mean(axis=0), 0.5 * float(np.ptp(box, axis=0).mean()))
        self._surface = GpSurface(matern(float(np.ptp(box, axis=0).max())), ball)
        self._last = ball.centre

    def touch_until(self, count: int) -> None:
        """Touch until the finger has made `count` touches."""
        while len(self.finger.touched) < count:
            self._touch_next()

    def mesh(self) -> Mesh:
        """The surface so far."""
        return self._surface.mesh(self._box, self._floor)

    def _touch_next(self) -> None:
        place, normal, deviation = self._choose()
        step = self._approach.clearance_step
        standoff = self._approach.clearance + 2.0 * min(deviation, 0.5 * step)
        while True:
            result = self.finger.touch(place, normal, standoff, self._approach.overshoot)
            if result.outcome != "inside":
                break
            standoff += step
        self._last = place
        self._surface.observe(observations_of(result, self._observation))

    def _choose(self) -> tuple[Floats, Floats, float]:
        """Point and normal of the surface where it is least certain, and the deviation there."""
        settings = self._choice
        places = self._rng.uniform(self._box[0], self._box[1], (settings.n_candidates, 3))
        for _ in range(settings.n_newton_steps):
            value, gradient = self._surface.at(places)
            squared_slope = np.maximum((gradient**2).sum(axis=1), settings.min_squared_slope)
            places = places - (value / squared_slope)[:, None] * gradient
        value, gradient = self._surface.at(places)
        inside = (places >= self._box[0]) & (places <= self._box[1])
        is_near = np.abs(value) < settings.max_value
        good = is_near & inside.all(axis=1) & (places[:, 2] > self._floor)
        if not good.any():
            good = np.abs(value) <= np.abs(value).min()
        places, gradient = places[good], gradient[good]
        deviation = self._surface.deviations(places)
        travel = np.linalg.norm(places - self._last, axis=1)
        best = int(np.argmax(deviation - settings.travel_weight * travel))
        normal = gradient[best] / max(float(np.linalg.norm(gradient[best])), 1e-9)
        return places[best], normal, float(deviation[best])


def observations_of(
    result: TouchResult, settings: ObservationSettings = ObservationSettings()
) -> Observations:
    """Observations from a touch, whose points share the error of the arm's pose."""
    points, normals, _ = result.contact
    unknown = settings.unknown_slope_error
    if not len(points):
        value, error = np.array([settings.miss_value]), np.array([settings.miss_error])
        gradients = np.zeros((1, 3)), np.array([unknown])
        return Observations(result.end[None], value, error, 0.0, *gradients)
    assert normals is not None
    chosen = farthest_points(points, settings.n_points)
    count = len(chosen)
    return Observations(
        places=points[chosen],
        values=np.zeros(count),
        value_errors=np.full(count, settings.point_error),
        shared=settings.pose_error,
        gradients=normals[chosen],
        gradient_errors=np.full(count, settings.slope_error if result.is_smooth else unknown),
    )


def farthest_points(points: Floats, count: int) -> list[int]:
    """Indices of points (n, 3) far from one another, the first nearest to their mean."""
    from_mean = np.linalg.norm(points - points.mean(axis=0), axis=1)
    chosen = [int(np.argmin(from_mean))]
    nearest = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return chosen


class TouchResult(NamedTuple):
    """Result of a touch."""

    outcome: str  # As in a tactile frame
    end: Floats  # Last position of the centre of the pad (3,) [m]
    contact: ContactPoints  # Of all touched taxels; empty after a miss
    is_smooth: bool  # Whether the normals are reliable


class GuardedFinger:
    """A finger of simulator, filter and curvature nodes as plain calls, in the scene of a file."""

    def __init__(self, scene: Path):
        spec = load_scene(scene).spec
        self.touched: list[ContactPoints] = []  # Contact points of each touch, with normals
        self.robot_time = 0.0  # At the end of the last touch [s]
        self._pad = pad_of_spec(spec.sensor)
        same = {name: getattr(spec, name) for name in ("object", "sensor", "effects", "seed")}
        self._loop = InProcessLoop(touching_nodes(simulator.Params(reach=spec.world.reach, **same)))

    def touch(
        self,
        place: Floats,
        normal: Floats,
        standoff: float,
        overshoot: float,
        min_upward: float = -0.7,
    ) -> TouchResult:
        """Approach a point (3,) where the surface is expected, against its outward unit normal.

        The pad starts `standoff` [m] before the point, and stops at the latest `overshoot` [m]
        behind it. `min_upward`: smallest z of the normal against which the pad moves.
        """
        upward = max(float(normal[2]), min_upward)
        heading = float(np.arctan2(normal[1], normal[0]))
        axes = pad_rotation(heading, float(np.arcsin(min(upward, 1.0))))
        goal = TouchGoal(
            goal=len(self.touched),
            touch=0,
            finger=1,
            pose=Pose(place - standoff * axes[:, 2], axes).array,
            reach=standoff + overshoot,
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
    """A ball as the prior of the surface."""

    centre: Floats  # (3,) [m]
    radius: float  # [m]

    def at(self, places: Floats) -> tuple[Floats, Floats]:
        """Values (n,) and gradients (n, 3) at places (n, 3)."""
        away = places - self.centre
        value = (np.einsum("ni,ni->n", away, away) - self.radius**2) / (2.0 * self.radius)
        return value, away / self.radius


class Observations(NamedTuple):
    """Observed values and gradients of the implicit function at places (n, 3)."""

    places: Floats  # [m]
    values: Floats  # (n,) [m]
    value_errors: Floats  # Standard deviations of independent errors (n,) [m]
    shared: float  # Standard deviation of their common error [m]
    gradients: Floats  # (n, 3)
    gradient_errors: Floats  # Standard deviations, (n,)


class GpSurface:
    """The surface and its uncertainty; `ball` is the prior."""

    def __init__(self, kernel: Kernel, ball: BallPrior):
        self._kernel, self._ball = kernel, ball
        self._places, self._rest = np.zeros((0, 3)), np.zeros((0, 4))
        self._whole, self._bare = CholeskyFactor(), CholeskyFactor()
        self._weights = np.zeros((0, 4))

    def observe(self, observed: Observations) -> None:
        """Add observations."""
        value, gradient = self._ball.at(observed.places)
        spread = np.column_stack([observed.value_errors, *3 * [observed.gradient_errors]])
        for factor, gradients in ((self._whole, True), (self._bare, False)):
            across = covariance_block(self._kernel, observed.places, self._places, gradients)
            own = covariance_block(self._kernel, observed.places, observed.places, gradients)
            own[np.diag_indices(len(own))] += (spread if gradients else spread[:, :1]).ravel() ** 2
            step = 4 if gradients else 1
            own[::step, ::step] += observed.shared**2
            factor.append(across, own)
        rest = np.column_stack([observed.values - value, observed.gradients - gradient])
        self._places = np.concatenate([self._places, observed.places])
        self._rest = np.concatenate([self._rest, rest])
        self._weights = self._whole.solve(self._rest.ravel()).reshape(-1, 4)

    def at(self, places: Floats, block_size: int = 4096) -> tuple[Floats, Floats]:
        """Values (n,) and gradients (n, 3) at places (n, 3), evaluated in blocks."""
        value, gradient = self._ball.at(places)
        for start in range(0, len(places) if len(self._places) else 0, block_size):
            block = slice(start, start + block_size)
            added_value, added_gradient = self._corrections(places[block])
            value[block] += added_value
            gradient[block] += added_gradient
        return value, gradient

    def deviations(self, places: Floats) -> Floats:
        """Standard deviations (n,) [m] of the values at places (n, 3), given observed values.

        Observed gradients are left out: they take sixteen times as long, and rank places alike.
        """
        half = self._bare.half(covariance_block(self._kernel, self._places, places, False))
        prior, _, _ = self._kernel(np.zeros(1))
        return np.asarray(np.sqrt(np.maximum(prior - np.einsum("ij,ij->j", half, half), 0.0)))

    def mesh(
        self, box: Floats, floor: float, cell: float = 2e-3, level: int = 7, step: float = 1e-3
    ) -> Mesh:
        """The surface within a box (2, 3), cut off at the height of the platform.

        The field is interpolated by cubic splines on a grid of `cell` [m], which is far smaller
        than the length of the kernel. `level`: of the mesh, by default with cells of 0.8 mm.
        `step`: fraction of a mesh cell's edge over which slopes are taken.
        """
        size = np.ceil((box[1] - box[0]) / cell).astype(int) + 1
        axes = [np.linspace(box[0, i], box[1, i], size[i]) for i in range(3)]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        field = spline_filter(self.at(grid.reshape(-1, 3))[0].reshape(size))
        scale = (size - 1) / (box[1] - box[0])

        def at(places: Floats) -> Floats:
            nodes = ((places - box[0]) * scale).T
            value = map_coordinates(field, nodes, prefilter=False, mode="nearest")
            return np.asarray(np.maximum(value, floor - places[:, 2]))

        def inside_out(places: Floats, edges: Floats) -> tuple[Floats, Floats]:
            ahead, behind = at(places + step * edges), at(places - step * edges)
            return at(places), (ahead - behind) / (2.0 * step)

        return isosurface(inside_out, box, level)

    def _corrections(self, places: Floats) -> tuple[Floats, Floats]:
        """Values and gradients that observations add to the ball, without the whole matrix."""
        value, slope = self._weights[:, 0], self._weights[:, 1:]
        squares = (places**2).sum(axis=1)[:, None] + (self._places**2).sum(axis=1)
        r = np.sqrt(np.maximum(squares - 2.0 * places @ self._places.T, 0.0))
        k, g, h = self._kernel(r)
        along = places @ slope.T - np.einsum("mi,mi->m", self._places, slope)  # d . slope
        # The gradients' part is -g d . slope.
        added = k @ value - (g * along).sum(axis=1)
        # -(g d . slope)' = -h (d . slope) d - g slope, for (k' / r)' = h r.
        radial = g * value - h * along
        gradient = radial.sum(axis=1)[:, None] * places - radial @ self._places - g @ slope
        return added, gradient


def covariance_block(kernel: Kernel, first: Floats, second: Floats, has_gradients: bool) -> Floats:
    """Covariance between places (n, 3) and (m, 3): of values (n, m), or also of gradients.

    The latter has shape (4 n, 4 m), for each place first the value and then the gradient.
    """
    offsets = first[:, None] - second[None]
    k, g, h = kernel(np.sqrt(np.einsum("nmi,nmi->nm", offsets, offsets)))
    if not has_gradients:
        return k
    block = np.empty((len(first), 4, len(second), 4))
    block[:, 0, :, 0] = k
    toward = -g[..., None] * offsets
    block[:, 0, :, 1:] = toward
    block[:, 1:, :, 0] = -toward.transpose(0, 2, 1)
    for i in range(3):
        for j in range(3):
            block[:, 1 + i, :, 1 + j] = -h * offsets[..., i] * offsets[..., j] - (
                g if i == j else 0.0
            )
    return block.reshape(4 * len(first), 4 * len(second))


def matern(length: float) -> Kernel:
    """Matern kernel, nu = 5/2, with gradients of unit variance; `length` as the distances [m]."""

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
        self.lower = np.zeros((0, 0))  # L, contiguous by rows, which scipy does not copy

    def append(self, across: Floats, own: Floats) -> None:
        """Add rows: their covariance with earlier ones (m, size), and among themselves (m, m)."""
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
