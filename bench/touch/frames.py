"""One touch: frames a second, how exact a cast is, and the cost of each effect.

All is measured in turns within one run, for machines change their speed.
"""

from __future__ import annotations

import statistics
import time
import timeit
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple, TypeVar

import numpy as np

from palpate.bench.explore import InProcessLoop
from palpate.bench.table import Row
from palpate.bench.touch.curvature import (
    COLUMNS,
    MOST_ERROR,
    MOST_PARTIAL,
    OURS,
    QUICK_TRIALS,
    THESIS,
    TRIALS,
    estimator_rows,
    partial_rows,
)
from palpate.core import ROBOT_PRESETS, Floats, pad_rotation, pose_of
from palpate.core.shapes import Superquadric, TriangleShape
from palpate.core.touch import Pipeline, SimulatedTouch, fit_jet
from palpate.core.touch.effects import EFFECT_NAMES
from palpate.launch import load_scene
from palpate.messages.types import SensorInfo, SurfacePatch, TactileFrame, TactileImage, TouchGoal
from palpate.nodes import curvature, filter, simulator
from palpate.nodes import simulator as simulator_node
from palpate.nodes.runtime import Outputs
from palpate.nodes.specs import (
    EffectSpecs,
    ObjectSpec,
    PadSpec,
    PoseSpec,
    SensorSpec,
    SuperquadricSpec,
    build_pipeline,
    encode_mesh,
    pad_of_spec,
)

WORN = "worn_sensor"  # The scene with all the faults of 1999
SIZE, EXPONENTS = (0.03, 0.025, 0.04), (0.7, 0.9)
MESH_LEVEL = 5  # 20k faces
FRAMES, ROUNDS = 40, 31
Echo = Callable[[str], None]
Message = TypeVar("Message")
EFFECT_FRAMES = 40  # Touches on which a cost is measured at a time
EFFECT_REPEATS = 15
SEED = 5


def bench_touch(*, quick: bool, echo: Echo = print) -> int:
    """Print the figures of a touch, one a line.

    Parameters
    ----------
    quick : bool
        Fewer frames.
    echo : callable
        Takes one line.

    Returns
    -------
    int
        0 if every demand is met, else 1.
    """
    frames, rounds = (FRAMES, 5) if quick else (FRAMES, ROUNDS)
    missed = False
    rows = (
        *speed_rows(frames, rounds),
        *exactness_rows(frames),
        *estimator_summary(QUICK_TRIALS if quick else TRIALS),
    )
    for row in rows:
        missed = missed or not row.holds
        echo(str(row))
    return int(missed)


def speed_rows(frames: int, rounds: int) -> Iterable[Row]:
    """Costs of a frame, all measured in turn within one run."""
    exact = ObjectSpec(superquadric=SuperquadricSpec(size=SIZE, exponents=EXPONENTS))
    vertices, faces = _solid().mesh(MESH_LEVEL)
    mesh = ObjectSpec(mesh=encode_mesh(vertices, faces))
    worn = load_scene(WORN).spec.effects
    # A dead taxel under the contact looks like an impulse.
    quiet = {name: worn[name] for name in worn if name not in ("salt_and_pepper", "dead_taxels")}
    chains = {
        "ideal": TouchChain(simulator.Params(object=exact)),
        "mesh": TouchChain(simulator.Params(object=mesh)),
        "worn": TouchChain(simulator.Params(object=exact, effects=worn)),
        "quiet": TouchChain(simulator.Params(object=exact, effects=quiet)),
        "salty": TouchChain(
            simulator.Params(object=exact, effects={**worn, "salt_and_pepper": {"rate": 0.08}})
        ),
    }
    goals = list(_goals(frames))
    simulated: dict[str, list[float]] = {name: [] for name in chains}
    whole: dict[str, list[float]] = {name: [] for name in chains}
    for _ in range(rounds):
        for name, chain in chains.items():
            simulated[name].append(_seconds(chain.simulate, goals))
            whole[name].append(_seconds(chain.feel, goals))
    frame = {name: statistics.median(seconds) for name, seconds in simulated.items()}
    patch = {name: statistics.median(seconds) for name, seconds in whole.items()}
    yield _at_least("ideal superquadric, 256 rays", 1.0 / frame["ideal"], 2000)
    yield _at_least(f"mesh of {len(faces) // 1000}k faces, 256 rays", 1.0 / frame["mesh"], 3000)
    ratio = frame["worn"] / frame["ideal"]
    yield Row(f"frame of {WORN}, to the ideal one", f"{ratio:.2f}", "<= 1.25", ratio <= 1.25)
    yield _at_most("simulator, filter and curvature: ideal", patch["ideal"], 600)
    yield _at_most(f"the same: {WORN} without impulses", patch["quiet"], 600)
    yield _at_most("the same, 8 % impulses: the robust fit is on", patch["salty"], 2000)


