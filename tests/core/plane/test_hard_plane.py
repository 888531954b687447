from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.plane.angle_between import angle_between
from palpate.core.plane.area_centroid import area_centroid
from palpate.core.plane.azimuth_match import azimuth_match
from palpate.core.plane.edge_distance import edge_distance
from palpate.core.plane.inscribed_circle import inscribed_circle
from palpate.core.plane.inscribed_ellipse import ellipse_scale
from palpate.core.plane.radial_match import radial_match
from palpate.core.plane.winding import winding_number

AZIMUTHS = 2 * np.pi * np.arange(80) / 80


def test_an_unevenly_sampled_circle_has_its_centroid_in_the_middle() -> None:
    # Three quarters of the points lie on one quarter of the circle.
    angle = np.concatenate(
        [
            np.linspace(0, np.pi / 2, 60, endpoint=False),
            np.linspace(np.pi / 2, 2 * np.pi, 20, endpoint=False),
        ]
    )
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    assert np.linalg.norm(circle.mean(axis=0)) > 0.4
    assert np.linalg.norm(area_centroid(circle)) < 0.01
    assert np.linalg.norm(area_centroid(np.vstack([circle, circle[:1]]))) < 0.01


def test_a_concave_slice_is_matched_in_order_or_flagged_where_rays_miss_or_meet_it_often(
    u_shape: Floats, refined: Callable[..., Floats]
) -> None:
    contour = refined(u_shape)
    outside, inside = area_centroid(u_shape), inscribed_circle(u_shape).middle
    assert winding_number(u_shape, outside[None])[0] == 0
    assert set(radial_match(contour, outside, AZIMUTHS + 0.01).meetings) == {0, 2}
    assert set(radial_match(contour, inside, AZIMUTHS + 0.01).meetings) == {1, 3}
    for middle in (outside, inside):
        match = azimuth_match(contour, middle, AZIMUTHS)
        assert match.inside == (middle is inside)
        assert not match.one_to_one
        steps = np.mod(np.diff(match.turns, append=match.turns[0]), 1.0)
        assert (steps > 0.0).all()
        assert steps.sum() == pytest.approx(1.0)
        assert np.allclose(edge_distance(u_shape, match.points), 0.0, atol=1e-12)
    # Where a ray meets the outline only once, the match from inside is nearly that place.
    match = azimuth_match(contour, inside, AZIMUTHS)
    radial = radial_match(contour, inside, AZIMUTHS)
    below = (np.sin(AZIMUTHS) < -0.8) & (np.cos(AZIMUTHS) < 0.0)
    off = np.linalg.norm(match.points - radial.points, axis=1)[below]
    assert off.max() < 1.0


def test_the_largest_circle_in_a_u_lies_inside_where_the_middle_of_its_box_does_not(
    u_shape: Floats,
) -> None:
    box = 0.5 * (u_shape.min(axis=0) + u_shape.max(axis=0))
    assert winding_number(u_shape, box[None])[0] == 0
    middle, radius = inscribed_circle(u_shape)
    assert winding_number(u_shape, middle[None])[0] == 1
    # It touches two sides of a corner and the corner opposite: (1 - r) sqrt 2 = r.
    assert radius == pytest.approx(2 - math.sqrt(2), rel=1e-6)


def test_an_angle_of_a_nanoradian_is_found() -> None:
    first, second = np.array([1.0, 0.0]), np.array([math.cos(1e-9), math.sin(1e-9)])
    assert math.acos(min(float(first @ second), 1.0)) == 0.0
    assert angle_between(first, second) == pytest.approx(1e-9, rel=1e-12)


def test_the_ellipse_in_a_polygon_with_hollows_is_not_cut_by_lines_beyond_its_edges(
    three_lobes: Callable[..., Floats],
) -> None:
    polygon = three_lobes(0.45, 16)
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    middle, axes = 0.5 * (low + high), 0.5 * (high - low)
    around = (polygon - middle) / axes
    along = np.roll(around, -1, axis=0) - around
    lines = np.abs(along[:, 0] * around[:, 1] - along[:, 1] * around[:, 0])
    lines /= np.linalg.norm(along, axis=1)
    assert lines.min() == pytest.approx(0.168, abs=1e-3)
    assert ellipse_scale(polygon, middle, axes) == pytest.approx(0.399, abs=1e-3)


def test_the_largest_ellipse_comes_in_closed_form_where_the_search_has_no_branch(
    three_lobes: Callable[..., Floats], u_shape: Floats
) -> None:
    polygon, axes = three_lobes(0.5, 90) * [2.0, 1.0], np.array([2.0, 1.0])
    around = 2 * np.pi * np.arange(20000) / 20000
    circle = axes * np.column_stack([np.cos(around), np.sin(around)])
    low, high = 0.0, 1.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        fits = (winding_number(polygon, middle * circle) == 1).all()
        low, high = (middle, high) if fits else (low, middle)
    assert ellipse_scale(polygon, np.zeros(2), axes) == pytest.approx(low, abs=1e-5)
    assert ellipse_scale(u_shape, np.array([2.5, 2.0]), np.array([2.5, 2.0])) == 0.0
