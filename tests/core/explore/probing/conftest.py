"""A finger that probes known solids, and contours that are known without tracing."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.probing.ends import EndObservation, ProbeCommand, ProbeResult, SideContour
from palpate.core.explore.probing.rule import next_probe
from palpate.core.explore.tracing.contour_path import deepest_point
from palpate.core.poses import split_pose, transform_points
from palpate.core.touch.curvature import fit_patch
from palpate.core.touch.pad import Pad, guarded_move

PAD = Pad(16, 16, 1e-3, 3e-3, 1.0 / 0.015, 0.8)
CONTACT = 0.05e-3


@pytest.fixture(scope="session")
def touch():
    """Make a touch of a solid."""
    return _touch


@pytest.fixture(scope="session")
def probed():
    """Touch an end of a solid as the rule says, to its end."""

    def run(shape, end, observation):
        while isinstance(found := next_probe(end, observation), ProbeCommand):
            observation = replace(observation, probes=(*observation.probes, _touch(shape, found)))
            assert len(observation.probes) <= 45
        return found, observation.probes

    return run


@pytest.fixture(scope="session")
def ring():
    """A round contour of a wall that leans, whose touches measured so far below and above it."""

    def make(radius, height, *, lean=0.0, below=7e-3, above=0.0):
        turn = 2.0 * np.pi * np.arange(60) / 60
        out = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        level = np.full(60, height)
        normals = np.column_stack([np.cos(lean) * out, np.full(60, np.sin(lean))])
        return SideContour(
            np.column_stack([radius * out, level]), normals, level - below, level + above
        )

    return make


@pytest.fixture(scope="session")
def observation():
    """An upper end at 40 mm of an object of 80 mm, found by nobody yet."""
    return EndObservation(
        height=0.04, deviation=5e-4, other=-0.04, radius=0.03, width=0.015, tolerance=2e-4
    )


def _touch(shape, probing):
    end = guarded_move(shape, PAD, probing.pose, probing.reach, 1e-3)
    position, axes = split_pose(probing.pose)
    if end.outcome not in ("hit", "bottomed"):
        return ProbeResult(probing, end.outcome, position, -axes[:, 2])
    touched = end.compression > CONTACT
    surface: Floats = PAD.surface(end.compression, touched)
    patch = fit_patch(PAD, surface, touched, axes[2], 0.0)
    point = transform_points(end.pose, deepest_point(PAD, surface, touched)[None])[0]
    return ProbeResult(probing, end.outcome, point, axes @ np.asarray(patch.normal))