def _seconds(feel: Callable[[TouchGoal], object], goals: list[TouchGoal]) -> float:
    began = time.perf_counter()
    for goal in goals:
        feel(goal)
    return (time.perf_counter() - began) / len(goals)


def _at_least(name: str, rate: float, least: float) -> Row:
    return Row(name, f"{rate:.0f} /s", f">= {least:.0f} /s", rate >= least)


def exactness_rows(frames: int) -> Iterable[Row]:
    """Errors of casts, against extended precision and against the sag of facets."""
    exact, ball = _solid(), Superquadric(np.full(3, 0.03), np.ones(2))
    worst = max(_error_of_cast(exact, *ray) for ray in _rays(frames))
    yield Row("error of a cast at a superquadric", f"{worst:.1e} m", "<= 1e-9 m", worst <= 1e-9)
    mesh = ball.mesh(MESH_LEVEL)
    facets, bound = TriangleShape(*mesh), _sag(mesh.vertices[mesh.faces], 0.03)
    off = max(_error_of_facets(facets, 0.03, *ray) for ray in _rays(frames))
    yield Row(
        f"error of a cast at {len(mesh.faces) // 1000}k facets of a ball",
        f"{1e6 * off:.2f} um",
        f"<= {1e6 * bound:.2f} um, their sag",
        off <= bound + 1e-8,  # Embree works in single precision
    )


def _solid() -> Superquadric:
    return Superquadric(np.array(SIZE), np.array(EXPONENTS))


def _error_of_cast(shape: Superquadric, origins: Floats, direction: Floats) -> float:
    """Largest error of a cast, against bisection in extended precision, m."""
    ranges = shape.cast(origins, direction, 1.0)
    hit = np.isfinite(ranges)
    start, along = origins[hit].astype(np.longdouble), direction.astype(np.longdouble)
    middle = ranges[hit].astype(np.longdouble)
    near, far = middle - 1e-7, middle + 1e-7
    # A ray that grazes may have left again 0.1 um farther on: those are left out.
    kept = (_outside(shape, start, along, near) > 0) & (_outside(shape, start, along, far) < 0)
    start, near, far = start[kept], near[kept], far[kept]
    for _ in range(60):
        half = 0.5 * (near + far)
        outside = _outside(shape, start, along, half) > 0
        near, far = np.where(outside, half, near), np.where(outside, far, half)
    return float(np.abs(near - middle[kept]).max(initial=0.0))


def _outside(shape: Superquadric, start: Any, along: Any, way: Any) -> Any:
    """The inside-outside function less 1, (2.6) without its outer power."""
    e1, e2 = (np.longdouble(e) for e in shape.exponents)
    x, y, z = (np.abs(start + way[:, None] * along) / shape.size.astype(np.longdouble)).T
    return (x ** (2 / e2) + y ** (2 / e2)) ** (e2 / e1) + z ** (2 / e1) - 1


def _rays(count: int) -> Iterable[tuple[Floats, Floats]]:
    """Origins of the rays of a pad at many places, and their direction."""
    axis = (np.arange(16) - 7.5) * 1e-3
    x, y = (side.ravel() for side in np.meshgrid(axis, axis))
    for goal in _goals(count):
        axes = pad_rotation(0.1 * goal.touch, 0.4 * np.sin(goal.touch))
        face = np.column_stack([x, y, np.zeros_like(x)])
        yield face @ axes.T + goal.pose[:3], axes[:, 2]


def _goals(count: int) -> Iterable[TouchGoal]:
    for number in range(count):
        axes = pad_rotation(0.1 * number, 0.4 * np.sin(number))
        yield TouchGoal(
            goal=0,
            touch=number,
            finger=1,
            pose=pose_of(axes @ np.array([0.0, 0.0, -0.08]), axes),
            reach=0.1,
            depth=1e-3,
            direction=np.array([0.0, 0.0, 1.0]),
            not_before=0.0,
        )


