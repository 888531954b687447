from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from palpate.core.arrays import Floats
from palpate.core.plane.winding import winding_number
from palpate.core.rebuild.correspondence.correspondence import Correspondence, match_slices
from palpate.core.rebuild.slices.slice_distance import slice_distance
from palpate.core.rebuild.slices.slices import Slices, slices_of

COUNT = 80
AROUND = np.arange(COUNT) / COUNT
BETWEEN = np.linspace(-0.96, 0.96, 60)
NAMES = ["lobed", "three lobes", "four lobes", "square", "bent tube", "star", "kidney", "box"]
Section = Callable[[Floats, float], Floats]
Sections = dict[str, Section]


def loft_error(section: Section, slices: Slices, grid: Floats) -> float:
    """Mean distance between the object and a cubic through each row of places."""
    found = CubicSpline(slices.heights, grid, axis=0)(BETWEEN)
    truth = np.stack([section(np.arange(1600) / 1600, z) for z in BETWEEN])
    return float(slice_distance(truth, found[None]).mean())


def perfect(section: Section, slices: Slices) -> Floats:
    """The same curves at the places that belong together by the object's making."""
    rows = []
    for curve, z in zip(slices.curves, slices.heights, strict=True):
        fine = curve.at(np.arange(8000) / 8000)
        rows.append(fine[cKDTree(fine).query(section(AROUND, float(z)))[1]])
    return np.stack(rows)


def stack(traced: Callable[..., Any], section: Section, count: int, points: int) -> Slices:
    return slices_of(traced(section).contours(np.linspace(-0.97, 0.97, count), points))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("count", "points"), [(27, 81), (9, 24)])
def test_any_start_direction_and_count_cost_next_to_nothing(
    traced: Callable[..., Any], sections: Sections, name: str, count: int, points: int
) -> None:
    section = sections[name]
    slices = stack(traced, section, count, points)
    found = match_slices(slices, COUNT)
    error = loft_error(section, slices, found.grid)
    # 24 points do not hold the corners of a square: which of them are cut is chance.
    allowed = 1.15 if (name, count) == ("square", 9) else 1.03
    assert error < allowed * loft_error(section, slices, perfect(section, slices)) + 5e-6


@pytest.mark.parametrize("name", ["three lobes", "four lobes"])
def test_lobes_that_turn_are_followed_by_their_signature(
    traced: Callable[..., Any], sections: Sections, name: str
) -> None:
    slices = stack(traced, sections[name], 9, 40)
    found = match_slices(slices, COUNT)
    assert found.method == "signature"
    assert min(found.scores, key=lambda method: found.scores[method]) == "signature"
    errors = {
        method: loft_error(sections[name], slices, match_slices(slices, COUNT, method).grid)
        for method in found.scores
    }
    assert errors["signature"] < 0.5 * min(errors["twist"], errors["ray"], errors["azimuth"])


def test_a_step_of_the_object_does_not_hide_how_its_lobes_turn(
    traced: Callable[..., Any], sections: Sections
) -> None:
    section = sections["four lobes"]
    slices = stack(traced, lambda t, z: section(t, z) * (1.0 if z < 0.1 else 0.6), 27, 60)
    assert match_slices(slices, COUNT).method == "signature"


def test_a_slice_whose_middle_lies_outside_is_matched(
    traced: Callable[..., Any], sections: Sections
) -> None:
    """Hard case 44: a ray from there meets the contour 0, 2 or 4 times."""
    slices = stack(traced, sections["kidney"], 27, 81)
    for curve, middle in zip(slices.fine, slices.middles, strict=True):
        assert winding_number(curve, middle[None])[0] == 0
    found = match_slices(slices, COUNT)
    assert "azimuth" not in found.scores
    error = loft_error(sections["kidney"], slices, found.grid)
    assert error < 3e-4
    azimuth = match_slices(slices, COUNT, "azimuth")
    assert np.isfinite(azimuth.grid).all()
    assert loft_error(sections["kidney"], slices, azimuth.grid) > error


