from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.trace import Slice as Wanted
from palpate.core.explore.uniform import from_above, slice_heights
from palpate.core.rebuild.felt.felt_points import FeltPoints, stack_points
from palpate.core.rebuild.felt.felt_solid import BANDS, Evidence, FeltContour, Solid, rebuild
from palpate.core.shapes.posed import PosedShape
from palpate.core.shapes.protocol import Mesh
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.touch.pad import Pad

Make = Callable[..., Any]
Volume = Callable[[Mesh], float]
Closed = Callable[[Mesh], bool]
NINE = np.linspace(-0.94, 0.94, 9)
BALL = ([0.03] * 3, [1.0, 1.0])


def rms(error: Floats) -> float:
    return float(np.sqrt(np.mean(error**2)))


def mesh_of(solid: Solid) -> Mesh:
    return Mesh(solid.vertices, solid.faces)


@pytest.mark.parametrize(
    # What is left lies at the ends, where the side is near and nothing was felt.
    ("size", "exponents", "mean", "most"),
    [
        (*BALL, 5e-6, 25e-6),
        ([0.04, 0.025, 0.03], [1.0, 1.0], 5e-6, 25e-6),
        ([0.025, 0.025, 0.04], [0.1, 1.0], 5e-6, 25e-6),
        ([0.03, 0.02, 0.025], [0.5, 0.3], 20e-6, 0.1e-3),
    ],
)
def test_nine_contours_and_a_touched_top_give_the_object_back(
    size: list[float], exponents: list[float], mean: float, most: float,
    oracle: Make, signed_volume: Volume, is_closed: Closed,
) -> None:  # fmt: skip
    true = oracle(size, exponents)
    solid = rebuild(true.evidence(NINE))
    error = true.distances(solid.vertices)
    assert rms(error) < mean
    assert np.abs(error).max() < most
    assert is_closed(mesh_of(solid))
    assert signed_volume(mesh_of(solid)) == pytest.approx(
        signed_volume(true.shape.mesh(6)), rel=2e-3
    )


def test_a_sharp_box_is_given_back_to_the_width_of_its_edges(oracle: Make) -> None:
    true = oracle([0.03, 0.02, 0.04], [0.1, 0.1])
    error = true.distances(rebuild(true.evidence(NINE)).vertices)
    assert rms(error) < 0.2e-3
    assert np.abs(error).max() < 0.8e-3


@pytest.mark.parametrize("shares", [[0.0], [0.4], [-0.5, 0.5], [-0.8, 0.0, 0.8], [-0.99], [0.97]])
@pytest.mark.parametrize("top", [True, False])
def test_a_few_contours_give_a_closed_finite_solid_that_stands_on_the_platform(
    shares: list[float], top: bool, oracle: Make, is_closed: Closed, signed_volume: Volume
) -> None:
    solid = rebuild(oracle(*BALL).evidence(shares, top))
    assert is_closed(mesh_of(solid))
    assert np.isfinite(solid.vertices).all()
    assert signed_volume(mesh_of(solid)) > 0.0
    assert solid.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-7)
    assert solid.vertices[:, 2].max() < 0.0605
    stretched = len(shares) == 1  # a side of no height is stretched, and that is said
    assert solid.health["fallbacks"] == float(not top) + float(stretched)


@pytest.mark.parametrize(
    ("shares", "mean"), [([-0.5, 0.5], 0.4e-3), ([-0.8, 0.0, 0.8], 30e-6), (NINE, 5e-6)]
)
def test_the_untouched_bottom_of_a_ball_is_closed_as_a_ball(
    shares: list[float], mean: float, oracle: Make
) -> None:
    true = oracle(*BALL)
    solid = rebuild(true.evidence(shares))
    lowest = solid.vertices[:, 2] < 0.01
    assert rms(true.distances(solid.vertices[lowest])) < mean


@pytest.mark.parametrize("scale", [1e-3, 1e3])
@pytest.mark.parametrize("shares", [[0.0], [-0.5, 0.5], NINE])
@pytest.mark.parametrize("top", [True, False])
def test_the_solid_of_a_larger_object_is_larger_and_else_the_same(
    scale: float, shares: list[float], top: bool, oracle: Make
) -> None:
    size, exponents = [0.04, 0.025, 0.03], [1.0, 0.8]
    one = rebuild(oracle(size, exponents).evidence(shares, top))
    other = rebuild(oracle(size, exponents, scale).evidence(shares, top))
    assert np.allclose(other.vertices / scale, one.vertices, rtol=0, atol=1e-10)
    assert np.allclose(other.deviation / scale, one.deviation, rtol=0.05, atol=1e-10)
    assert other.health["folded_share"] == one.health["folded_share"]


