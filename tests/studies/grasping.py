"""The grasp, counted: how well a few contacts tell where an object is and how it is turned."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.bench.table import Row, at_least
from palpate.core import ROBOT_PRESETS, Floats, contact_seconds, free_seconds, pose_of, split_pose
from palpate.core.explore.grasp import (
    Closing,
    Hand,
    MassProperties,
    ObjectFrame,
    close_hand,
    fit_object_frame,
    mass_properties,
    next_pose,
    search_places,
    search_pose,
)
from palpate.core.rebuild import fit_coarse
from palpate.core.shapes import PosedShape, Shape
from palpate.nodes.specs import SensorSpec, build_pipeline
from tests.studies.objects import GRASPED_OBJECTS

TRIALS, QUICK_TRIALS = 8, 1
COUNTS = (30, 60, 100)
CONTACT_NOISE = 0.1e-3  # Standard deviation of a contact, m
TILT, SHIFT = math.radians(25.0), 0.03
REACH, SPACING = 0.15, 0.04
MOST_CLOSINGS = 60
RIGHT = 3.0  # deg
LEAST_RIGHT = 0.95
ROUND_THINGS = ("ball", "cube")  # Objects without an axis


class GraspTrial(NamedTuple):
    """An object that was grasped."""

    name: str
    vertices: Floats  # Of its surface in the world, m
    body: MassProperties  # What it is in truth
    points: Floats
    normals: Floats
    closings: int
    seconds: float  # Robot time, modern preset, s


class GraspOutcome(NamedTuple):
    """How right a frame is."""

    ambiguous: bool
    axis: float  # deg; 0 if it is ambiguous
    centre: float  # Distance of the true centroid from the axis, m
    extent: float  # Larger error of the two ends, m
    told: bool  # Whether that is within two of the standard deviations that are claimed
    right: bool  # Whether the axis is right, or there is none and that is told


def grasp(name: str, turn: Floats, azimuth: float, sigma: float, seed: int) -> GraspTrial:
    """Grasp an object that stands turned and off the middle, with an arm of this pose error."""
    base = GRASPED_OBJECTS[name]()
    vertices, faces = base.mesh(5)
    vertices = vertices @ turn.T
    place = np.array([SHIFT * math.cos(azimuth), SHIFT * math.sin(azimuth), -vertices[:, 2].min()])
    shape = PosedShape(base, pose_of(place, turn))
    vertices = vertices + place
    body = mass_properties(vertices, faces)
    return GraspTrial(name, vertices, body, *_contacts(shape, sigma, seed))


def _contacts(shape: Shape, sigma: float, seed: int) -> tuple[Floats, Floats, int, float]:
    hand, robot = Hand(), ROBOT_PRESETS["modern"]
    effects = {"pose_error": {"sigma": sigma}} if sigma else {}
    fingers = [
        build_pipeline(SensorSpec(), effects, robot, finger=100 + i, seed=seed)
        for i in range(hand.fingers + 1)
    ]
    states: tuple[Any, ...] = tuple(one.begin() for one in fingers)
    places = search_places(REACH, SPACING)
    points, normals = np.zeros((0, 3)), np.zeros((0, 3))
    closings, seconds, before = 0, 0.0, None
    while len(points) < max(COUNTS) and closings < MOST_CLOSINGS:
        if len(points):
            pose: Floats | None = next_pose(hand, points, normals, 0.0)
        else:
            pose = search_pose(places, closings, 0.0)
        if pose is None:
            break
        closing = Closing(closings, 0.0, 0.0)
        found, states = close_hand(shape, fingers, states, hand, pose, 0.0, closing)
        way = 0.0 if before is None else float(np.linalg.norm(pose[:3] - before[:3]))
        seconds += free_seconds(robot, way, 0.0) + contact_seconds(robot, found.advance)
        points, normals = np.vstack([points, found.points]), np.vstack([normals, found.normals])
        closings, before = closings + 1, pose
    return points, normals, closings, seconds


def judge_frame(trial: GraspTrial, count: int) -> GraspOutcome:
    """What the first contacts tell of an object, against the truth."""
    points, normals = trial.points[:count], trial.normals[:count]
    found = fit_object_frame(fit_coarse(points, CONTACT_NOISE), points, normals, 0.0, CONTACT_NOISE)
    origin, axes = split_pose(found.pose)
    axis = axes[:, 2]
    true = _true_axis(trial.body, found)
    across = float(np.linalg.norm(np.cross(axis, true)))
    degrees = math.degrees(math.atan2(across, abs(float(axis @ true))))
    off = 0.0 if found.ambiguous else degrees
    along = (trial.vertices - origin) @ axis
    extent = max(abs(found.low - float(along.min())), abs(found.high - float(along.max())))
    away = float(np.linalg.norm(np.cross(trial.body.centroid - origin, axis)))
    right = found.ambiguous if trial.name in ROUND_THINGS else found.ambiguous or off <= RIGHT
    told = extent <= 2.0 * found.extent_error + CONTACT_NOISE
    return GraspOutcome(found.ambiguous, off, away, extent, told, right)


def _true_axis(body: MassProperties, found: ObjectFrame) -> Floats:
    """The principal axis that a frame claims to have found."""
    lower, upper = np.diff(np.log(body.spread))
    longest = found.axis == "longest" or (found.axis != "shortest" and upper >= lower)
    return np.asarray(body.axes[:, 2 if longest else 0])


def _turn(rng: np.random.Generator, tilted: bool) -> Floats:
    """Any turn, or a lean by 25 degrees to any side."""
    if tilted:
        first, second = rng.uniform(0.0, 2.0 * math.pi, 2)
        return Rotation.from_euler("ZXZ", [first, TILT, second]).as_matrix()
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn[:, 0] *= np.linalg.det(turn)
    return np.asarray(turn)


def grasp_trials(sigma: float, tilted: bool, repeats: int) -> list[GraspTrial]:
    """All objects, each as often, always the same ones."""
    made = []
    for (number, name), repeat in product(enumerate(GRASPED_OBJECTS), range(repeats)):
        rng = np.random.default_rng([number, repeat, int(tilted)])
        turn = _turn(rng, tilted)
        made.append(grasp(name, turn, rng.uniform(0.0, 2.0 * math.pi), sigma, repeat))
    return made


def grasp_rows(quick: bool) -> Iterable[Row]:
    """Figures of the grasp, one at a time; fewer poses of each object if quick."""
    repeats = QUICK_TRIALS if quick else TRIALS
    for tilted, how in ((False, "any turn"), (True, "tilted 25 deg")):
        for sigma, noise in ((0.0, "exact"), (CONTACT_NOISE, "0.1 mm")):
            done = grasp_trials(sigma, tilted, repeats)
            for count in COUNTS:
                yield from _rows(f"grasp, {how}, {noise}, {count}", done, count)
    closings = statistics.median(one.closings for one in done)
    cost = statistics.median(one.seconds / len(one.points) for one in done)
    yield Row(f"grasp, closings for {max(COUNTS)} contacts", f"{closings:.0f}")
    yield Row("grasp, robot time of a contact, modern", f"{cost:.2f} s")


def _rows(name: str, done: list[GraspTrial], count: int) -> Iterator[Row]:
    found = [judge_frame(trial, count) for trial in done]
    share = statistics.mean(one.right for one in found)
    yield at_least(f"{name}: right or ambiguous", 100 * share, 100 * LEAST_RIGHT, ".1f", " %")
    pairs = zip(found, done, strict=True)
    lost = statistics.mean(one.ambiguous for one, trial in pairs if trial.name not in ROUND_THINGS)
    yield Row(f"{name}: ambiguous", f"{100 * lost:.1f} %")
    for what, unit, scale in (("axis", "deg", 1.0), ("centre", "mm", 1e3), ("extent", "mm", 1e3)):
        errors = [scale * getattr(one, what) for one in found if not one.ambiguous]
        middle, most = np.quantile(errors, [0.5, 0.95])
        yield Row(f"{name}: {what}, median and 95 %", f"{middle:.2f}, {most:.2f} {unit}")
    told = statistics.mean(one.told for one in found)
    yield Row(f"{name}: extent within 2 deviations", f"{100 * told:.1f} %")
