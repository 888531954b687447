from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.plane.angle_between import angle_between
from palpate.core.plane.signed_area import signed_area
from palpate.core.plane.winding import winding_number
from palpate.core.rebuild.thesis.layer import rim_cells
from palpate.core.rebuild.thesis.match import ray_azimuths
from palpate.core.rebuild.thesis.program_layer import make_program_layer

Figure = Callable[[str, int], Floats]


def circle(count: int = 80) -> Floats:
    turn = ray_azimuths(count)
    return np.column_stack([np.cos(turn), np.sin(turn)])


def rim_of(control: Floats) -> Floats:
    cells = rim_cells((control.shape[0], control.shape[1]))
    return np.asarray(control[cells[:, 0], cells[:, 1]])


@pytest.mark.parametrize("sides", [(5, 5), (7, 7), (4, 6)])
def test_a_counter_clockwise_contour_makes_a_mirrored_layer(sides: tuple[int, int]) -> None:
    control = make_program_layer(circle(), sides).control
    assert control.shape == (*sides, 2)
    assert np.isfinite(control).all()
    assert signed_area(rim_of(control)) < 0.0
    # s = t = 0 is the north-west; t falls from there, s goes east.
    assert control[0, 0, 0] < 0.0 < control[0, 0, 1]
    assert control[0, -1, 1] < 0.0
    assert control[-1, 0, 0] > 0.0


def test_a_clockwise_contour_makes_an_upright_layer() -> None:
    control = make_program_layer(circle()[::-1], (5, 5)).control
    assert signed_area(rim_of(control)) > 0.0


def test_the_polygon_belongs_to_a_curve_that_does_not_close() -> None:
    layer = make_program_layer(circle() * [2.0, 1.0], (5, 5))
    assert 0.05 < layer.gap < 0.3


def test_the_core_of_a_round_layer_sticks_out_of_it() -> None:
    # The box around the largest ellipse, if only the search found that one.
    control = make_program_layer(circle(), (5, 5)).control
    assert make_program_layer(circle(), (5, 5)).core_scale == pytest.approx(0.618, abs=1e-3)
    grown = control[2, 2] + (control[1:-1, 1:-1] - control[2, 2]) / 0.618
    assert (winding_number(rim_of(control), grown.reshape(-1, 2)) == 0).any()


def test_the_core_runs_with_the_shell_only_if_the_first_vertex_is_west_of_the_origin() -> None:
    def runs_with_shell(control: Floats) -> bool:
        rim_ways = control[-1, 0] - control[0, 0], control[0, -1] - control[0, 0]
        core_ways = control[-2, 1] - control[1, 1], control[1, -2] - control[1, 1]
        turns = angle_between(np.array(rim_ways), np.array(core_ways))
        return bool((turns < 0.25 * np.pi).all())

    assert runs_with_shell(make_program_layer(circle(), (5, 5)).control)
    assert not runs_with_shell(make_program_layer(circle() + [5.0, 0.0], (5, 5)).control)


def test_a_contour_in_one_place_is_a_layer_in_one_place() -> None:
    layer = make_program_layer(np.tile([0.2, 0.4], (12, 1)), (5, 5))
    assert np.ptp(layer.control.reshape(-1, 2), axis=0).tolist() == [0.0, 0.0]
    assert layer.core_scale == layer.gap == 0.0