def _sag(corners: Floats, radius: float) -> float:
    """How far the deepest facet's middle lies under the ball, m."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    height = np.abs(np.einsum("ni,ni->n", normal, corners[:, 0]))
    return float(radius - height.min())


def _error_of_facets(
    shape: TriangleShape, radius: float, origins: Floats, direction: Floats
) -> float:
    """Largest distance of hits on a faceted ball to the ball, m."""
    ranges = shape.cast(origins, direction, 1.0)
    hit = np.isfinite(ranges)
    points = origins[hit] + ranges[hit, None] * direction
    return float((radius - np.linalg.norm(points, axis=1)).max(initial=0.0))


def estimator_summary(trials: int) -> Iterable[Row]:
    """Cost of a plain jet, and errors of the curvatures: the whole is ``bench curvature``."""
    yield _at_most("plain jet of a full pad", _jet_seconds(), 10)
    rows = {row.name: row for row in estimator_rows(trials)}
    ours, thesis = rows[OURS].errors, rows[THESIS].errors
    for column, most in MOST_ERROR.items():
        noise, impulses = COLUMNS[column]
        name = f"error of curvatures, noise {noise:g}, impulses {impulses:.0%}"
        error = ours[column]
        yield Row(name, f"{1e3 * error:.2f}e-3", f"<= {1e3 * most:.1f}e-3 /pitch", error <= most)
    gain = min(theirs / mine for theirs, mine in zip(thesis, ours, strict=True))
    yield Row("error of the thesis's chain to ours, at least", f"{gain:.0f}", ">= 20", gain >= 20)
    worst = max(row.errors["palpate"] or np.inf for row in partial_rows(trials) if row.taxels >= 32)
    yield Row("the same, 32 taxels or more touched", f"{worst:.1%}", "< 5 %", worst < MOST_PARTIAL)


def _at_most(name: str, seconds: float, most: float) -> Row:
    return Row(name, f"{1e6 * seconds:.0f} us", f"<= {most:.0f} us", 1e6 * seconds <= most)


def _jet_seconds() -> float:
    pad = pad_of_spec(SensorSpec(pad=PadSpec(radius=None)))
    x, y = pad.grid()
    height, everywhere = (x * x + y * y) / 0.04, np.ones((pad.rows, pad.cols), bool)
    return min(timeit.repeat(lambda: fit_jet(pad, height, everywhere), number=500, repeat=9)) / 500


class TouchChain:
    """Simulator, filter and curvature as plain calls, one touch after the other."""

    def __init__(self, params: simulator.Params):
        self._params = params
        self._state, said = simulator.start(params)
        info = _only(said, SensorInfo)
        self._filter, _ = filter.calibrate(filter.Params(), None, info)
        self._sensor, _ = curvature.know_sensor(curvature.Params(), None, info)

    def simulate(self, goal: TouchGoal) -> TactileFrame:
        """One raw frame."""
        self._state, said = simulator.touch(self._params, self._state, goal)
        return _only(said, TactileFrame)

    def feel(self, goal: TouchGoal) -> SurfacePatch:
        """One raw frame, and what is made of it."""
        frame = self.simulate(goal)
        _, said = filter.take_frame(filter.Params(), self._filter, frame)
        assert self._sensor is not None
        _, said = curvature.on_image(curvature.Params(), self._sensor, _only(said, TactileImage))
        return _only(said, SurfacePatch)


def _only(said: Outputs, kind: type[Message]) -> Message:
    """The one message of a kind among what a node said."""
    (message,) = (out[1] for out in said if isinstance(out, tuple) and isinstance(out[1], kind))
    return message


class TracedBody(NamedTuple):
    """Something whose contour is traced."""

    size: tuple[float, float, float]  # Semi-axes, m
    exponents: tuple[float, float]  # e1 and e2


class FrameCost(NamedTuple):
    """Time of a frame."""

    ideal: float  # Without effects, s
    added: float  # What the effects add, s
    ratio: float  # Of the frame with effects to that without


class TracedContour(NamedTuple):
    """A contour, against the truth."""

    status: str  # How tracing ended
    touches: int  # Touches made
    rms: float  # Root mean square distance of its points to the surface, m
    worst: float  # Largest distance, m


def bench_effects(*, quick: bool, echo: Echo = print) -> int:
    """Print the cost of each effect and the error that it causes.

    Parameters
    ----------
    quick : bool
        Fewer frames.
    echo : callable
        Takes one line.

    Returns
    -------
    int
        0 if every contour was closed, else 1.
    """
    frames, repeats = (EFFECT_FRAMES // 2, 3) if quick else (EFFECT_FRAMES, EFFECT_REPEATS)
    sets: dict[str, EffectSpecs] = {"(ideal)": {}, **{name: {name: {}} for name in EFFECT_NAMES}}
    sets[WORN] = load_scene(WORN).spec.effects
    costs = frame_costs(sets, frames, repeats)
    echo(_HEAD)
    closed = True
    for name, effects in sets.items():
        cost = costs[name]
        traced = [trace_contour(body, effects) for body in BODIES.values()]
        closed = closed and all(one.status == "closed" for one in traced)
        cells = "".join(_cells(one) for one in traced)
        echo(f"{name:<16}{1e6 * cost.added:>9.1f}{cost.ratio:>8.2f}{cells}".rstrip())
    ideal = statistics.median(cost.ideal for cost in costs.values())
    echo(f"the ideal frame takes {1e6 * ideal:.0f} us: a superquadric, {_taxels()} rays")
    return 0 if closed else 1


def frame_costs(sets: Mapping[str, EffectSpecs], frames: int, repeats: int) -> dict[str, FrameCost]:
    """What each set of effects adds to an ideal frame.

    Each is timed in pairs with the ideal frame, by turns: machines change their speed. The
    medians over the pairs are given.
    """
    ideal = _pipeline({})
    pipelines = {name: _pipeline(effects) for name, effects in sets.items()}
    pairs: dict[str, list[tuple[float, float]]] = {name: [] for name in sets}
    for _ in range(repeats):
        for name, pipeline in pipelines.items():
            pairs[name].append((_time(ideal, frames), _time(pipeline, frames)))
    return {
        name: FrameCost(
            ideal=statistics.median(bare for bare, _ in found),
            added=statistics.median(full - bare for bare, full in found),
            ratio=statistics.median(full / bare for bare, full in found),
        )
        for name, found in pairs.items()
    }


def _pipeline(effects: EffectSpecs) -> Pipeline:
    return build_pipeline(SensorSpec(), effects, ROBOT_PRESETS["modern"], seed=SEED)


def _time(pipeline: Pipeline, frames: int) -> float:
    """Seconds of one frame, of so many at different places of a ball."""
    shape = Superquadric(np.array([0.03, 0.025, 0.04]), np.array([0.7, 0.9]))
    starts = [
        pose_of(axes @ np.array([0.0, 0.0, -0.08]), axes)
        for axes in (pad_rotation(0.1 * i, 0.4 * np.sin(i)) for i in range(frames))
    ]
    states, clock = pipeline.begin(), 0.0
    began = time.perf_counter()
    for number, start in enumerate(starts):
        touch = SimulatedTouch(shape, number, start, start, 0.1, 1e-3, clock, clock)
        states = pipeline.simulate(touch, states)
        clock = touch.time
    return (time.perf_counter() - began) / frames


def trace_contour(body: TracedBody, effects: EffectSpecs, height: float = 0.0) -> TracedContour:
    """Trace one contour at a height over the body's middle, m."""
    spec = ObjectSpec(
        superquadric=SuperquadricSpec(size=body.size, exponents=body.exponents),
        pose=PoseSpec(position=(0.0, 0.0, body.size[2])),
    )
    loop = InProcessLoop(simulator_node.Params(object=spec, effects=effects, seed=SEED))
    contour = loop.trace(height + body.size[2], radius=max(body.size[:2]))
    distance = np.abs(_distance(body, contour.points - np.array([0.0, 0.0, body.size[2]])))
    if not len(distance):
        return TracedContour(contour.status, contour.touches, np.nan, np.nan)
    rms = float(np.sqrt(np.mean(distance**2)))
    return TracedContour(contour.status, contour.touches, rms, float(distance.max()))


