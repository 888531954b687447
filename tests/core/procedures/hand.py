"""A simulated finger and hand for procedures, and the solids on which these are tested."""

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from palpate.core import procedures, shapes, touch
from palpate.core.arrays import Floats
from palpate.core.explore import spanned_places
from palpate.core.explore.grasp import Closing, close_hand
from palpate.core.poses import Pose, rotations_from_vectors
from palpate.core.robot_time import ROBOT_PRESETS
from palpate.nodes.specs.sensors import SensorSpec, build_pipeline

# Standard deviations: 0.1 mm of a position along each axis, 10 um of a taxel.
NOISES: dict[str, dict[str, Any]] = {
    "exact": {},
    "noise": {"pose_error": {"sigma": 1e-4}, "gaussian_noise": {"sigma": 1e-5}},
}
LEANING = np.array([1.0, 0.3, 0.0]) / np.hypot(1.0, 0.3)
FAR = Pose(np.array([1.0, 0.0, 0.046]), np.eye(3))  # out of reach


class Driven(NamedTuple):
    """Findings of a procedure, and the touches that it made."""

    findings: procedures.Findings
    touches: int


@cache
def drive(
    name: str, shape: shapes.Shape, noise: str = "exact", *, fingers: int = 1, seed: int = 0,
    **settings: Any,
) -> Driven:  # fmt: skip
    """Perform the moves of a procedure on a shape until it returns, none into the platform."""
    robot, effects = ROBOT_PRESETS["modern"], NOISES[noise]
    tips = [build_pipeline(SensorSpec(), effects, robot, n + 1, seed) for n in range(fingers)]
    palm = [build_pipeline(SensorSpec(), effects, robot, 1001 + n, seed) for n in range(6)]
    states, held = [tip.begin() for tip in tips], tuple(part.begin() for part in palm)
    platform = float(shape.bounds()[0, 2])
    setup = procedures.TouchSetup(tips[0].finger.pad, tips[0].noise, platform, 0.12, fingers)
    running, result, touches = procedures.procedure_of(name, settings)(setup), None, 0
    for closings in range(1500):
        try:
            move = next(running) if result is None else running.send(result)
        except StopIteration as end:
            return Driven(end.value, touches)
        if isinstance(move, procedures.HandMove):
            when = Closing(closings, 0.0, 0.0)
            grasp, held = close_hand(shape, palm, held, move.hand, move.pose, platform, when)
            result = procedures.HandContacts(
                grasp.points, grasp.normals, np.array(grasp.fingers, np.int32), 0.0
            )
            continue
        contacts = []
        for number, goal in enumerate(move):
            axis = goal.pose.axes[:, 2]
            assert goal.pose.position[2] + min(goal.reach * axis[2], 0.0) > platform - 1e-9
            assert goal.reach > 0.0
            states[number], contact = touched(tips[number], states[number], shape, goal, touches)
            contacts.append(contact)
            touches += 1
        result = tuple(contacts)
    raise AssertionError("no end after 1500 moves")


def touched(
    tip: touch.Pipeline, state: Any, shape: shapes.Shape, move: procedures.FingerMove, number: int
) -> tuple[Any, procedures.Contact]:
    """One touch, with the results of filter and curvature estimator."""
    times = {"begun": float(number), "previous": float(number) - 1.0}
    made = touch.SimulatedTouch(
        shape, number, move.pose, move.pose, move.reach, move.depth, **times
    )
    state = tip.simulate(made, state)
    pad, axes = tip.finger.pad, made.believed.axes
    image = touch.clean(pad, made.reading, tip.noise, touch.DEFAULT_CONTACT.min_compression, "auto")
    surface = pad.surface(image.compression, image.touched)
    patch = touch.fit_patch(pad, surface, image.touched, np.array([0.0, 1.0, 0.0]), tip.noise)
    nothing, met = np.zeros((0, 3)), made.outcome in touch.HITS
    return state, procedures.Contact(
        outcome=made.outcome,
        pose=made.believed,
        points=touch.surface_points(pad, made.believed, surface, image.touched, patch.jet).points
        if met
        else nothing,
        kind=patch.kind,
        normal=axes @ patch.normal,
        normal_error=patch.normal_error,
        curvatures=patch.principal,
        curvature_errors=patch.principal_error,
        direction=axes @ patch.principal_direction,
        hollow=spanned_places(pad, made.believed, image.touched) if met else nothing,
        robot_time=0.0,
    )


def rotation(degrees: float) -> Floats:
    """Rotation about an axis that leans from x."""
    return rotations_from_vectors(np.radians(degrees) * LEANING[None])[0]


def posed(shape: Any, z: float, degrees: float = 0.0) -> shapes.PosedShape:
    """A shape raised by z [m], and turned about an axis that leans from x."""
    return shapes.PosedShape(shape, Pose(np.array([0.0, 0.0, z]), rotation(degrees)))


def superquadric(size: Sequence[float], exponents: Sequence[float]) -> shapes.Superquadric:
    """A superquadric of these semi-axes [mm]."""
    return shapes.Superquadric(1e-3 * np.array(size), np.array(exponents, float))


def stacked(ring: Any, heights: Sequence[float], scales: Sequence[float]) -> shapes.Polyhedron:
    """A polygon (n, 2), counter-clockwise, scaled at each height and joined by quads [m]."""
    count, last = len(ring), (len(heights) - 1) * len(ring)
    levels = [
        np.column_stack([scale * np.array(ring), np.full(count, z)])
        for z, scale in zip(heights, scales, strict=True)
    ]
    around = [(i, (i + 1) % count) for i in range(count)]
    sides = [
        [k + i, k + j, k + count + j, k + count + i]
        for k in range(0, last, count)
        for i, j in around
    ]
    ends = [list(range(count))[::-1], [last + i for i in range(count)]]
    return shapes.Polyhedron(np.concatenate(levels), [*ends, *sides])


def block(x: float = 0.06, y: float = 0.044, z: float = 0.05) -> shapes.Polyhedron:
    """A box that stands on the platform, of these edges [m]."""
    ring = 0.5 * np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    return stacked(ring, (0.0, z), (1.0, 1.0))


def prism(count: int, radius: float, height: float, top: float = 1.0) -> shapes.Polyhedron:
    """An upright prism, or a cut pyramid whose top is narrower by the factor `top` [m]."""
    azimuths = 2.0 * np.pi * np.arange(count) / count + 0.3
    ring = radius * np.column_stack([np.cos(azimuths), np.sin(azimuths)])
    return stacked(ring, (0.0, height), (1.0, top))


def turned(
    sweep: Sequence[Sequence[float]], size: tuple[float, float] = (30, 30), smooth: bool = False
) -> shapes.GeneralisedCylinder:
    """An ellipse of semi-axes [mm] that is scaled along z: heights [mm] and scales."""
    heights, scales = np.array(sweep, float).T
    section = shapes.SuperellipseSection(1e-3 * np.array(size), 1.0)
    return shapes.GeneralisedCylinder(section, 1e-3 * heights, scales, smooth=smooth)


def without(outer: Any, inner: Any) -> shapes.BooleanShape:
    return shapes.BooleanShape(shapes.difference(outer, inner))


VASE = turned([[0, 0.7], [20, 1.05], [50, 0.8], [75, 0.55], [100, 0.8]], smooth=True)
CUP = without(turned([[0, 1], [70, 1]], (40, 40)), turned([[12, 1], [80, 1]]))
