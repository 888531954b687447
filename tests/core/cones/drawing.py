"""Cones with known features."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.core.arrays import Floats
from palpate.core.cones import Feature

ANGLE, POSITION = math.radians(1.0), 1e-4  # standard deviations of the noise [rad], [m]
CHORDS = 6
# Chords of the touches of each name, in turn: no touched line lies in a touched face.
ORDER = {"F_S": (0, 1, 2), "E_T": (3, 4), "E_B": (4, 5), "E_m": (5, 2), "P_m": (3, 4)}


@dataclass
class Cone:
    """An ellipse with six chords, drawn out to an apex and cut square to its axis."""

    rotation: Floats  # object axes as columns; the last points to the apex
    apex: Floats
    depths: tuple[float, float]  # [m] of top and bottom below the apex
    middle: Floats  # of the section at unit depth
    semi_axes: Floats
    turns: Floats  # [rad] of the chords' ends, (6, 2)

    @property
    def axis(self) -> Floats:
        return self.rotation[:, 2]

    @property
    def size(self) -> float:
        return self.depths[1]

    def ray(self, turn: float) -> Floats:
        """Vector of unit depth from the apex to the rim."""
        x, y = self.middle + self.semi_axes * [np.cos(turn), np.sin(turn)]
        return self.rotation @ [x, y, -1.0]

    def chord(self, index: int) -> tuple[Floats, Floats, Floats, Floats]:
        """Rays of both ends, direction, and outward normal of a flat side."""
        start, end = (self.ray(turn) for turn in self.turns[index % CHORDS])
        normal = np.cross(start, end)
        normal *= -np.sign(normal @ self.rotation @ [*self.middle, -1.0])
        along = end - start
        return start, end, along / np.linalg.norm(along), normal / np.linalg.norm(normal)

    def feature(self, name: str, index=0, share=0.4, place=True, normals=True) -> Feature:
        """A touch; `share`: its place along the edge or between the ends."""
        group, at = name.split("_")
        index = ORDER.get(name, (0, 2, 4))[index]
        top, bottom = self.depths
        depth = {"T": top, "B": bottom}.get(at, top + share * (bottom - top))
        known = {"place": at.upper()} if place else {}
        if group == "F":
            start, end, _, normal = self.chord(index)
            if at != "S":
                normal = self.axis if at == "T" else -self.axis
                end = self.rotation @ [*self.middle, -1.0]
            point = self.apex + depth * (start + share * (end - start))
            return Feature(group="F", point=point, normals=normal[None], **known)
        if group == "P":
            return self.parabolic(index, depth, known)
        if at == "m":
            ray = self.chord(index)[0]
            direction = ray / np.linalg.norm(ray)
            return Feature(group="E", point=self.apex + depth * ray, direction=direction, **known)
        start, end, along, side = self.chord(index)
        if group == "V":
            return Feature(group="V", point=self.apex + depth * end, **known)
        both = [self.axis if at == "T" else -self.axis, side] if normals else np.empty((0, 3))
        point = self.apex + depth * (start + share * (end - start))
        return Feature(group="E", point=point, direction=along, normals=both, **known)

    def parabolic(self, index: int, depth: float, known: dict) -> Feature:
        """In the middle of an arc between two chords."""
        before, after = self.turns[index % CHORDS, 1], self.turns[(index + 1) % CHORDS, 0]
        turn = before + 0.5 * np.mod(after - before, 2 * np.pi)
        ray = self.ray(turn)
        x, y = self.semi_axes * [-np.sin(turn), np.cos(turn)]
        normal = np.cross(ray, self.rotation @ [x, y, 0.0])
        normal *= -np.sign(normal @ self.rotation @ [*self.middle, -1.0])
        known |= {"direction": ray / np.linalg.norm(ray), "normals": normal[None]}
        known["normals"] /= np.linalg.norm(normal)
        curvature = 1.0 / (depth * self.semi_axes.min())
        return Feature(group="P", point=self.apex + depth * ray, curvature=curvature, **known)

    def features(self, names: Sequence[str], **options: bool) -> list[Feature]:
        """Different features with these names, anywhere on the cone."""
        numbered = [(name, names[:i].count(name), 0.3 + 0.15 * i) for i, name in enumerate(names)]
        return [self.feature(*one, **options) for one in numbered]


def draw_cone(rng: np.random.Generator, beside: float = 0.0) -> Cone:
    """A random cone; `beside`: distance of the section's middle from the axis."""
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation[:, 0] *= np.linalg.det(rotation)
    turns = np.arange(CHORDS)[:, None] * (2 * np.pi / CHORDS) + rng.uniform(0.1, 0.3)
    away = rng.uniform(0, 2 * np.pi)
    return Cone(
        rotation,
        rng.uniform(-0.2, 0.2, 3),
        (rng.uniform(0.03, 0.05), rng.uniform(0.08, 0.12)),
        (beside + rng.uniform(0.0, 0.1)) * np.array([np.cos(away), np.sin(away)]),
        rng.uniform(0.4, 0.7, 2),
        turns + [0.0, 0.6] + rng.uniform(-0.08, 0.08, (CHORDS, 2)),
    )


@cache
def cones(count: int = 8) -> list[Cone]:
    """Random cones of a fixed seed."""
    rng = np.random.default_rng(5)
    return [draw_cone(rng) for _ in range(count)]


def displaced(feature: Feature, turn: Floats, shift: Floats) -> Feature:
    """The feature after a rigid motion."""
    direction = None if feature.direction is None else turn @ feature.direction
    point, normals = turn @ feature.point + shift, feature.normals @ turn.T
    return replace(feature, point=point, direction=direction, normals=normals)


def moved(features: Sequence[Feature], turn: Floats, shift: Floats) -> list[Feature]:
    """The same features after a rigid motion."""
    return [displaced(feature, turn, shift) for feature in features]


def noisy(features: Sequence[Feature], rng: np.random.Generator) -> list[Feature]:
    """The same features, with errors of 1 degree in directions and 0.1 mm in points."""
    result = []
    for feature in features:
        point = feature.point + POSITION * rng.normal(size=3)
        turn = Rotation.from_rotvec(ANGLE * rng.normal(size=3)).as_matrix()
        other = displaced(feature, turn, np.zeros(3))
        normals = other.normals if feature.group == "F" else feature.normals
        result.append(replace(other, point=point, normals=normals))
    return result