def _distance(body: TracedBody, points: Floats) -> Floats:
    """Distance of points near the surface, to first order along the gauge's gradient, m."""
    shape = Superquadric(np.array(body.size), np.array(body.exponents))
    gauge = shape.gauge(points)
    step = 1e-6 * max(body.size)
    gradient = np.stack(
        [(shape.gauge(points + step * e) - gauge) / step for e in np.eye(3)], axis=-1
    )
    result: Floats = (gauge - 1.0) / np.linalg.norm(gradient, axis=-1)
    return result


def _cells(traced: TracedContour) -> str:
    status = "" if traced.status == "closed" else traced.status
    return f"{1e6 * traced.rms:>11.1f}{1e6 * traced.worst:>8.0f}{traced.touches:>8}  {status:<6}"


def _taxels() -> int:
    sensor = SensorSpec()
    return sensor.rows * sensor.cols


BODIES: Mapping[str, TracedBody] = {
    "ball": TracedBody((0.03, 0.03, 0.03), (1.0, 1.0)),
    "box": TracedBody((0.03, 0.02, 0.04), (0.1, 0.1)),
}
_HEAD = (
    f"{'effect':<16}{'us/frame':>9}{'ratio':>8}"
    + "".join(f"{name + ' um':>11}{'worst':>8}{'touches':>8}  {'':<6}" for name in BODIES)
).rstrip()
