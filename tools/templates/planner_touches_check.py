"""Tests of the planner Template. Run them with ``python -m pytest`` in this folder.

The observed solid is a ball with a larger error on one side; no touch is simulated.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from palpate.core.touch import Pad
from palpate.planning import (
    Budget,
    Height,
    Observation,
    ObservedSurface,
    Stop,
    Touch,
    lost_slice,
    observation_of,
)
from palpate.shapes import Mesh, Superquadric
from palpate.tools.templates.planner_touches import Template

TOLERANCE, RADIUS, MIDDLE = 2e-4, 0.03, np.array([0.0, 0.0, 0.05])
PAD = Pad(rows=16, cols=16, pitch=1e-3, thickness=6e-3, dome=0.0, saturation=0.5)


def ball(side: tuple[float, float, float], error: float = 1e-3) -> Observation:
    """Observation of a ball over a platform, with a larger `error` around one side."""
    directions, faces = Superquadric(np.ones(3), np.ones(2)).mesh(4)
    vertices = MIDDLE + RADIUS * directions
    on_side = np.linalg.norm(directions - np.array(side), axis=1) < 0.4
    errors = np.where(on_side, error, 1e-5)
    surface = ObservedSurface(
        mesh=Mesh(vertices, faces),
        errors=errors,
        bounds=1.6 * errors,
        distances=np.full(len(vertices), 1e-3),
        pad=PAD,
        platform=0.0,
        reach=0.12,
        refused=np.zeros((0, 3)),
        aimed=np.zeros((0, 3)),
    )
    return replace(
        observation_of((), TOLERANCE), surface=surface, general=True, tolerance=TOLERANCE
    )


def test_touches_are_where_the_error_is() -> None:
    """Errors are on two sides, and on top."""
    for side in ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)):
        choice = Template().next(ball(side))
        assert isinstance(choice, Touch)
        assert np.linalg.norm(choice.target - MIDDLE - RADIUS * np.array(side)) < 0.013


def test_it_stops_within_tolerance() -> None:
    """The reason names the kept limit."""
    choice = Template().next(ball((1.0, 0.0, 0.0), error=1e-5))
    assert isinstance(choice, Stop)
    assert "limit is kept" in choice.reason


def test_no_touch_is_tried_twice() -> None:
    """Places of touches since the last model count as known."""
    observation = ball((1.0, 0.0, 0.0))
    tried: list[np.ndarray] = []
    while isinstance(choice := Template().next(observation), Touch):
        assert not any(np.array_equal(choice.target, target) for target in tried)
        tried.append(choice.target)
        observation = replace(observation, tried=np.array(tried))
    assert isinstance(choice, Stop)
    assert 1 < len(tried) < 100


def test_first_choice_is_a_slice_and_without_solid_it_stops() -> None:
    """Touches need the surface of a solid."""
    first = Template().next(observation_of((), TOLERANCE))
    assert isinstance(first, Height)
    assert isinstance(Template().next(observation_of((lost_slice(first.height),), TOLERANCE)), Stop)


def test_the_budget_is_kept() -> None:
    """The planner stops when the budget is spent."""
    spent = Budget(most_touches=100, touches=100)
    assert isinstance(Template().next(replace(ball((1.0, 0.0, 0.0)), budget=spent)), Stop)
