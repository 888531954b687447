"""A finger and a hand in this process, for procedures, and the solids that they are tried on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from palpate.core import IDENTITY_POSE, ROBOT_PRESETS, shapes, split_pose
from palpate.core.explore import spanned_places
from palpate.core.explore.grasp import Closing, close_hand
from palpate.core.procedures import (
    Contact,
    Findings,
    FingerMove,
    HandContacts,
    HandMove,
    Procedure,
    TouchSetting,
)
from palpate.core.touch import CONTACT, HITS, Pipeline, SimulatedTouch, clean, fit_patch
from palpate.nodes.specs import SensorSpec, build_pipeline

EXACT: Mapping[str, Any] = {}
# A place that is off by 0.1 mm along each axis, taxels by 10 um.
NOISY = {"pose_error": {"sigma": 1e-4}, "gaussian_noise": {"sigma": 1e-5}}
NOISES = {"exact": EXACT, "noise": NOISY}
MOST_MOVES = 1500
ACROSS = np.array([0.0, 1.0, 0.0])


class Driven(NamedTuple):
    """What a procedure came to."""

    findings: Findings
    touches: int


def drive(
    procedure: Procedure,
    shape: shapes.Shape,
    effects: Mapping[str, Any] = EXACT,
    *,
    fingers: int = 1,
    seed: int = 0,
    reach: float = 0.12,
    **settings: Any,
) -> Driven:
    """Perform the moves of a procedure on a shape until it returns."""
    robot = ROBOT_PRESETS["modern"]
    tips = [build_pipeline(SensorSpec(), effects, robot, n + 1, seed) for n in range(fingers)]
    palm = [build_pipeline(SensorSpec(), effects, robot, 1001 + n, seed) for n in range(6)]
    states = [tip.begin() for tip in tips]
    held = tuple(one.begin() for one in palm)
    platform = float(shape.bounds()[0, 2])
    setting = TouchSetting(tips[0].finger.pad, tips[0].noise, platform, reach, fingers)
    running, met, touches, closings = procedure(setting, **settings), None, 0, 0
    for _ in range(MOST_MOVES):
        try:
            move = next(running) if met is None else running.send(met)
        except StopIteration as end:
            return Driven(end.value, touches)
        if isinstance(move, HandMove):
            when = Closing(closings, 0.0, 0.0)
            grasp, held = close_hand(shape, palm, held, move.hand, move.pose, platform, when)
            met = HandContacts(grasp.points, grasp.normals, np.array(grasp.fingers, np.int32), 0.0)
            closings += 1
            continue
        contacts = []
        for number, one in enumerate(move):
            made = simulated(shape, one, touches)
            states[number] = tips[number].simulate(made, states[number])
            contacts.append(contact_of(tips[number], made))
            touches += 1
        met = tuple(contacts)
    raise AssertionError(f"no end after {MOST_MOVES} moves")


def simulated(shape: shapes.Shape, move: FingerMove, number: int) -> SimulatedTouch:
    """A touch that is about to be made."""
    return SimulatedTouch(
        shape=shape,
        number=number,
        believed=move.pose,
        actual=move.pose,
        reach=move.reach,
        depth=move.depth,
        begun=float(number),
        previous=float(number) - 1.0,
    )


def contact_of(tip: Pipeline, made: SimulatedTouch) -> Contact:
    """What filter and curvature estimator make of a touch."""
    pad, (position, axes) = tip.finger.pad, split_pose(made.believed)
    image = clean(pad, made.reading, tip.noise, CONTACT, "auto")
    surface = pad.surface(image.compression, image.touched)
    patch = fit_patch(pad, surface, image.touched, ACROSS, tip.noise)
    x, y = pad.grid()
    local = np.column_stack([x[image.touched], y[image.touched], surface[image.touched]])
    met = made.outcome in HITS
    return Contact(
        outcome=made.outcome,
        pose=made.believed,
        points=local @ axes.T + position if met else np.zeros((0, 3)),
        kind=patch.kind,
        normal=axes @ patch.normal,
        normal_error=patch.normal_error,
        curvatures=patch.principal,
        curvature_errors=patch.principal_error,
        direction=axes @ patch.principal_direction,
        hollow=spanned_places(pad, made.believed, image.touched) if met else np.zeros((0, 3)),
        robot_time=0.0,
    )


def posed(shape: shapes.ImplicitShape, z: float, turn: float = 0.0) -> shapes.PosedShape:
    """A shape raised by z, m, and turned about an axis that leans from x, rad."""
    axis = np.array([1.0, 0.3, 0.0]) / np.hypot(1.0, 0.3)
    rotation = [*(np.sin(0.5 * turn) * axis), np.cos(0.5 * turn)]
    return shapes.PosedShape(shape, np.array([*IDENTITY_POSE[:2], z, *rotation]))


def block(x: float = 0.06, y: float = 0.044, z: float = 0.05) -> shapes.Polyhedron:
    """A box that stands on the platform, of these edges, m."""
    corners = [[i * x / 2, j * y / 2, k * z] for i in (-1, 1) for j in (-1, 1) for k in (0, 1)]
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return shapes.Polyhedron(np.array(corners), faces)


def prism(count: int, radius: float, height: float, top: float = 1.0) -> shapes.Polyhedron:
    """An upright prism, or a cut pyramid whose top is narrower by the factor `top`, m."""
    azimuths = 2.0 * np.pi * np.arange(count) / count + 0.3
    ring = radius * np.column_stack([np.cos(azimuths), np.sin(azimuths)])
    low = np.column_stack([ring, np.zeros(count)])
    high = np.column_stack([top * ring, np.full(count, height)])
    sides = [[i, (i + 1) % count, count + (i + 1) % count, count + i] for i in range(count)]
    ends = [list(range(count))[::-1], [count + i for i in range(count)]]
    return shapes.Polyhedron(np.concatenate([low, high]), [*ends, *sides])


def wedge() -> shapes.Polyhedron:
    """A wedge that runs out on the platform."""
    corners = [
        [-35, -25, 0],
        [35, -25, 0],
        [35, 25, 0],
        [-35, 25, 0],
        [-35, -25, 50],
        [-35, 25, 50],
    ]
    faces = [[3, 2, 1, 0], [0, 1, 4], [2, 3, 5], [1, 2, 5, 4], [3, 0, 4, 5]]
    return shapes.Polyhedron(1e-3 * np.array(corners, float), faces)


def turned(
    sweep: list[list[float]], size: tuple[float, float] = (0.03, 0.03), *, smooth: bool = False
) -> shapes.GeneralisedCylinder:
    """An ellipse that is scaled along z: heights, m, and scales."""
    heights, scales = np.array(sweep).T
    section = shapes.SuperellipseSection(np.array(size), 1.0)
    return shapes.GeneralisedCylinder(section, heights, scales, smooth=smooth)


def cup() -> shapes.BooleanShape:
    """A cup of 70 mm with a cavity of 60 by 58 mm."""
    outer = turned([[0.0, 1.0], [0.07, 1.0]], (0.04, 0.04))
    inner = turned([[0.012, 1.0], [0.08, 1.0]], (0.03, 0.03))
    return shapes.BooleanShape(shapes.difference(outer, inner))


VASE = [[0.0, 0.7], [0.02, 1.05], [0.05, 0.8], [0.075, 0.55], [0.1, 0.8]]
