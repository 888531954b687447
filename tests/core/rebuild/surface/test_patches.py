from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.surface.closed import closed_surface, sampled_patch
from palpate.core.shapes.superquadrics import Superquadric, regular_points


def ball(v: Floats, turns: Floats) -> Floats:
    """Of radius 2, its places crowded at one side of the turn and at the lower pole."""
    eta = np.pi * (v**2 - 0.5)[:, None]
    omega = 2 * np.pi * (turns + 0.1 * np.sin(2 * np.pi * turns))[None]
    points = np.cos(eta) * np.cos(omega), np.cos(eta) * np.sin(omega), np.sin(eta + 0 * omega)
    return 2.0 * np.stack(points, axis=-1)


def test_its_points_and_derivatives_are_those_of_the_surface():
    patch = sampled_patch(ball, rows=81, turns=96)
    v, turns = np.linspace(0.05, 0.95, 40), np.linspace(0.0, 2.0, 40)
    points, up = patch.at(v, turns), patch.at(v, turns, (1, 0))
    step = 1e-5
    differences = (patch.at(v + step, turns) - patch.at(v - step, turns)) / (2 * step)
    assert np.linalg.norm(points, axis=1) == pytest.approx(np.full(40, 2.0), abs=1e-5)
    assert up == pytest.approx(differences, abs=1e-5)
    assert np.abs(np.einsum("ni,ni->n", up, points)).max() < 1e-3


def test_its_places_lie_evenly_whatever_the_parameters():
    patch = sampled_patch(ball)
    ring = patch.at(np.full(64, 0.5), np.arange(64) / 64)
    steps = np.linalg.norm(np.diff(ring, axis=0), axis=1)
    assert steps.max() < 1.4 * steps.min()


def test_it_says_how_far_it_leaves_what_was_sampled():
    def box(v: Floats, turns: Floats) -> Floats:
        eta, omega = np.meshgrid(np.pi * (v - 0.5), 2 * np.pi * turns, indexing="ij")
        shape = Superquadric(np.ones(3), np.array([0.1, 0.1]))
        return regular_points(shape, eta.ravel(), omega.ravel()).points.reshape(*eta.shape, 3)

    coarse, fine = sampled_patch(box, 41, 64), sampled_patch(box)
    assert 0.0 < fine.miss < 2e-4 < coarse.miss


def test_a_sampled_ball_is_a_closed_surface():
    surface = closed_surface((sampled_patch(ball),))
    assert np.ptp(surface.at(np.zeros(5), np.linspace(0, 1, 5)), axis=0).max() < 1e-12
