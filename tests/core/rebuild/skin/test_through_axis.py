"""Ends that close in a point far beyond what the contours lead to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.reconstruct import reconstruct
from palpate.core.rebuild.skin.through_axis import runs_through_axis

TURN = 2.0 * np.pi * np.arange(24) / 24


def ball(count: int, corner: float = 2.0) -> list[Floats]:
    """Contours of a ball, squarer with a larger exponent."""
    cosine, sine = np.cos(TURN), np.sin(TURN)
    shape = (np.abs(cosine) ** corner + np.abs(sine) ** corner) ** (-1.0 / corner)
    heights = np.linspace(0.0, 1.0, count)
    radii = 0.3 * np.sqrt(1.02 - (2.0 * heights - 1.0) ** 2)
    return [
        np.column_stack([radius * shape * cosine, radius * shape * sine, np.full(24, height)])
        for radius, height in zip(radii, heights, strict=True)
    ]


@pytest.mark.parametrize("method", ["skin", "lattice"])
def test_an_end_far_out_is_a_piece_of_its_own_where_the_side_would_turn_inside_out(
    method: str,
) -> None:
    solid = reconstruct(ball(4, 20.0), tops=[[0, 0, -0.2], [0, 0, 1.2]], method=method)

    assert solid.closed is not None
    assert (solid.closed.bottom.kind, solid.closed.top.kind) == ("conic", "conic")
    assert solid.closed.bottom.apart or solid.closed.top.apart
    assert solid.health()["apart_below"] + solid.health()["apart_above"] >= 1.0
    assert tuple(solid.check()) == (True, 0, 0)
    reached = solid.mesh().vertices[:, 2]
    assert (reached.min(), reached.max()) == pytest.approx((-0.2, 1.2), abs=1e-9)


def test_the_side_of_a_ball_runs_on_to_its_poles() -> None:
    solid = reconstruct(ball(9), tops=[[0, 0, -0.005], [0, 0, 1.005]], method="skin")

    assert solid.closed is not None
    assert solid.closed.top.round and not solid.closed.top.apart
    assert solid.health()["apart_above"] == 0.0
    surface = solid.closed.skin.surface
    assert not runs_through_axis(surface, 1.0, 1.005)
    inverted = replace(
        surface,
        control=surface.control * np.linspace(1.0, -1.0, len(surface.control))[:, None, None],
    )
    assert runs_through_axis(inverted, 0.4, 1.0)