def test_the_order_of_the_contours_does_not_matter(oracle: Make) -> None:
    evidence = oracle(*BALL).evidence(NINE)
    other = rebuild(replace(evidence, contours=evidence.contours[::-1]))
    assert np.array_equal(other.vertices, rebuild(evidence).vertices)


def test_direction_and_start_of_a_contour_do_not_matter(oracle: Make) -> None:
    evidence = oracle([0.04, 0.025, 0.03], [1.0, 0.8]).evidence(NINE)
    turned = tuple(
        FeltContour(one.height, np.roll(one.points[::-1], 31, axis=0)) for one in evidence.contours
    )
    other = rebuild(replace(evidence, contours=turned))
    assert np.allclose(other.vertices, rebuild(evidence).vertices, rtol=0, atol=1e-12)


def test_a_contour_felt_twice_is_no_harm(oracle: Make) -> None:
    evidence = oracle(*BALL).evidence([-0.5, 0.0, 0.5])
    twice = rebuild(replace(evidence, contours=(*evidence.contours, evidence.contours[1])))
    assert np.allclose(twice.vertices, rebuild(evidence).vertices, rtol=0, atol=1e-12)


def test_an_object_that_stands_aside_gives_the_same_solid_there(oracle: Make) -> None:
    evidence = oracle(*BALL).evidence(NINE)
    shift = np.array([0.3, -0.2, 0.5])

    def moved(felt: FeltPoints) -> FeltPoints:
        return FeltPoints(felt.points + shift, felt.normals)

    contours = tuple(FeltContour(one.height + 0.5, one.points + shift) for one in evidence.contours)
    aside = rebuild(Evidence(contours, moved(evidence.side), moved(evidence.cap), 0.5))
    assert np.allclose(aside.vertices - shift, rebuild(evidence).vertices, rtol=0, atol=1e-9)


def test_the_health_counts_what_was_used_and_names_what_was_missing(oracle: Make) -> None:
    evidence = oracle(*BALL).evidence(NINE)
    solid = rebuild(evidence)
    assert solid.health["points"] == len(evidence.side.points) + len(evidence.cap.points)
    assert solid.health["folded_share"] == 0.0
    assert solid.health["fallbacks"] == 0.0
    # The prism's ridge bounds the condition of its two systems to about its inverse.
    assert 1.0 < solid.health["worst_condition"] < 1e12
    assert solid.health["skin_rms_m"] < 1e-6
    assert solid.health["lattice_rms_m"] < 2e-6
    assert all(np.isfinite(value) for value in solid.health.values())
    assert solid.band_heights.shape == solid.deviation.shape == (BANDS,)
    assert solid.band_heights[[0, -1]] == pytest.approx([0.03 * 0.06, 0.03 * 1.94])


def test_a_solid_without_contours_is_refused(oracle: Make) -> None:
    evidence = replace(oracle(*BALL).evidence([0.0]), contours=())
    with pytest.raises(ValueError, match="a solid needs at least one contour, got none"):
        rebuild(evidence)


def test_a_solid_whose_taxels_all_lie_on_level_faces_is_refused(oracle: Make) -> None:
    evidence = oracle(*BALL).evidence([0.0])
    up = np.tile([0.0, 0.0, 1.0], (len(evidence.side.points), 1))
    level = replace(evidence, side=FeltPoints(evidence.side.points, up), cap=stack_points([]))
    with pytest.raises(ValueError, match="no felt point lies on the side between 0 and"):
        rebuild(level)


@pytest.mark.parametrize(
    ("name", "mean", "most"), [("ball", 40e-6, 0.2e-3), ("cylinder", 60e-6, 0.6e-3)]
)
def test_what_a_finger_feels_gives_the_object_back(
    name: str, mean: float, most: float,
    finger: Any, domed: Pad, oracle: Make, is_closed: Closed, request: pytest.FixtureRequest,
) -> None:  # fmt: skip
    shape: Superquadric = request.getfixturevalue(name)
    half = float(shape.size[2])
    hand = finger(PosedShape(shape, np.array([0, 0, half, 0, 0, 0, 1.0])), domed)
    contours = []
    for height in slice_heights(0.0, 2 * half, 9):
        trace, status = hand.contour(Wanted(height, np.zeros(2), 0.1, 150))
        assert status == "closed"
        contours.append(FeltContour(height, trace.path.points))
    side = stack_points(hand.felt)
    hand.felt.clear()
    for place in [(0.0, 0.0), *((x, y) for x in (-0.01, 0.01) for y in (-0.01, 0.01))]:
        hand.press(from_above(np.array(place), 2 * half), 0.05, 1e-3, 0.0)
    solid = rebuild(Evidence(tuple(contours), side, stack_points(hand.felt), 0.0))
    error = oracle(shape.size, shape.exponents).distances(solid.vertices)
    assert is_closed(mesh_of(solid))
    assert rms(error) < mean
    assert np.abs(error).max() < most
