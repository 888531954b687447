from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.trace import Slice as Wanted
from palpate.core.frames import DOWN, pose_of
from palpate.core.rebuild.felt.felt_points import FeltPoints, stack_points
from palpate.core.rebuild.reconstruct import reconstruct
from palpate.core.rebuild.solid import Solid
from palpate.core.shapes.posed import PosedShape
from palpate.core.shapes.protocol import Mesh
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.touch.pad import Pad

Make = Callable[..., Any]
Closed = Callable[[Mesh], bool]
NINE = np.linspace(-0.94, 0.94, 9)
BALL = ([0.03] * 3, [1.0, 1.0])
V, TURNS = np.linspace(0.002, 0.998, 60), np.arange(48) / 48


def rms(error: Floats) -> float:
    return float(np.sqrt(np.mean(error**2)))


def places(solid: Solid) -> Floats:
    return solid.surface.at(V[:, None], TURNS).reshape(-1, 3)


def is_whole(solid: Solid, is_closed: Closed) -> bool:
    mesh = solid.mesh(1e-3 * solid.surface.size)
    return is_closed(Mesh(mesh.vertices, mesh.faces)) and bool(np.isfinite(mesh.vertices).all())


@pytest.mark.parametrize(
    ("size", "exponents", "mean", "most"),
    [
        (*BALL, 5e-6, 30e-6),
        ([0.04, 0.025, 0.03], [1.0, 1.0], 5e-6, 30e-6),
        ([0.025, 0.025, 0.04], [0.1, 1.0], 10e-6, 0.1e-3),
        ([0.03, 0.02, 0.025], [0.5, 0.3], 30e-6, 0.25e-3),
        ([0.03, 0.02, 0.04], [0.1, 0.1], 10e-6, 50e-6),
    ],
)
def test_nine_contours_and_a_touched_top_give_the_object_back(
    size: list[float], exponents: list[float], mean: float, most: float,
    oracle: Make, is_closed: Closed,
) -> None:  # fmt: skip
    true = oracle(size, exponents)
    solid = true.rebuilt(NINE)
    error = true.distances(places(solid))
    assert (rms(error) < mean, np.abs(error).max() < most) == (True, True)
    assert solid.health()["felt_unused"] == 0.0
    assert is_whole(solid, is_closed)


@pytest.mark.parametrize("shares", [[0.0], [0.4], [-0.5, 0.5], [-0.8, 0.0, 0.8]])
def test_a_few_contours_give_a_closed_solid_that_stands_on_the_platform(
    shares: list[float], oracle: Make, is_closed: Closed
) -> None:
    solid = oracle(*BALL).rebuilt(shares)
    assert is_whole(solid, is_closed)
    points = places(solid)
    assert solid.surface.at(0.0, 0.0)[2] == pytest.approx(0.0, abs=1e-6)
    assert points[:, 2].max() == pytest.approx(0.06, abs=2e-4)


def test_a_top_that_nobody_touched_is_said_to_be_open_by_the_contours_distance(
    oracle: Make,
) -> None:
    solid = oracle([0.025, 0.025, 0.04], [0.05, 1.0]).rebuilt([-0.6, 0.0, 0.6], top=False)
    assert solid.uncovered[0] == 0.0
    assert solid.uncovered[1] == pytest.approx(0.6 * 0.04, rel=0.01)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
@pytest.mark.parametrize("shares", [[0.0], NINE])
def test_the_solid_of_a_larger_object_is_larger_and_else_the_same(
    scale: float, shares: list[float], oracle: Make
) -> None:
    size, exponents = [0.04, 0.025, 0.03], [1.0, 0.8]
    one = oracle(size, exponents).rebuilt(shares)
    other = oracle(size, exponents, scale).rebuilt(shares)
    assert np.allclose(places(other) / scale, places(one), rtol=0, atol=1e-8)


def test_the_order_of_the_contours_does_not_matter(oracle: Make) -> None:
    contours, felt, tops = oracle(*BALL).evidence(NINE)
    one = reconstruct(contours, patches=felt, tops=tops, method="skin")
    other = reconstruct(contours[::-1], patches=felt, tops=tops, method="skin")
    assert np.allclose(places(one), places(other), rtol=0, atol=1e-12)


