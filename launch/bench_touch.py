"""One touch, measured: frames a second, what a frame costs, and how exact a cast is."""

from __future__ import annotations

import statistics
import time
import timeit
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.frames import pad_rotation, pose_of
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.triangles import TriangleShape
from palpate.core.touch.jet_fit import fit_jet
from palpate.launch.bench_curvature import (
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
from palpate.launch.bench_row import Row
from palpate.launch.scene import load_scene
from palpate.messages.types import SensorInfo, SurfacePatch, TactileFrame, TactileImage, TouchGoal
from palpate.nodes import curvature, filter, simulator
from palpate.nodes.node import Outputs
from palpate.nodes.object import ObjectSpec, SuperquadricSpec, encode_mesh
from palpate.nodes.sensor import PadSpec, SensorSpec, pad_of_spec

WORN = "worn_sensor"
"""The scene with all the faults of 1999."""
SIZE, EXPONENTS = (0.03, 0.025, 0.04), (0.7, 0.9)
MESH_LEVEL = 5
"""20k faces."""
FRAMES, ROUNDS = 40, 31

Echo = Callable[[str], None]
Message = TypeVar("Message")


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
        *curvature_rows(QUICK_TRIALS if quick else TRIALS),
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
        "ideal": Chain(simulator.Params(object=exact)),
        "mesh": Chain(simulator.Params(object=mesh)),
        "worn": Chain(simulator.Params(object=exact, effects=worn)),
        "quiet": Chain(simulator.Params(object=exact, effects=quiet)),
        "salty": Chain(
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


def curvature_rows(trials: int) -> Iterable[Row]:
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


def _jet_seconds() -> float:
    pad = pad_of_spec(SensorSpec(pad=PadSpec(radius=None)))
    x, y = pad.grid()
    height, everywhere = (x * x + y * y) / 0.04, np.ones((pad.rows, pad.cols), bool)
    return min(timeit.repeat(lambda: fit_jet(pad, height, everywhere), number=500, repeat=9)) / 500


class Chain:
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
        _, said = curvature.feel(curvature.Params(), self._sensor, _only(said, TactileImage))
        return _only(said, SurfacePatch)


def _only(said: Outputs, kind: type[Message]) -> Message:
    """The one message of a kind among what a node said."""
    (message,) = (out[1] for out in said if isinstance(out, tuple) and isinstance(out[1], kind))
    return message


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


def _rays(count: int) -> Iterable[tuple[Floats, Floats]]:
    """Origins of the rays of a pad at many places, and their direction."""
    axis = (np.arange(16) - 7.5) * 1e-3
    x, y = (side.ravel() for side in np.meshgrid(axis, axis))
    for goal in _goals(count):
        axes = pad_rotation(0.1 * goal.touch, 0.4 * np.sin(goal.touch))
        face = np.column_stack([x, y, np.zeros_like(x)])
        yield face @ axes.T + goal.pose[:3], axes[:, 2]


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


def _error_of_facets(
    shape: TriangleShape, radius: float, origins: Floats, direction: Floats
) -> float:
    """Largest distance of hits on a faceted ball to the ball, m."""
    ranges = shape.cast(origins, direction, 1.0)
    hit = np.isfinite(ranges)
    points = origins[hit] + ranges[hit, None] * direction
    return float((radius - np.linalg.norm(points, axis=1)).max(initial=0.0))


def _sag(corners: Floats, radius: float) -> float:
    """How far the deepest facet's middle lies under the ball, m."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    height = np.abs(np.einsum("ni,ni->n", normal, corners[:, 0]))
    return float(radius - height.min())


def _solid() -> Superquadric:
    return Superquadric(np.array(SIZE), np.array(EXPONENTS))


def _seconds(feel: Callable[[TouchGoal], object], goals: list[TouchGoal]) -> float:
    began = time.perf_counter()
    for goal in goals:
        feel(goal)
    return (time.perf_counter() - began) / len(goals)


def _at_least(name: str, rate: float, least: float) -> Row:
    return Row(name, f"{rate:.0f} /s", f">= {least:.0f} /s", rate >= least)


def _at_most(name: str, seconds: float, most: float) -> Row:
    return Row(name, f"{1e6 * seconds:.0f} us", f"<= {most:.0f} us", 1e6 * seconds <= most)
