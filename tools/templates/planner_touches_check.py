"""What must hold of the planner Template. Run it with ``python -m pytest`` in this folder.

It is told of a ball of which one side is not known well: no touch is simulated.
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
    """What is known of a ball over a platform whose error is larger about one side."""
    directions, faces = Superquadric(np.ones(3), np.ones(2)).mesh(4)
    places = MIDDLE + RADIUS * directions
    beside = np.linalg.norm(directions - np.array(side), axis=1) < 0.4
    errors = np.where(beside, error, 1e-5)
    surface = ObservedSurface(
        mesh=Mesh(places, faces),
        errors=errors,
        bounds=1.6 * errors,
        distances=np.full(len(places), 1e-3),
        pad=PAD,
        platform=0.0,
        reach=0.12,
        refused=np.zeros((0, 3)),
        aimed=np.zeros((0, 3)),
    )
    return replace(
        observation_of((), TOLERANCE), surface=surface, general=True, tolerance=TOLERANCE
    )


def test_it_goes_where_the_error_is() -> None:
    """Wherever that is: from the side, from another, from above."""
    for side in ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)):
        choice = Template().next(ball(side))
        assert isinstance(choice, Touch)
        assert np.linalg.norm(choice.target - MIDDLE - RADIUS * np.array(side)) < 0.013


def test_it_stops_within_tolerance() -> None:
    """And says so."""
    choice = Template().next(ball((1.0, 0.0, 0.0), error=1e-5))
    assert isinstance(choice, Stop)
    assert "limit is kept" in choice.reason


def test_what_was_tried_is_not_tried_again() -> None:
    """What was aimed at since the last model counts as known."""
    observation = ball((1.0, 0.0, 0.0))
    tried: list[np.ndarray] = []
    while isinstance(choice := Template().next(observation), Touch):
        assert not any(np.array_equal(choice.target, one) for one in tried)
        tried.append(choice.target)
        observation = replace(observation, tried=np.array(tried))
    assert isinstance(choice, Stop)
    assert 1 < len(tried) < 100


def test_it_begins_with_a_slice_and_gives_up_without_a_solid() -> None:
    """Nobody knows where to touch before there is one."""
    first = Template().next(observation_of((), TOLERANCE))
    assert isinstance(first, Height)
    assert isinstance(Template().next(observation_of((lost_slice(first.height),), TOLERANCE)), Stop)


def test_the_budget_is_kept() -> None:
    """Nothing more is begun when it would be overrun."""
    spent = Budget(most_touches=100, touches=100)
    assert isinstance(Template().next(replace(ball((1.0, 0.0, 0.0)), budget=spent)), Stop)
