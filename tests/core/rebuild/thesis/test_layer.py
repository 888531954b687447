from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.plane.inscribed_ellipse import ellipse_scale
from palpate.core.plane.signed_area import signed_area
from palpate.core.plane.winding import winding_number
from palpate.core.rebuild.thesis.layer import make_layer, nearest_phase, rim_cells
from palpate.core.rebuild.thesis.match import match_contour, ray_azimuths

Figure = Callable[[str, int], Floats]


def rim_of(control: Floats) -> Floats:
    cells = rim_cells((control.shape[0], control.shape[1]))
    return np.asarray(control[cells[:, 0], cells[:, 1]])


def core_of(control: Floats) -> Floats:
    return np.asarray(control[1:-1, 1:-1].reshape(-1, 2))


def circle(count: int) -> Floats:
    turn = ray_azimuths(count)
    return np.column_stack([np.cos(turn), np.sin(turn)])


def test_the_rim_runs_counter_clockwise_from_the_north_west() -> None:
    cells = rim_cells((4, 5))
    assert cells[0].tolist() == [0, 4]
    assert len(np.unique(cells, axis=0)) == len(cells) == 2 * (4 + 5) - 4
    assert np.abs(np.diff(cells, axis=0, append=cells[:1])).sum(axis=1).tolist() == [1] * 14
    assert signed_area(cells.astype(float)) > 0.0


def test_the_vertex_nearest_in_phase_is_found_across_the_seam() -> None:
    turn = np.radians([178.0, -176.0, 90.0, 0.0])
    polygon = np.column_stack([np.cos(turn), np.sin(turn)]) + 5.0
    assert nearest_phase(polygon, np.array([5.0, 5.0]), np.array([4.0, 5.01])) == 0
    assert nearest_phase(polygon, np.array([5.0, 5.0]), np.array([4.0, 4.9])) == 1


def test_a_layer_of_a_circle_is_upright_and_not_mirrored() -> None:
    layer = make_layer(circle(80), (5, 5))
    rim = rim_of(layer.control)
    assert np.abs(np.linalg.norm(rim, axis=1) - 1.0).max() < 0.06
    assert signed_area(rim) > 0.0
    assert (np.diff(layer.control[1:-1, 1:-1, 0], axis=0) > 0.0).all()
    assert (np.diff(layer.control[1:-1, 1:-1, 1], axis=1) > 0.0).all()
    corner = layer.control[0, -1]
    assert np.arctan2(corner[1], corner[0]) == pytest.approx(0.75 * np.pi, abs=np.pi / 16)
    assert layer.gap == 0.0
    assert not layer.moved


@pytest.mark.parametrize("sides", [(4, 4), (5, 5), (4, 7), (9, 5)])
@pytest.mark.parametrize("name", ["lobes", "u", "c"])
def test_the_core_lies_inside_the_shell(name: str, sides: tuple[int, int], figure: Figure) -> None:
    points = match_contour(figure(name, 120), ray_azimuths(120)).points
    layer = make_layer(points, sides)
    assert layer.control.shape == (*sides, 2)
    assert 0.0 < layer.core_scale < 1.0
    assert (winding_number(rim_of(layer.control), core_of(layer.control)) == 1).all()


def test_row_45_the_core_of_a_u_is_in_the_middle_of_its_largest_circle(figure: Figure) -> None:
    points = match_contour(figure("u", 120), ray_azimuths(120)).points
    layer = make_layer(points, (7, 7))
    rim = rim_of(layer.control)
    box = 0.5 * (rim.min(axis=0) + rim.max(axis=0))
    assert winding_number(rim, box[None])[0] == 0
    assert layer.moved
    assert (winding_number(rim, core_of(layer.control)) == 1).all()


def test_row_71_a_core_is_bounded_by_edges_and_not_by_the_lines_they_lie_on(
    figure: Figure,
) -> None:
    turn = 2 * np.pi * np.arange(16) / 16
    polygon = (1 + 0.45 * np.cos(3 * turn))[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    along = np.roll(polygon, -1, axis=0) - polygon
    normals = np.column_stack([along[:, 1], -along[:, 0]])
    by_lines = np.abs(np.einsum("nd,nd->n", normals, polygon - middle)) / np.linalg.norm(
        normals * half, axis=1
    )
    assert by_lines.min() == pytest.approx(0.168, abs=1e-3)
    assert ellipse_scale(polygon, middle, half) == pytest.approx(0.399, abs=1e-3)
    # A layer around the same figure has room accordingly.
    layer = make_layer(match_contour(figure("lobes", 96), ray_azimuths(96)).points, (5, 5))
    assert layer.core_scale > 1.5 * by_lines.min()
    assert not layer.moved


@pytest.mark.parametrize(
    "points",
    [
        np.tile([0.2, 0.4], (12, 1)),
        np.column_stack([np.cos(ray_azimuths(12)), np.full(12, 0.3)]),
        np.cos(ray_azimuths(12))[:, None] * [0.5, 0.8],
    ],
    ids=["point", "level", "slanted"],
)
def test_a_contour_that_encloses_nothing_has_a_core_in_one_place(points: Floats) -> None:
    layer = make_layer(points, (5, 5))
    assert np.isfinite(layer.control).all()
    assert layer.core_scale < 1e-9
    assert np.ptp(core_of(layer.control), axis=0).max() < 1e-9
