"""Explore with the surface's own variance, touch for touch beside palpate.

Touch where the least is known.

Dragiev, Toussaint and Gienger, 2011; Yi, Calandra, Veiga, van Hoof, Hermans, Zhang and Peters,
*Active tactile object exploration with Gaussian processes*, 2016. To be fair, it is told the box
that the object stands in, it may pass through the object on its way, and of each touch it gets
points spread over the whole patch, with their normals.

Both touch the same objects with the same finger and the same noise, and both solids are measured
the same way. What `Tuning` holds was chosen on the two objects in `TUNED_ON`, with noise and 6 m
of way: of a Matern and a thin-plate kernel, of lengths from 0.35 to 2 of the object's extent, of
5 and 9 points for each touch, and of nearer places preferred or not. These two are shown and do
not count.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.bench.explore.gp_surface import (
    UNKNOWN,
    BallPrior,
    GpSurface,
    Kernel,
    Observations,
    matern,
    thin_plate,
)
from palpate.bench.explore.harness import (
    NOISES,
    Demand,
    Explored,
    InProcessLoop,
    explore_scene,
    path_length,
    touching_nodes,
    write_scene,
)
from palpate.bench.objects import EXPLORED_OBJECTS
from palpate.bench.table import Row
from palpate.core import Floats, pad_rotation, pose_of, split_pose
from palpate.core.explore.tracing import TOUCH_DEPTH
from palpate.core.geometry import PreparedSurface, compare_surfaces, prepare_surface
from palpate.core.rebuild.contours import ContactPoints, contact_points_of
from palpate.core.shapes import Mesh
from palpate.core.touch import Jet
from palpate.launch import load_scene
from palpate.messages.types import SurfacePatch, TactileFrame, TouchGoal
from palpate.nodes import simulator
from palpate.nodes.specs import build_shape, pad_of_spec
from palpate.tools import single_threaded

TUNED_ON = ("ellipsoid", "groove")
COMPARED = ("egg", "box", "vase", "bottle", "twist", "hourglass")
QUICK = ("egg", "vase")
# Standard deviation of a touch's place that the peer is told, m.
PLACE_NOISE = {"exact": 0.0, "noise": 1e-4}
DEMANDED = "largest variance"
LEAST_TIMES = 2.0  # Times palpate's error, at the same way of the finger
CANDIDATES = 400
NEWTON = 8  # Steps with which candidates are brought onto the surface
NEAR = 5e-4  # Candidates that are still farther from it are left out, m
CLEAR = 8e-3  # The pad starts this far before the surface, and two standard deviations, m
FARTHER = 0.02  # And so much farther if it began inside, m
BEYOND = 0.012  # How far behind the expected surface a touch may go, m
MARGIN = 6e-3  # Around the object's box, m
# Of the points and of the normals of an exact finger, m and 1.
POINT_ERROR, SLOPE_ERROR = 2e-5, 0.03
EMPTY, EMPTY_ERROR = 4e-3, 3e-3  # What a miss tells of the place where it ended, m
LEAST_UP = -0.7  # Of a normal's z: the finger comes from no farther below


def gp_rows(quick: bool) -> Iterator[Row]:
    """Figures of the peer beside ours; fewer objects if quick."""
    with single_threaded():
        yield from gp_comparison(QUICK if quick else COMPARED)


class GpErrors(NamedTuple):
    """What the peer came to; errors are root mean square, % of the object's height."""

    way: float  # After at least as long a way of the finger as palpate's
    touches: float  # And after at least as many touches too
    made: int  # Touches that it makes on that way


class Tuning(NamedTuple):
    """What two objects were used for: see `gp_peer`."""

    kernel: str = "matern"  # Matern or thin plate
    length: float = 1.0  # Of the kernel, over the object's largest extent
    points: int = 9  # Of each touch
    # How much deviation a metre of travel outweighs, m; 0 for the greatest variance alone.
    travel: float = 0.01


class ExplorerState(NamedTuple):
    """What it has come to."""

    surface: GpSurface  # The surface so far
    touches: int  # Touches made
    way: float  # Of the finger, m


class Explorer:
    """Touch by touch.

    `finger`: what it touches with. `box` (2, 3): the object's true box, m. `noise`: standard
    deviation of a touch's place, m. `tuning`: how it does it.
    """

    def __init__(self, finger: GuardedFinger, box: Floats, noise: float, tuning: Tuning):
        self._finger, self._noise, self._tuning = finger, noise, tuning
        self._box = box + MARGIN * np.array([[-1.0], [1.0]])
        self._floor = float(box[0, 2])
        self._rng = np.random.default_rng(0)
        radius = 0.5 * float(np.ptp(box, axis=0).mean())
        ball = BallPrior(box.mean(axis=0), radius)
        self._surface = GpSurface(_kernel(tuning, box), ball)
        self._touches, self._way = 0, 0.0
        self._last = ball.centre

    def until(self, over: Callable[[ExplorerState], bool]) -> ExplorerState:
        """Go on until a state is enough."""
        while not over(self._state()):
            self._touch_next()
        return self._state()

    def mesh(self) -> Mesh:
        """The surface so far."""
        return self._surface.mesh(self._box, self._floor)

    def _state(self) -> ExplorerState:
        return ExplorerState(self._surface, self._touches, self._way)

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

    def _seen(self, touched: TouchResult) -> Observations:
        """What a touch tells: all of its points are off together, as the arm is."""
        points, normals, _ = touched.contact
        if not len(points):
            lost = np.array([UNKNOWN])
            error = np.array([EMPTY_ERROR])
            return Observations(
                touched.end[None], np.array([EMPTY]), error, 0.0, np.zeros((1, 3)), lost
            )
        assert normals is not None
        some = farthest_points(points, self._tuning.points)
        count = len(some)
        return Observations(
            places=points[some],
            values=np.zeros(count),
            value_errors=np.full(count, POINT_ERROR),
            shared=self._noise,
            gradients=normals[some],
            gradient_errors=np.full(count, SLOPE_ERROR if touched.smooth else UNKNOWN),
        )