def test_how_contours_were_begun_and_directed_changes_nothing(
    traced: Callable[..., Any], sections: Sections
) -> None:
    """Hard case 42."""
    contours = traced(sections["lobed"]).contours(np.linspace(-0.97, 0.97, 9), 60)
    wanted = match_slices(slices_of(contours), COUNT)
    others = [np.roll(one, 5 + 3 * i, axis=0)[:: 1 - 2 * (i % 2)] for i, one in enumerate(contours)]
    found = match_slices(slices_of(others[::-1]), COUNT)
    assert found.method == wanted.method
    assert np.abs(found.grid - wanted.grid).max() < 1e-12


@pytest.mark.parametrize("method", ["twist", "signature", "ray", "azimuth"])
def test_places_lie_on_the_curves_in_order(
    traced: Callable[..., Any], sections: Sections, method: Any
) -> None:
    slices = stack(traced, sections["lobed"], 9, 60)
    found = match_slices(slices, COUNT, method)
    assert found.method == method
    assert list(found.scores) == [method]
    for curve, places, row in zip(slices.curves, found.places, found.grid, strict=True):
        assert np.abs(curve.at(places) - row).max() < 1e-14
    assert (np.diff(found.places, axis=1) > 0).all()
    assert (found.places[:, -1] - found.places[:, 0] < 1).all()
    assert ((found.turns >= 0) & (found.turns < 1)).all()
    assert np.allclose(np.mod(found.places[:, 0] - found.turns + 0.5, 1), 0.5)


def test_equal_azimuths_correspond_about_the_middles(
    traced: Callable[..., Any], sections: Sections
) -> None:
    slices = stack(traced, sections["lobed"], 9, 80)
    away = match_slices(slices, COUNT, "azimuth").grid - slices.middles[:, None]
    angle = np.unwrap(np.arctan2(away[..., 1], away[..., 0]), axis=1)
    assert np.abs(angle - 2 * np.pi * AROUND).max() < 1e-3


def test_the_first_place_of_the_middle_slice_is_on_the_ray(
    traced: Callable[..., Any], sections: Sections
) -> None:
    slices = stack(traced, sections["box"], 9, 60)
    found = match_slices(slices, COUNT, "twist")
    off = found.grid[4, 0] - slices.middles[4]
    assert off[0] > 0
    assert abs(off[1]) < 1e-3


def test_a_score_is_about_what_leaving_contours_out_would_cost(
    traced: Callable[..., Any], sections: Sections
) -> None:
    section = sections["bent tube"]
    slices = stack(traced, section, 17, 60)
    found = match_slices(slices, COUNT)
    left = np.arange(17) % 2 == 0
    coarse = slices.without(~left, "unlike its neighbours")
    costs = loft_error(section, coarse, found.grid[left])
    assert found.scores[found.method] / 20 < costs < 20 * found.scores[found.method]


@pytest.mark.parametrize("count", [1, 2])
def test_with_fewer_than_three_slices_nothing_is_scored(
    traced: Callable[..., Any], sections: Sections, count: int
) -> None:
    found = match_slices(stack(traced, sections["bent tube"], count, 40), 20)
    assert isinstance(found, Correspondence)
    assert found.grid.shape == (count, 20, 2)
    assert found.method == "twist"
    assert found.scores == {}


def test_unit_and_place_change_nothing(traced: Callable[..., Any], sections: Sections) -> None:
    contours = traced(sections["four lobes"]).contours(np.linspace(-0.97, 0.97, 9), 40)
    wanted = match_slices(slices_of(contours), COUNT)
    found = match_slices(slices_of([1e-3 * (one + [3.0, -5.0, 20.0]) for one in contours]), COUNT)
    assert found.method == wanted.method
    assert np.abs(1e3 * found.grid - [3.0, -5.0] - wanted.grid).max() < 1e-9
    assert found.scores[found.method] == pytest.approx(1e-3 * wanted.scores[wanted.method])


@pytest.mark.parametrize(
    ("count", "method", "words"),
    [
        (2, "auto", "count must be at least 3, got 2"),
        (9, "best", "method must be auto or one of twist, signature, ray, azimuth, got 'best'"),
    ],
)
def test_what_no_match_can_be_is_refused(
    traced: Callable[..., Any], sections: Sections, count: int, method: Any, words: str
) -> None:
    slices = stack(traced, sections["bent tube"], 2, 40)
    with pytest.raises(ValueError, match=words):
        match_slices(slices, count, method)
