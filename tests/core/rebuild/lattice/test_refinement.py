from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from palpate.core.rebuild.lattice.fit import LatticeFit, fit_lattice
from palpate.core.rebuild.lattice.refinement import refine_lattice
from palpate.core.rebuild.reconstruction import reconstruct
from palpate.core.rebuild.solid import Solid
from palpate.core.splines.lattices import Lattice

Making = Callable[..., Any]
HALF = 50.0


@cache
def ball() -> Solid:
    """A ball of 100 mm, lattice and all."""
    turn = 2 * np.pi * np.arange(60) / 60
    contours = []
    for z in np.linspace(-HALF + 0.5, HALF - 0.5, 15):
        radius = np.sqrt(HALF**2 - z**2)
        ring = [radius * np.cos(turn), radius * np.sin(turn), np.full(60, z)]
        contours.append(np.column_stack(ring))
    return reconstruct(contours, tops=[[0.0, 0.0, HALF], [0.0, 0.0, -HALF]])


@cache
def tube() -> Solid:
    turn = 2 * np.pi * np.arange(60) / 60
    rim = np.column_stack([0.3 * np.cos(turn), 0.2 * np.sin(turn), np.zeros(60)])
    return reconstruct([rim + [0.1 * z, 0.0, z] for z in np.linspace(0.0, 1.0, 9)])


def outwards(solid: Solid, v: float, turns: float, by: float) -> np.ndarray:
    at, way = solid.surface.at(v, turns), solid.surface.normals(v, turns)
    return np.asarray((at + by * way)[None])


@pytest.mark.parametrize("weights", [False, True])
def test_a_point_that_was_pulled_out_is_passed(weights):
    point = outwards(ball(), 0.55, 0.2, 3.0)
    refined = ball().refined(point, weights=weights)
    assert abs(refined.search().nearest(point).distances[0]) < 1e-6
    found = refined.lattice.refinement
    assert found.before == pytest.approx(3.0, rel=1e-3)
    assert found.after < 1e-6 and found.folded == 0.0
    assert (refined.lattice.lattice.volume.weights is not None) == weights


def test_weights_spare_control_points_a_part_of_the_way():
    point = outwards(ball(), 0.55, 0.2, 3.0)
    moved = [ball().refined(point, weights=w).lattice.refinement.moved for w in (False, True)]
    assert moved[1] < moved[0]


@pytest.mark.parametrize("weights", [False, True])
def test_points_on_the_surface_change_nothing(weights):
    points = ball().surface.at([0.3, 0.5, 0.7], [0.1, 0.4, 0.9])
    refined = ball().refined(points, weights=weights)
    assert np.array_equal(refined.lattice.lattice.control, ball().lattice.lattice.control)
    assert refined.lattice.refinement.steps == 0


@pytest.mark.parametrize("weights", [False, True])
def test_what_is_far_away_stays_as_it_was(weights):
    refined = ball().refined(outwards(ball(), 0.55, 0.2, 3.0), weights=weights)
    v, turns = np.random.default_rng(0).random((2, 500))
    before, after = (solid.surface.at(v, turns) for solid in (ball(), refined))
    centre = ball().surface.at(0.55, 0.2)
    moved = np.linalg.norm(after - before, axis=1)
    far = np.linalg.norm(before - centre, axis=1) > 1.4 * HALF
    assert moved.max() > 0.5
    assert far.sum() > 100 and moved[far].max() < 1e-4 * 3.0


def test_many_points_that_contradict_each_other_are_met_in_the_middle():
    out, back = outwards(ball(), 0.5, 0.3, 2.0), outwards(ball(), 0.5, 0.3, -1.0)
    refined = ball().refined(np.concatenate([out, back]))
    middle = outwards(ball(), 0.5, 0.3, 0.5)
    assert abs(refined.search().nearest(middle).distances[0]) < 0.05
    assert refined.lattice.refinement.most == pytest.approx(1.5, rel=0.05)


