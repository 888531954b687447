"""What effects cost and do to contours, measured in turns within one run."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
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

WORN = "worn_sensor"  # The scene with all the faults of 1999
SIZE, EXPONENTS = (0.03, 0.025, 0.04), (0.7, 0.9)
EFFECT_FRAMES = 40  # Touches on which a cost is measured at a time
EFFECT_REPEATS = 15
SEED = 5
APPROACH = 0.02  # The finger comes from this far outside of the object, m


def touch_goals(count: int) -> Iterable[TouchGoal]:
    """Touches of an object about the origin from many sides."""
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
    """A contour, against the truth."""

    status: str  # How tracing ended
    touches: int
    rms: float  # Root mean square distance of its points to the surface, m
    worst: float  # Largest distance, m


def effect_rows(quick: bool) -> Iterator[Row | str]:
    """The cost of each effect and the error that it causes; fewer frames if quick."""
    frames, repeats = (EFFECT_FRAMES // 2, 3) if quick else (EFFECT_FRAMES, EFFECT_REPEATS)
    sets: dict[str, EffectSpecs] = {
        "(ideal)": {},
        **{name: {name: {}} for name in EFFECT_NAMES},
    }
    sets[WORN] = load_scene(WORN).spec.effects
    costs = frame_costs(sets, frames, repeats)
    heads = "".join(f"{name + ' um':>11}{'worst':>8}{'touches':>8}  {'':<6}" for name in BODIES)
    yield f"{'effect':<16}{'us/frame':>9}{'ratio':>8}{heads}".rstrip()
    for name, effects in sets.items():
        yield _effect_row(name, *costs[name][1:], [trace_contour(body, effects) for body in BODIES])
    ideal, sensor = statistics.median(bare for bare, _, _ in costs.values()), SensorSpec()
    rays = sensor.rows * sensor.cols
    yield f"the ideal frame takes {1e6 * ideal:.0f} us: a superquadric, {rays} rays"


def _effect_row(name: str, added: float, ratio: float, traced: Sequence[TracedContour]) -> Row:
    """What a set of effects adds to a frame, s, the ratio of both times, and its contours."""
    cells = "".join(
        f"{1e6 * one.rms:>11.1f}{1e6 * one.worst:>8.0f}{one.touches:>8}  "
        f"{'' if one.status == 'closed' else one.status:<6}"
        for one in traced
    )
    text = f"{name:<16}{1e6 * added:>9.1f}{ratio:>8.2f}{cells}".rstrip()
    figures = [figure_of(1e6 * added, "us", name="added")]
    figures += [figure_of(ratio, "x", kind="time", name="ratio")]
    figures += [figure_of(1e6 * one.rms, "um", name="rms") for one in traced]
    figures += [figure_of(one.touches, name="touches") for one in traced]
    closed = all(one.status == "closed" for one in traced)
    return Row(name, text, "", closed, tuple(figures), text)


def frame_costs(
    sets: Mapping[str, EffectSpecs], frames: int, repeats: int
) -> dict[str, tuple[float, float, float]]:
    """Time of an ideal frame, what each set of effects adds, s, and the ratio of both times.

    Medians over pairs measured in turns.
    """
    ideal = _pipeline({})

    def pair(pipeline: touch.Pipeline) -> tuple[float, float, float]:
        bare, full = _time(ideal, frames), _time(pipeline, frames)
        return bare, full - bare, full / bare

    calls = {name: partial(pair, _pipeline(effects)) for name, effects in sets.items()}
    return {
        name: (statistics.median(bare), statistics.median(added), statistics.median(ratio))
        for name, found in in_turns(calls, repeats).items()
        for bare, added, ratio in [zip(*found, strict=True)]
    }


def _pipeline(effects: EffectSpecs) -> touch.Pipeline:
    return build_pipeline(SensorSpec(), effects, ROBOT_PRESETS["modern"], seed=SEED)


def _time(pipeline: touch.Pipeline, frames: int) -> float:
    """Seconds of one frame, of so many at different places of a ball."""
    shape = shapes.Superquadric(np.array(SIZE), np.array(EXPONENTS))
    starts = [Pose.from_array(goal.pose) for goal in touch_goals(frames)]
    states, clock = pipeline.begin(), 0.0
    began = time.perf_counter()
    for number, start in enumerate(starts):
        made = touch.SimulatedTouch(shape, number, start, start, 0.1, 1e-3, clock, clock)
        states = pipeline.simulate(made, states)
        clock = made.time
    return (time.perf_counter() - began) / frames


def trace_contour(body: str, effects: EffectSpecs) -> TracedContour:
    """Trace the contour at the middle of one of the `BODIES`."""
    size, exponents = BODIES[body]
    middle = np.array([0.0, 0.0, size[2]])
    spec = ObjectSpec(
        superquadric=SuperquadricSpec(size=size, exponents=exponents),
        pose=PoseSpec(position=(0.0, 0.0, size[2])),
    )
    params = simulator.Params(object=spec, effects=effects, seed=SEED)
    loop = InProcessLoop([*touching_nodes(params), LoopNode(1, tracer.NODE, tracer.Params())])
    goal = contour_goal(size[2], max(size[:2]) + APPROACH)
    contour: Contour = loop.publish("/contour/goal", goal)["/contour/traced"]
    if not len(contour.points):
        return TracedContour(contour.status, contour.touches, np.nan, np.nan)
    # Distance of points near the surface, to first order along the gauge's gradient.
    shape = shapes.Superquadric(np.array(size), np.array(exponents))
    points, step = contour.points - middle, 1e-6 * max(size)
    gauge = shape.gauge(points)
    slopes = [(shape.gauge(points + step * e) - gauge) / step for e in np.eye(3)]
    distance = np.abs((gauge - 1.0) / np.linalg.norm(np.stack(slopes, axis=-1), axis=-1))
    rms = float(np.sqrt(np.mean(distance**2)))
    return TracedContour(contour.status, contour.touches, rms, float(distance.max()))


# Semi-axes, m, and exponents of what is traced.
BODIES: Mapping[str, tuple[tuple[float, float, float], tuple[float, float]]] = {
    "ball": ((0.03, 0.03, 0.03), (1.0, 1.0)),
    "box": ((0.03, 0.02, 0.04), (0.1, 0.1)),
}
