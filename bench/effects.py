"""What each effect costs, and how large an error it causes in a contour."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from palpate.bench.loop import InProcessLoop, LoopNode, contour_goal, touching_nodes
from palpate.bench.table import Row, figure_of, in_turns
from palpate.core import shapes, touch
from palpate.core.poses import Pose, pad_rotation
from palpate.core.robot_time import ROBOT_PRESETS
from palpate.core.touch.effects import EFFECT_NAMES
from palpate.launch.scene import load_scene
from palpate.messages.types import Contour, TouchGoal
from palpate.nodes import simulator, tracer
from palpate.nodes.specs.objects import ObjectSpec, PoseSpec, SuperquadricSpec
from palpate.nodes.specs.sensors import EffectSpecs, SensorSpec, build_pipeline

WORN = "worn_sensor"  # The scene with all faults of the sensor of 1999


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectSettings:
    """On what the cost of effects is measured, and how contours are traced."""

    size: tuple[float, float, float] = (0.03, 0.025, 0.04)  # [m] semi-axes of the touched solid
    exponents: tuple[float, float] = (0.7, 0.9)  # of that superquadric
    n_frames: int = 40  # touches between two readings of the clock
    n_repeats: int = 15  # measurements of each frame, ideal and with effects in turns
    approach: float = 0.02  # [m] outside of the object, where tracing starts
    seed: int = 5


DEFAULT_EFFECTS = EffectSettings()
QUICK_EFFECTS = EffectSettings(n_frames=20, n_repeats=3)


def touch_goals(count: int) -> Iterable[TouchGoal]:
    """Touches of an object at the origin from many sides."""
    for number in range(count):
        axes = pad_rotation(0.1 * number, 0.4 * np.sin(number))
        yield TouchGoal(
            goal=0,
            touch=number,
            finger=1,
            pose=Pose(axes @ np.array([0.0, 0.0, -0.08]), axes).array,
            reach=0.1,
            depth=1e-3,
            direction=np.array([0.0, 0.0, 1.0]),
            not_before=0.0,
        )


class TracedContour(NamedTuple):
    """Errors of a traced contour."""

    status: str  # How tracing ended
    touches: int
    rms: float  # Root mean square distance of its points from the surface [m]
    worst: float  # Largest distance [m]


def effect_rows(quick: bool) -> Iterator[Row | str]:
    """The cost of each effect and the error that it causes; fewer frames if quick."""
    settings = QUICK_EFFECTS if quick else DEFAULT_EFFECTS
    sets: dict[str, EffectSpecs] = {
        "(ideal)": {},
        **{name: {name: {}} for name in EFFECT_NAMES},
    }
    sets[WORN] = load_scene(WORN).spec.effects
    costs = frame_costs(sets, settings)
    heads = "".join(f"{name + ' um':>11}{'worst':>8}{'touches':>8}  {'':<6}" for name in BODIES)
    yield f"{'effect':<16}{'us/frame':>9}{'ratio':>8}{heads}".rstrip()
    for name, effects in sets.items():
        traced = [trace_contour(body, effects, settings) for body in BODIES]
        yield _effect_row(name, *costs[name][1:], traced)
    ideal, sensor = statistics.median(bare for bare, _, _ in costs.values()), SensorSpec()
    rays = sensor.rows * sensor.cols
    yield f"the ideal frame takes {1e6 * ideal:.0f} us: a superquadric, {rays} rays"


def _effect_row(name: str, added: float, ratio: float, traced: Sequence[TracedContour]) -> Row:
    """Time [s] that effects add to a frame, the ratio of both times, and the contours."""
    cells = "".join(
        f"{1e6 * contour.rms:>11.1f}{1e6 * contour.worst:>8.0f}{contour.touches:>8}  "
        f"{'' if contour.status == 'closed' else contour.status:<6}"
        for contour in traced
    )
    text = f"{name:<16}{1e6 * added:>9.1f}{ratio:>8.2f}{cells}".rstrip()
    figures = [figure_of(1e6 * added, "us", name="added")]
    figures += [figure_of(ratio, "x", kind="time", name="ratio")]
    figures += [figure_of(1e6 * contour.rms, "um", name="rms") for contour in traced]
    figures += [figure_of(contour.touches, name="touches") for contour in traced]
    closed = all(contour.status == "closed" for contour in traced)
    return Row(name, text, "", closed, tuple(figures), text)


def frame_costs(
    sets: Mapping[str, EffectSpecs], settings: EffectSettings = DEFAULT_EFFECTS
) -> dict[str, tuple[float, float, float]]:
    """Time [s] of an ideal frame, time [s] that each set of effects adds, and the ratio of both.

    Medians over pairs measured in turns.
    """
    ideal = _pipeline({}, settings.seed)

    def measure_pair(pipeline: touch.Pipeline) -> tuple[float, float, float]:
        bare, full = _frame_time(ideal, settings), _frame_time(pipeline, settings)
        return bare, full - bare, full / bare

    calls = {
        name: partial(measure_pair, _pipeline(effects, settings.seed))
        for name, effects in sets.items()
    }
    return {
        name: (statistics.median(bare), statistics.median(added), statistics.median(ratio))
        for name, pairs in in_turns(calls, settings.n_repeats).items()
        for bare, added, ratio in [zip(*pairs, strict=True)]
    }


def _pipeline(effects: EffectSpecs, seed: int) -> touch.Pipeline:
    return build_pipeline(SensorSpec(), effects, ROBOT_PRESETS["modern"], seed=seed)


def _frame_time(pipeline: touch.Pipeline, settings: EffectSettings) -> float:
    """Mean time of a frame [s], over touches from many sides."""
    shape = shapes.Superquadric(np.array(settings.size), np.array(settings.exponents))
    starts = [Pose.from_array(goal.pose) for goal in touch_goals(settings.n_frames)]
    states, clock = pipeline.begin(), 0.0
    begin = time.perf_counter()
    for number, start in enumerate(starts):
        simulated = touch.SimulatedTouch(shape, number, start, start, 0.1, 1e-3, clock, clock)
        states = pipeline.simulate(simulated, states)
        clock = simulated.time
    return (time.perf_counter() - begin) / settings.n_frames


def trace_contour(
    body: str, effects: EffectSpecs, settings: EffectSettings = DEFAULT_EFFECTS
) -> TracedContour:
    """Trace the contour at half the height of one of the `BODIES`."""
    size, exponents = BODIES[body]
    centre = np.array([0.0, 0.0, size[2]])
    spec = ObjectSpec(
        superquadric=SuperquadricSpec(size=size, exponents=exponents),
        pose=PoseSpec(position=(0.0, 0.0, size[2])),
    )
    params = simulator.Params(object=spec, effects=effects, seed=settings.seed)
    loop = InProcessLoop([*touching_nodes(params), LoopNode(1, tracer.NODE, tracer.Params())])
    goal = contour_goal(size[2], max(size[:2]) + settings.approach)
    contour: Contour = loop.publish("/contour/goal", goal)["/contour/traced"]
    if not len(contour.points):
        return TracedContour(contour.status, contour.touches, np.nan, np.nan)
    # Distance of points near the surface, to first order along the gradient of the gauge.
    shape = shapes.Superquadric(np.array(size), np.array(exponents))
    points, step = contour.points - centre, 1e-6 * max(size)
    gauge = shape.gauge(points)
    slopes = [(shape.gauge(points + step * e) - gauge) / step for e in np.eye(3)]
    distance = np.abs((gauge - 1.0) / np.linalg.norm(np.stack(slopes, axis=-1), axis=-1))
    rms = float(np.sqrt(np.mean(distance**2)))
    return TracedContour(contour.status, contour.touches, rms, float(distance.max()))


# Semi-axes [m] and exponents of the solids whose contours are traced.
BODIES: Mapping[str, tuple[tuple[float, float, float], tuple[float, float]]] = {
    "ball": ((0.03, 0.03, 0.03), (1.0, 1.0)),
    "box": ((0.03, 0.02, 0.04), (0.1, 0.1)),
}
