from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.thesis.match import match_contour, ray_azimuths

Figure = Callable[[str, int], Floats]


def circle(turns: Floats) -> Floats:
    return np.column_stack([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)])


def test_rays_begin_in_the_west_and_leave_out_the_seam() -> None:
    assert np.allclose(ray_azimuths(4), [-np.pi, -np.pi / 2, 0, np.pi / 2])


def test_points_of_a_circle_lie_on_their_rays() -> None:
    azimuths = ray_azimuths(40)
    match = match_contour(circle(np.arange(40) / 40 + 0.013), azimuths)
    assert match.one_to_one
    assert not match.degenerate
    assert np.allclose(
        match.points, np.column_stack([np.cos(azimuths), np.sin(azimuths)]), rtol=0, atol=1e-4
    )


def test_row_43_the_middle_of_an_unevenly_sampled_circle_is_that_of_its_area() -> None:
    turns = np.concatenate([0.25 * np.arange(60) / 60, 0.25 + 0.75 * np.arange(20) / 20])
    points = circle(turns)
    assert np.linalg.norm(points.mean(axis=0)) > 0.4
    assert np.linalg.norm(match_contour(points, ray_azimuths(80)).middle) < 0.005


@pytest.mark.parametrize("name", ["u", "c"])
def test_row_44_a_contour_around_a_middle_outside_is_matched_in_order_and_flagged(
    name: str, figure: Figure
) -> None:
    points = figure(name, 80) + [3.0, 0.5]
    match = match_contour(points, ray_azimuths(80))
    assert not match.one_to_one
    distances = np.linalg.norm(match.points[:, None] - points, axis=2)
    assert distances.min(axis=1).max() < 0.08  # on the contour
    assert distances.min(axis=0).max() < 0.2  # all around it
    numbers = np.unwrap(distances.argmin(axis=1), period=80)
    assert (np.diff(numbers) >= 0).all()
    assert 70 <= numbers[-1] - numbers[0] <= 80


def test_a_contour_is_matched_the_same_way_however_it_is_begun_and_directed(
    figure: Figure,
) -> None:
    points, azimuths = figure("lobes", 48), ray_azimuths(48)
    expected = match_contour(points, azimuths).points
    for other in (np.roll(points, 17, axis=0), points[::-1]):
        assert np.allclose(match_contour(other, azimuths).points, expected, rtol=0, atol=1e-12)


def test_points_in_one_place_are_that_place_and_said_to_be() -> None:
    match = match_contour(np.tile([0.3, -0.2], (12, 1)), ray_azimuths(12))
    assert match.degenerate
    assert np.allclose(match.points, [0.3, -0.2], rtol=0, atol=1e-15)
