from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.measure.distance import compare, prepare
from palpate.core.measure.solidity import solidity
from palpate.core.rebuild.reconstruct import reconstruct

RADIUS, HALF = 30.0, 50.0
TOPS = np.array([[0.0, 0.0, HALF], [1.0, 2.0, -HALF]])


def ball(count: int, around: int, seed: int = 0, noise: float = 0.0) -> list[Floats]:
    """Contours of a ball of 100 mm, begun anywhere, in either direction and in no order."""
    rng = np.random.default_rng(seed)
    contours = []
    for height in np.linspace(-HALF + 0.5, HALF - 0.5, count):
        many = int(rng.integers(around, around + around // 4))
        turn = 2 * np.pi * (np.arange(many) / many + rng.random())
        radius = np.sqrt(HALF**2 - height**2)
        ring = np.column_stack(
            [radius * np.cos(turn), radius * np.sin(turn), np.full(many, height)]
        )
        contours.append((ring + noise * rng.normal(size=ring.shape))[:: rng.choice([-1, 1])])
    return [contours[i] for i in rng.permutation(count)]


def prism(count: int) -> list[Floats]:
    turn = 2 * np.pi * np.arange(60) / 60
    ring = RADIUS * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(60)])
    return [ring + [0.0, 0.0, height] for height in np.linspace(-HALF + 0.5, HALF - 0.5, count)]


def eight(height: float) -> Floats:
    turn = 2 * np.pi * np.arange(60) / 60
    return np.column_stack([RADIUS * np.sin(turn), RADIUS * np.sin(2 * turn), np.full(60, height)])


def test_a_ball_comes_back_from_contours_in_any_order_and_direction() -> None:
    rebuilt = reconstruct(ball(15, 60), tops=TOPS)

    measures = rebuilt.measures()
    assert measures.moments.volume == pytest.approx(4 / 3 * np.pi * HALF**3, rel=1e-4)
    assert measures.area == pytest.approx(4 * np.pi * HALF**2, rel=1e-4)
    assert (rebuilt.closed.bottom.kind, rebuilt.closed.top.kind) == ("conic", "conic")


def test_the_mesh_is_closed_of_one_piece_and_as_fine_as_asked_for() -> None:
    rebuilt = reconstruct(ball(15, 60), tops=TOPS)

    coarse, fine = rebuilt.mesh(1.0), rebuilt.mesh(0.1)

    assert len(fine.faces) > 2 * len(coarse.faces)
    for mesh in (coarse, fine):
        found = solidity(mesh.vertices, mesh.faces)
        assert found.watertight and found.genus == 0
    exact = rebuilt.search().nearest(0.5 * (fine.vertices[0] + fine.vertices[1])[None])
    assert np.isfinite(exact.distances).all()


def test_noise_is_smoothed_and_estimated() -> None:
    rebuilt = reconstruct(ball(27, 80, noise=0.2), tops=TOPS)

    mesh = rebuilt.mesh(0.02)
    radii = np.linalg.norm(mesh.vertices, axis=1)
    assert rebuilt.health()["sigma"] == pytest.approx(0.2, rel=0.15)
    assert np.sqrt(np.mean((radii - HALF) ** 2)) < 0.1


def test_a_touched_end_is_where_it_was_touched_and_an_untouched_flat_one_is_doubted() -> None:
    touched, open_ended = reconstruct(prism(11), tops=TOPS), reconstruct(prism(11))

    assert np.ptp(touched.mesh().vertices[:, 2]) == pytest.approx(2 * HALF)
    assert touched.uncovered == (0.0, 0.0)
    assert np.ptp(open_ended.mesh().vertices[:, 2]) == pytest.approx(2 * HALF - 1.0)
    assert min(open_ended.uncovered) == pytest.approx(9.9)


def test_a_contour_that_went_wrong_is_left_out_and_said() -> None:
    contours = ball(27, 60)
    heights = np.array([contour[0, 2] for contour in contours])
    wrong = int(np.argsort(heights)[13])
    contours[wrong] = contours[wrong] * [1.3, 1.3, 1.0]

    rebuilt = reconstruct(contours, tops=TOPS)

    assert [one.which for one in rebuilt.slices.dropped] == [wrong]
    assert rebuilt.health()["dropped"] == 1.0
    radii = np.linalg.norm(rebuilt.mesh().vertices, axis=1)
    assert np.abs(radii - HALF).max() < 0.1


def test_the_unit_and_the_place_change_nothing() -> None:
    near = reconstruct(ball(15, 60), tops=TOPS)
    offset = np.array([7.0, -3.0, 2.0])
    far = reconstruct([1e-3 * c + offset for c in ball(15, 60)], tops=1e-3 * TOPS + offset)

    volume = far.measures().moments.volume
    assert volume == pytest.approx(1e-9 * near.measures().moments.volume, rel=1e-9)
    assert far.measures().moments.centroid == pytest.approx(offset, abs=1e-6)