def test_the_figures_of_the_fit_are_told(oracle: Make) -> None:
    contours, felt, tops = oracle(*BALL).evidence(NINE)
    solid = reconstruct(contours, patches=felt, tops=tops, method="skin")
    health = solid.health()
    assert 0.9 * len(felt.points) < health["felt_points"] <= len(felt.points)
    assert health["felt_rms"] < 1e-6
    assert health["sigma"] == health["felt_sigma"] < 1e-6
    assert 1.0 < health["felt_condition"] < 1e10
    assert (health["felt_pose_blocks"], health["felt_stretched"]) == (0.0, 0.0)
    assert 0.0 < health["felt_unfelt_gap"] < 0.01
    uncertainty = solid.uncertainty()
    assert uncertainty is not None
    assert 0.0 < uncertainty.rms < uncertainty.most < 1e-3


def test_a_side_that_was_felt_at_one_height_alone_is_stretched_and_that_is_said(
    oracle: Make,
) -> None:
    contours, felt, tops = oracle([0.03, 0.03, 0.4], [1.0, 1.0]).evidence([0.0], top=False)
    solid = reconstruct(contours, patches=felt, tops=tops, method="skin")
    assert solid.health()["felt_stretched"] == 1.0


def kidney(points: int) -> tuple[Floats, Floats]:
    """A thick arc of 300 degrees, from whose middle nothing is seen whole, and its normals."""
    turn = np.linspace(0.15, 2 * np.pi - 0.15, points)
    out = np.column_stack([np.cos(turn), np.sin(turn)])
    ring = np.concatenate([0.04 * out, 0.025 * out[::-1]])
    return ring, np.concatenate([out, -out[::-1]])


def test_sections_that_are_not_star_shaped_are_left_to_the_contours_and_that_is_said() -> None:
    ring, across = kidney(120)
    heights = np.linspace(0.01, 0.05, 5)
    contours = [np.column_stack([ring, np.full(len(ring), z)]) for z in heights]
    normals = np.column_stack([across, np.zeros(len(across))])
    tops = np.array([[0.03, 0.0, 0.0], [0.03, 0.0, 0.06]])
    for given in (normals, None):
        felt = FeltPoints(
            np.concatenate(contours),
            None if given is None else np.tile(given, (5, 1)),
            np.zeros(5 * len(ring), np.int32),
        )
        solid = reconstruct(contours, patches=felt, tops=tops, method="skin")
        alone = reconstruct(contours, tops=tops, method="skin")
        assert solid.health()["felt_unused"] == 1.0
        assert np.array_equal(places(solid), places(alone))


def test_a_handful_of_points_is_left_out_and_that_is_said(oracle: Make) -> None:
    contours, felt, tops = oracle(*BALL).evidence(NINE)
    few = FeltPoints(felt.points[:50], felt.normals[:50], felt.touch[:50])
    health = reconstruct(contours, patches=few, tops=tops, method="skin").health()
    assert health["felt_unused"] == 1.0


def test_normals_tell_what_lies_between_a_few_contours(oracle: Make) -> None:
    true = oracle([0.05, 0.04, 0.05], [0.4, 0.9])
    contours, _, tops = true.evidence([-0.9, -0.45, 0.0, 0.45, 0.9])
    normals = [true.felt(contour).normals for contour in contours]
    plain = reconstruct(contours, tops=tops, method="skin")
    with_them = reconstruct(contours, normals=normals, tops=tops, method="skin")
    assert with_them.health()["felt_unused"] == 0.0
    errors = [rms(true.distances(places(one))) for one in (with_them, plain)]
    assert errors[0] < 0.5 * errors[1]


@pytest.mark.parametrize("name", ["ball", "cylinder"])
def test_what_a_finger_feels_gives_the_object_back(
    name: str, finger: Any, domed: Pad, oracle: Make, request: pytest.FixtureRequest
) -> None:
    shape: Superquadric = request.getfixturevalue(name)
    half = float(shape.size[2])
    hand = finger(PosedShape(shape, np.array([0, 0, half, 0, 0, 0, 1.0])), domed)
    contours = []
    for height in np.linspace(0.06, 1.94, 9) * half:
        trace, status = hand.contour(Wanted(height, np.zeros(2), 0.1, 150))
        assert status == "closed"
        contours.append(trace.path.points)
    for x, y in [(0.0, 0.0), *((x, y) for x in (-0.01, 0.01) for y in (-0.01, 0.01))]:
        hand.press(pose_of(np.array([x, y, 2 * half + 6e-3]), DOWN), 0.05, 1e-3, 0.0)
    tops = np.array([[0, 0, 0.0], [0, 0, 2 * half]])
    solid = reconstruct(contours, patches=stack_points(hand.felt), tops=tops, method="skin")
    error = oracle(shape.size, shape.exponents).distances(places(solid))
    assert (rms(error) < 20e-6, np.abs(error).max() < 0.3e-3) == (True, True)