def _kernel(tuning: Tuning, box: Floats) -> Kernel:
    extent = np.ptp(box, axis=0)
    if tuning.kernel == "matern":
        return matern(tuning.length * float(extent.max()))
    return thin_plate(tuning.length * float(np.linalg.norm(extent + 2.0 * MARGIN)))


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
    way: float  # Of the finger, m


class GuardedFinger:
    """Simulator, filter and curvature as plain calls.

    `scene`: the scene that is explored.
    """

    def __init__(self, scene: Path):
        spec = load_scene(scene).spec
        self._pad, self._made = pad_of_spec(spec.sensor), 0
        params = simulator.Params(
            object=spec.object,
            sensor=spec.sensor,
            effects=spec.effects,
            reach=spec.world.reach,
            seed=spec.seed,
        )
        self._loop = InProcessLoop(touching_nodes(params))

    def touch(self, place: Floats, normal: Floats, standoff: float, beyond: float) -> TouchResult:
        """Come along a normal from before a place, and go no farther than behind it.

        `place` and `normal` (3,): where the surface is expected, m, and its outward unit normal.
        `standoff` and `beyond`: how far before the place the pad starts, and how far behind it the
        way ends, m.
        """
        upward = max(float(normal[2]), LEAST_UP)
        heading = float(np.arctan2(normal[1], normal[0]))
        axes = pad_rotation(heading, float(np.arcsin(min(upward, 1.0))))
        goal = TouchGoal(
            goal=self._made,
            touch=0,
            finger=1,
            pose=pose_of(place - standoff * axes[:, 2], axes),
            reach=standoff + beyond,
            depth=TOUCH_DEPTH,
            direction=axes[:, 1],
            not_before=0.0,
        )
        self._made += 1
        published = self._loop.publish("/finger/goal", goal)
        return self._touched(published["/touch/raw"], published["/touch/patch"])

    def _touched(self, frame: TactileFrame, patch: SurfacePatch) -> TouchResult:
        jet = Jet(patch.jet, patch.jet_scale) if len(patch.jet) else None
        contact = contact_points_of(self._pad, patch.pose, patch.height, patch.mask, jet)
        end, _ = split_pose(patch.pose)
        return TouchResult(
            frame.outcome, end, contact, patch.kind == "smooth", path_length(frame.move)
        )


def compare_on(name: str, noise: str) -> Comparison:
    """Explore one object in all ways."""
    with tempfile.TemporaryDirectory(prefix="palpate-bench-") as folder:
        scene = write_scene(Path(folder), EXPLORED_OBJECTS[name], NOISES[noise], Demand())
        ours = explore_scene(scene)
        box = build_shape(load_scene(scene).spec.object).bounds()
        peers = {
            how: Explorer(GuardedFinger(scene), box, PLACE_NOISE[noise], tuning)
            for how, tuning in TUNINGS.items()
        }
    truth = prepare_surface(ours.truth.vertices, ours.truth.faces)
    return ours, {how: _found(peer, truth, ours) for how, peer in peers.items()}


def _found(peer: Explorer, truth: PreparedSurface, ours: Explored) -> GpErrors:
    made = peer.until(lambda state: state.way >= ours.travel).touches
    at_way = gp_percent(peer, truth, ours)
    peer.until(lambda state: state.touches >= ours.touches)
    return GpErrors(at_way, gp_percent(peer, truth, ours), made)


def gp_percent(peer: Explorer, truth: PreparedSurface, ours: Explored) -> float:
    """Root mean square error of the peer's surface so far, % of the object's height."""
    return 100.0 * compare_surfaces(truth, prepare_surface(*peer.mesh())).rms / ours.truth.height


def gp_comparison(names: Sequence[str]) -> Iterator[Row]:
    """Figures, object by object, and their means: the tuned objects do not count."""
    for noise in NOISES:
        ratios: dict[str, list[tuple[float, float]]] = {how: [] for how in TUNINGS}
        for name in (*TUNED_ON, *names):
            ours, peers = compare_on(name, noise)
            shown = f"{ours.percent:.3f} %, {ours.travel:.1f} m, {ours.touches}"
            yield Row(f"peer, {name}, {noise}: ours, way, touches", shown)
            for how, found in peers.items():
                shown = f"{found.way:.3f}, {found.touches:.3f} %, {found.made}"
                title = f"{how}: by way, by touches, made on the way"
                yield Row(title, shown)
                if name not in TUNED_ON:
                    both = found.way / ours.percent, found.touches / ours.percent
                    ratios[how].append(both)
        for how, some in ratios.items():
            yield from _means(f"{noise}, {how}: over ours", some, demanded=how == DEMANDED)


def _means(title: str, ratios: list[tuple[float, float]], *, demanded: bool) -> Iterator[Row]:
    """Geometric means over the objects."""
    way, touches = np.exp(np.mean(np.log(ratios), axis=0)).tolist()
    target = f">= {LEAST_TIMES:g} x" if demanded else ""
    yield Row(f"{title}, same way", f"{way:.2f} x", target, way >= LEAST_TIMES or not demanded)
    yield Row(f"{title}, same touches", f"{touches:.2f} x")


# As it is published, and with a travel that counts, which serves it better.
TUNINGS = {"largest variance": Tuning(travel=0.0), "nearer preferred": Tuning()}
# palpate's run on one object, and the peer's by how it chooses.
Comparison = tuple[Explored, dict[str, GpErrors]]