def test_a_control_lattice_takes_the_shape_of_the_side() -> None:
    lattice = reconstruct(ball(15, 60), tops=TOPS).lattice

    assert lattice.health.rms < 1e-4 * HALF
    assert lattice.health.folded == 0.0


def test_two_contours_are_enough() -> None:
    rebuilt = reconstruct(prism(2), tops=TOPS)

    assert rebuilt.measures().moments.volume == pytest.approx(
        np.pi * RADIUS**2 * 2 * HALF, rel=1e-3
    )


def test_the_distance_to_the_truth_stands_beside_what_can_be_told_apart() -> None:
    mesh = reconstruct(ball(15, 60), tops=TOPS).mesh(0.02)
    finer, coarser = (reconstruct(ball(15, 60), tops=TOPS).mesh(t) for t in (0.02, 0.04))

    found = compare(prepare(mesh.vertices, mesh.faces), prepare(finer.vertices, finer.faces))
    floor = compare(prepare(coarser.vertices, coarser.faces), prepare(finer.vertices, finer.faces))

    assert found.chamfer <= floor.chamfer


@pytest.mark.parametrize(
    ("contours", "tops", "words"),
    [
        ([], None, "contours must"),
        ([np.zeros((5, 3))], None, "contours must"),
        (
            prism(1),
            None,
            "contours must leave at least 2 to rebuild from, or 1 with tops .*, got 1$",
        ),
        ([1e-300 * one for one in prism(4)], None, "contours and tops must span from 1e-50"),
        ([1e60 * one for one in prism(4)], None, "contours and tops must span from 1e-50"),
        (prism(4), [[0.0, 0.0, 1e300]], "contours and tops must span from 1e-50"),
        ([eight(-HALF), eight(HALF)], None, "contours must run around an area"),
        (prism(4), [[0.0, 0.0]], "tops must have shape"),
        (prism(4), [[0.0, 0.0, np.nan]], "tops must be finite"),
        (
            prism(4),
            [[0.0, 0.0, 10.0]],
            "tops must not lie within the contours, got 10 where the last is at 49.5",
        ),
    ],
)
def test_what_cannot_be_rebuilt_is_refused(
    contours: list[Floats], tops: list[list[float]] | None, words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        reconstruct(contours, tops=tops)


def test_a_noise_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="noise must be positive"):
        reconstruct(prism(4), noise=0.0)


def test_a_figure_of_eight_is_left_out() -> None:
    rebuilt = reconstruct([*prism(2), eight(0.0)])

    assert [one[:2] for one in rebuilt.slices.dropped] == [(2, "around no area")]


def test_no_tops_may_be_an_empty_list() -> None:
    assert reconstruct(prism(4), tops=[]).uncovered == reconstruct(prism(4)).uncovered


def test_a_side_through_contours_close_together_and_unlike_does_not_swing_out() -> None:
    even = reconstruct(ball(15, 60), tops=TOPS)
    low, high = prism(2)
    narrow = np.array([0.6, 0.6, 1.0])
    step = reconstruct(
        [low, high * [1.0, 1.0, 0.0], narrow * high * [1.0, 1.0, 0.02], narrow * high],
        method="skin",
    )

    assert even.overshoot < 0.01 and even.health()["paced"] == 0.0
    assert step.health()["overshoot"] == step.overshoot < 0.1
    assert step.health()["paced"] == 1.0


@pytest.mark.parametrize("share", [0.002, 0.01, 0.05, 1.0, 100.0])
def test_a_wild_side_is_meshed_however_coarsely(share: float) -> None:
    wide = prism(9)
    contours = [one * [0.1, 0.1, 1.0] if row % 2 else one for row, one in enumerate(wide)]
    rebuilt = reconstruct(contours)

    mesh = rebuilt.mesh(share * rebuilt.surface.size)

    found = solidity(mesh.vertices, mesh.faces)
    assert found.watertight and found.genus == 0


@pytest.mark.parametrize("count", [9, 11, 12, 15])
def test_of_few_contours_a_neck_that_one_alone_has_felt_stays_and_is_listed(count: int) -> None:
    contours = prism(count)
    which = count // 2
    contours[which] = contours[which] * [0.8, 0.8, 1.0]

    rebuilt = reconstruct(contours, tops=TOPS, method="skin")

    listed = [one.which for one in rebuilt.evidence.suspects]
    dropped = [(one.which, one.perhaps) for one in rebuilt.slices.dropped]
    assert (listed, dropped) == (([which], []) if count < 12 else ([], [(which, True)]))


def test_of_few_contours_one_of_another_shape_goes() -> None:
    contours = prism(9)
    turn = 2 * np.pi * np.arange(60) / 60
    contours[4] = contours[4] * (1 + 0.3 * np.cos(3 * turn))[:, None] ** [1, 1, 0]

    dropped = reconstruct(contours, tops=TOPS, method="skin").slices.dropped

    assert [(one.which, one.perhaps) for one in dropped] == [(4, False)]
