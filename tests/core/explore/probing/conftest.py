"""A finger that probes known solids, and contours that are known without tracing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.felt import deepest_point
from palpate.core.explore.probing.known import Done, End, EndKnown, Probed, Probing, Wall
from palpate.core.explore.probing.rule import next_probe
from palpate.core.frames import split_pose, transform
from palpate.core.shapes.protocol import Shape
from palpate.core.touch.curvature import feel_patch
from palpate.core.touch.pad import Pad, press

PAD = Pad(16, 16, 1e-3, 3e-3, 1.0 / 0.015, 0.8)
CONTACT = 0.05e-3
Explored = tuple[Done, tuple[Probed, ...]]


@pytest.fixture(scope="session")
def touch() -> Callable[[Shape, Probing], Probed]:
    """Make a touch of a solid."""
    return _touch


@pytest.fixture(scope="session")
def probed() -> Callable[[Shape, End, EndKnown], Explored]:
    """Touch an end of a solid as the rule says, to its end."""

    def run(shape: Shape, end: End, known: EndKnown) -> Explored:
        while isinstance(found := next_probe(end, known), Probing):
            known = replace(known, probes=(*known.probes, _touch(shape, found)))
            assert len(known.probes) <= 45
        return found, known.probes

    return run


@pytest.fixture(scope="session")
def ring() -> Callable[..., Wall]:
    """A round contour of a wall that leans, whose touches felt so far below and above it."""

    def make(
        radius: float, height: float, *, lean: float = 0.0, below: float = 7e-3, above: float = 0.0
    ) -> Wall:
        turn = 2.0 * np.pi * np.arange(60) / 60
        out = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        level = np.full(60, height)
        normals = np.column_stack([np.cos(lean) * out, np.full(60, np.sin(lean))])
        return Wall(np.column_stack([radius * out, level]), normals, level - below, level + above)

    return make


@pytest.fixture(scope="session")
def known() -> EndKnown:
    """An upper end at 40 mm of an object of 80 mm, found by nobody yet."""
    return EndKnown(
        height=0.04, deviation=5e-4, other=-0.04, radius=0.03, width=0.015, tolerance=2e-4
    )


def _touch(shape: Shape, probing: Probing) -> Probed:
    end = press(shape, PAD, probing.pose, probing.reach, 1e-3)
    position, axes = split_pose(probing.pose)
    if end.outcome not in ("hit", "bottomed"):
        return Probed(probing, end.outcome, position, -axes[:, 2])
    touched = end.compression > CONTACT
    surface: Floats = np.where(touched, -(end.compression + PAD.sag()), 0.0)
    patch = feel_patch(PAD, surface, touched, axes[2], 0.0)
    point = transform(end.pose, deepest_point(PAD, surface, touched)[None])[0]
    return Probed(probing, end.outcome, point, axes @ np.asarray(patch.normal))
