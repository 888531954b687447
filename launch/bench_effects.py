"""What each effect costs, and what it does to a contour; all measured in one run."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.frames import pad_rotation, pose_of
from palpate.core.measure.robot_time import PRESETS
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.touch.effects.catalogue import NAMES
from palpate.core.touch.pipeline import Pipeline
from palpate.core.touch.touch import Touch
from palpate.launch.plain_calls import Loop
from palpate.launch.scene import load_scene
from palpate.nodes.effects import EffectSpecs, build_pipeline
from palpate.nodes.object import ObjectSpec, PoseSpec, SuperquadricSpec
from palpate.nodes.sensor import SensorSpec
from palpate.nodes.simulator import Params

WORN = "worn_sensor"
"""The scene whose effects are measured together."""
FRAMES = 40
"""Touches on which a cost is measured at a time."""
REPEATS = 15
SEED = 5

Echo = Callable[[str], None]


class Body(NamedTuple):
    """Something whose contour is traced."""

    size: tuple[float, float, float]
    """Semi-axes, m."""
    exponents: tuple[float, float]
    """e1 and e2."""


BODIES: Mapping[str, Body] = {
    "ball": Body((0.03, 0.03, 0.03), (1.0, 1.0)),
    "box": Body((0.03, 0.02, 0.04), (0.1, 0.1)),
}


class Cost(NamedTuple):
    """Time of a frame."""

    ideal: float
    """Without effects, s."""
    added: float
    """What the effects add, s."""
    ratio: float
    """Of the frame with effects to that without."""


class Traced(NamedTuple):
    """A contour, against the truth."""

    status: str
    """How tracing ended."""
    touches: int
    """Touches made."""
    rms: float
    """Root mean square distance of its points to the surface, m."""
    worst: float
    """Largest distance, m."""


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
    frames, repeats = (FRAMES // 2, 3) if quick else (FRAMES, REPEATS)
    sets: dict[str, EffectSpecs] = {"(ideal)": {}, **{name: {name: {}} for name in NAMES}}
    sets[WORN] = load_scene(WORN).spec.effects
    costs = frame_costs(sets, frames, repeats)
    echo(_HEAD)
    closed = True
    for name, effects in sets.items():
        cost = costs[name]
        traced = [trace(body, effects) for body in BODIES.values()]
        closed = closed and all(one.status == "closed" for one in traced)
        cells = "".join(_cells(one) for one in traced)
        echo(f"{name:<16}{1e6 * cost.added:>9.1f}{cost.ratio:>8.2f}{cells}".rstrip())
    ideal = statistics.median(cost.ideal for cost in costs.values())
    echo(f"the ideal frame takes {1e6 * ideal:.0f} us: a superquadric, {_taxels()} rays")
    return 0 if closed else 1


def frame_costs(sets: Mapping[str, EffectSpecs], frames: int, repeats: int) -> dict[str, Cost]:
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
        name: Cost(
            ideal=statistics.median(bare for bare, _ in found),
            added=statistics.median(full - bare for bare, full in found),
            ratio=statistics.median(full / bare for bare, full in found),
        )
        for name, found in pairs.items()
    }


def trace(body: Body, effects: EffectSpecs, height: float = 0.0) -> Traced:
    """Trace one contour at a height over the body's middle, m."""
    spec = ObjectSpec(
        superquadric=SuperquadricSpec(size=body.size, exponents=body.exponents),
        pose=PoseSpec(position=(0.0, 0.0, body.size[2])),
    )
    loop = Loop(Params(object=spec, effects=effects, seed=SEED))
    contour = loop.trace(height + body.size[2], radius=max(body.size[:2]))
    distance = np.abs(_distance(body, contour.points - np.array([0.0, 0.0, body.size[2]])))
    if not len(distance):
        return Traced(contour.status, contour.touches, np.nan, np.nan)
    rms = float(np.sqrt(np.mean(distance**2)))
    return Traced(contour.status, contour.touches, rms, float(distance.max()))


def _distance(body: Body, points: Floats) -> Floats:
    """Distance of points near the surface, to first order along the gauge's gradient, m."""
    shape = Superquadric(np.array(body.size), np.array(body.exponents))
    gauge = shape.gauge(points)
    step = 1e-6 * max(body.size)
    gradient = np.stack(
        [(shape.gauge(points + step * e) - gauge) / step for e in np.eye(3)], axis=-1
    )
    result: Floats = (gauge - 1.0) / np.linalg.norm(gradient, axis=-1)
    return result


def _pipeline(effects: EffectSpecs) -> Pipeline:
    return build_pipeline(SensorSpec(), effects, PRESETS["modern"], seed=SEED)


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
        touch = Touch(shape, number, start, start, 0.1, 1e-3, clock, clock)
        states = pipeline.feel(touch, states)
        clock = touch.time
    return (time.perf_counter() - began) / frames


def _taxels() -> int:
    sensor = SensorSpec()
    return sensor.rows * sensor.cols


_HEAD = (
    f"{'effect':<16}{'us/frame':>9}{'ratio':>8}"
    + "".join(f"{name + ' um':>11}{'worst':>8}{'touches':>8}  {'':<6}" for name in BODIES)
).rstrip()


def _cells(traced: Traced) -> str:
    status = "" if traced.status == "closed" else traced.status
    return f"{1e6 * traced.rms:>11.1f}{1e6 * traced.worst:>8.0f}{traced.touches:>8}  {status:<6}"