def test_doubtful_points_draw_less():
    point = outwards(ball(), 0.5, 0.3, 2.0)
    left = [
        ball().refined(point, sigma=sigma).lattice.refinement.after for sigma in (0.02, 2.0, 20.0)
    ]
    assert left[0] < 0.01
    assert left[1] == pytest.approx(1.0, rel=0.1)
    assert left[2] > 1.8


def test_a_touch_on_a_dent_that_nobody_touched_brings_the_surface_nearer_there():
    def dent(points: np.ndarray) -> np.ndarray:
        """A ball with a shallow dent at +x."""
        way = points / np.linalg.norm(points, axis=1, keepdims=True)
        angle = np.arccos(np.clip(way[:, 0], -1.0, 1.0))
        return np.asarray((HALF - 3.0 * np.exp(-((angle / 0.3) ** 2)))[:, None] * way)

    rng = np.random.default_rng(0)
    near = dent(np.array([1.0, 0.0, 0.0]) + 0.2 * rng.normal(size=(200, 3)))
    touches = dent(np.array([[1.0, 0.0, 0.0], [1.0, 0.15, 0.0], [1.0, -0.1, 0.12]]))
    refined = ball().refined(touches)
    before, after = (
        np.sqrt(np.mean(np.square(solid.search().nearest(near).distances)))
        for solid in (ball(), refined)
    )
    assert after < 0.5 * before


def test_points_at_an_end_are_counted_and_change_nothing():
    refined = tube().refined([[0.1, 0.0, 1.2], [0.0, 0.0, -0.1]])
    found = refined.lattice.refinement
    assert (found.beyond, found.points) == (2, 0)
    assert refined.health()["refined_beyond"] == 2.0
    assert np.array_equal(refined.lattice.lattice.control, tube().lattice.lattice.control)


def test_the_refined_solid_stays_closed_and_says_what_was_done():
    refined = ball().refined(outwards(ball(), 0.7, 0.6, -4.0))
    assert refined.mesh(1.0).faces.shape[1] == 3
    health = refined.health()
    assert health["refined_before"] == pytest.approx(4.0, rel=1e-3)
    assert health["refined_after"] < 1e-6
    assert health["lattice_folded"] == refined.lattice.refinement.folded == 0.0


def test_a_pull_through_the_other_side_is_a_fold_and_said():
    refined = tube().refined([[-0.6, 0.0, 0.5]], weights=False)
    through = refine_lattice(tube().lattice, np.array([[-0.8, 0.0, 0.5]]), np.array([[0.5, 0.0]]))
    assert refined.lattice.refinement.folded == 0.0
    assert through.refinement.folded > 0.0


def test_a_pole_stays_a_point():
    point = outwards(ball(), 0.97, 0.2, 2.0)
    refined = ball().refined(point)
    top = refined.surface.at(np.ones(20), np.arange(20) / 20)
    assert np.ptp(top, axis=0).max() < 1e-12
    assert refined.lattice.refinement.after < 0.2


def test_only_a_lattice_can_be_refined():
    turn = 2 * np.pi * np.arange(60) / 60
    rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(60)])
    skin = reconstruct([rim, rim + [0.0, 0.0, 1.0]], method="skin")
    with pytest.raises(ValueError, match="method must be lattice for a solid to be refined"):
        skin.refined([[0.0, 0.0, 0.0]])


@pytest.mark.parametrize(
    ("points", "sigma", "words"),
    [
        ([[0.0, np.nan, 0.0]], None, "points must be finite"),
        ([[0.0, 0.0]], None, "points must have shape"),
        ([[0.0, 0.0, 60.0]], 0.0, "sigma must be positive"),
    ],
)
def test_what_is_no_point_is_refused(points, sigma, words):
    with pytest.raises(ValueError, match=words):
        ball().refined(points, sigma=sigma)


def test_a_deviation_of_nothing_is_refused(sampled):
    fit: LatticeFit = fit_lattice(sampled("bent tube", rows=9, around=24).loft().surface, 1e-3)
    with pytest.raises(ValueError, match="sigma must be positive, got 0 m"):
        refine_lattice(fit, np.ones((1, 3)), np.full((1, 2), 0.5), sigma=np.zeros(1))
    assert isinstance(fit.lattice, Lattice)
