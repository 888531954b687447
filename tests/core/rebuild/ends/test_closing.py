from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
import pytest
from scipy.spatial import cKDTree

from palpate.core.arrays import Floats
from palpate.core.rebuild.ends.closing import End, close_ends, free_shoulder

Radius = Callable[[Floats, Floats], Floats]
K = 80
TURNS = np.arange(K) / K


def superellipse(z: Floats, exponent: float) -> Floats:
    return np.asarray(np.maximum(1.0 - np.abs(z / 50) ** (2 / exponent), 0.0) ** (exponent / 2))


def ellipse(angle: Floats, a: float, b: float) -> Floats:
    return np.asarray(1.0 / np.hypot(np.cos(angle) / a, np.sin(angle) / b))


# Between the heights -50 and 50.
SHAPES: dict[str, Radius] = {
    "sphere": lambda t, z: np.sqrt(np.maximum(2500 - z**2, 0)) + 0 * t,
    "ellipsoid": lambda t, z: superellipse(z, 1.0) * ellipse(t, 35, 25),
    "cylinder": lambda t, z: 30.0 + 0 * (t + z),
    "rounded cylinder": lambda t, z: 30 * superellipse(z, 0.2) + 0 * t,
    "rounded box": lambda t, z: (
        30 * superellipse(z, 0.2) / (np.cos(t) ** 10 + np.sin(t) ** 10) ** 0.1
    ),
    "frustum": lambda t, z: 30 - 0.15 * z + 0 * t,
    "cone": lambda t, z: 0.3 * (50 - z) + 0 * t,
    "egg": lambda t, z: superellipse(z, 1.0) * (32 + 0.12 * z) + 0 * t,
    "lobed vase": lambda t, z: (
        (28 + 6 * np.sin(0.06 * z)) * (1 + 0.1 * np.cos(4 * t)) * superellipse(z, 0.5) ** 2
    ),
}


def contours(
    name: str, gap: float, count: int = 27, noise: float = 0.0
) -> tuple[Floats, Floats, tuple[float, float]]:
    """Heights, grid, and the ends as a touch finds them."""
    rng = np.random.default_rng(7)
    heights = np.linspace(-50.0 + gap, 50.0 - gap, count)
    angle = 2 * np.pi * TURNS
    radius = SHAPES[name](angle[None], heights[:, None]) + noise * rng.normal(size=(count, K))
    low, high = np.array([-50.0, 50.0]) + noise * rng.normal(size=2)
    grid = radius[:, :, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return heights, grid, (float(low), float(high))


def mean_radius(name: str, heights: Floats) -> Floats:
    radius = SHAPES[name](2 * np.pi * TURNS[None], heights[:, None])
    return np.asarray(np.sqrt(np.mean(radius**2, axis=1)))


def curve(heights: Floats, radii: Floats, end: float) -> Floats:
    """A profile down to the axis, evenly by length."""
    points = np.concatenate([np.column_stack([radii, heights]), [[0.0, end]]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    even = np.linspace(0.0, length[-1], 700)
    return np.column_stack([np.interp(even, length, column) for column in points.T])


def misfit(name: str, gap: float, end: End, last: float) -> float:
    """Mean distance, both ways, between the profile of an end and the true one."""
    way = 1.0 - (1.0 - np.linspace(0.0, 1.0, 400)) ** 3
    sign = np.sign(end.rim)
    true_heights = sign * (50.0 - gap + gap * way)
    truth = curve(true_heights, mean_radius(name, true_heights), sign * 50.0)
    heights = end.rim + (end.height - end.rim) * way
    found = curve(heights, last * end.profile.shares(way), end.height)
    there, back = cKDTree(truth).query(found)[0], cKDTree(found).query(truth)[0]
    return float(0.5 * (there.mean() + back.mean()))


def disc_of(end: End) -> End:
    """A disc on the last contour."""
    return End("fan", end.rim, end.rim, 1.0, end.profile, end.middle, True)


@pytest.mark.parametrize("name", SHAPES)
def test_touched_ends_are_at_most_two_thirds_as_wrong_as_a_disc_on_the_last_contour(name):
    for gap in (0.5, 2.0, 5.0):
        heights, grid, (low, high) = contours(name, gap)
        for row, end in zip((0, -1), close_ends(heights, grid, bottom=low, top=high), strict=True):
            last = float(mean_radius(name, heights[[row]])[0])
            assert misfit(name, gap, end, last) <= 0.67 * misfit(name, gap, disc_of(end), last)


@pytest.mark.parametrize("name", SHAPES)
def test_with_noise_no_end_is_worse_than_a_disc_by_more_than_a_sixteenth_of_the_whole(name):
    for (gap, count), touched in product([(0.5, 27), (5.0, 27), (2.0, 9), (5.0, 9)], (True, False)):
        heights, grid, (low, high) = contours(name, gap, count, noise=0.2)
        told = {"bottom": low, "top": high} if touched else {}
        for row, end in zip((0, -1), close_ends(heights, grid, **told, noise=0.2), strict=True):
            last = float(np.sqrt(np.mean(np.sum(grid[row] ** 2, axis=1))))
            disc = misfit(name, gap, disc_of(end), last)
            assert misfit(name, gap, end, last) <= 1.06 * disc + 0.03, (gap, count, touched)


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("sphere", ("conic", "conic")),
        ("cylinder", ("flat", "flat")),
        ("rounded cylinder", ("superellipse", "superellipse")),
        ("frustum", ("flat", "flat")),
        ("egg", ("conic", "conic")),
    ],
)
def test_the_family_is_the_one_that_tells_the_last_contour(name, kinds):
    heights, grid, (low, high) = contours(name, 5.0)
    found = close_ends(heights, grid, bottom=low, top=high)
    assert tuple(end.kind for end in found) == kinds
    assert [end.height for end in found] == [low, high]
    assert [end.uncovered for end in found] == [0.0, 0.0]


@pytest.mark.parametrize("name", ["sphere", "ellipsoid", "egg"])
@pytest.mark.parametrize("gap", [0.5, 2.0, 5.0])
def test_the_pole_of_a_round_end_is_found_without_a_touch(name, gap):
    heights, grid, _ = contours(name, gap)
    for end, pole in zip(close_ends(heights, grid), (-50.0, 50.0), strict=True):
        assert end.kind == "pole"
        assert end.round
        assert end.height == pytest.approx(pole, abs=0.05)
        assert end.uncovered == 0.0


@pytest.mark.parametrize("name", ["cylinder", "rounded box", "frustum"])
def test_a_flat_end_that_nobody_touched_leaves_one_spacing_uncovered(name):
    heights, grid, _ = contours(name, 5.0)
    for end, rim in zip(close_ends(heights, grid), heights[[0, -1]], strict=True):
        assert (end.kind, end.round) == ("fan", False)
        assert end.height == end.rim == rim
        assert end.uncovered == pytest.approx(heights[1] - heights[0])


def test_one_end_may_be_touched_and_the_other_not():
    heights, grid, (_, high) = contours("cylinder", 2.0)
    bottom, top = close_ends(heights, grid, top=high)
    assert (bottom.kind, top.kind) == ("fan", "flat")


def test_ends_are_the_same_upside_down():
    heights, grid, (low, high) = contours("egg", 5.0, 20)
    bottom, top = close_ends(heights, grid, bottom=low, top=high)
    above, below = close_ends(-heights[::-1], grid[::-1], bottom=-high, top=-low)
    assert (above.kind, below.kind) == (top.kind, bottom.kind)
    assert above.profile == pytest.approx(top.profile)
    assert below.profile == pytest.approx(bottom.profile)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_ends_do_not_depend_on_the_unit(unit):
    heights, grid, (low, high) = contours("rounded box", 5.0)
    top = close_ends(heights, grid, bottom=low, top=high, noise=0.1)[1]
    scaled = close_ends(
        unit * heights, unit * grid, bottom=unit * low, top=unit * high, noise=unit * 0.1
    )[1]
    assert scaled.kind == top.kind
    assert scaled.profile == pytest.approx(top.profile)
    assert scaled.height == pytest.approx(unit * top.height)


def test_the_middle_of_an_end_lies_where_the_axis_leads():
    heights, grid, (low, high) = contours("cylinder", 5.0)
    leaning = grid + np.stack([0.2 * heights, -0.1 * heights], axis=-1)[:, None]
    bottom, top = close_ends(heights, leaning, bottom=low, top=high)
    np.testing.assert_allclose(bottom.middle, [-10.0, 5.0], atol=1e-9)
    np.testing.assert_allclose(top.middle, [10.0, -5.0], atol=1e-9)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_few_contours_still_have_ends(count):
    heights, grid, _ = contours("cylinder", 20.0, 9)
    touched = close_ends(heights[:count], grid[:count], bottom=-50.0, top=50.0)
    free = close_ends(heights[:count], grid[:count])
    assert [end.kind for end in touched] == ["flat", "flat"]
    assert [end.kind for end in free] == ["fan", "fan"]
    assert all(np.isfinite(end.profile.shares(np.linspace(0, 1, 5))).all() for end in touched)


def test_the_pole_of_a_cone_is_found_although_two_roots_meet_there():
    heights, grid, _ = contours("cone", 5.0)
    top = close_ends(heights, grid)[1]
    assert top.kind == "pole"
    assert top.height == pytest.approx(50.0, abs=0.01)


def test_a_touch_on_the_last_contour_makes_a_disc_there():
    heights, grid, _ = contours("cylinder", 5.0)
    bottom, top = close_ends(heights, grid, bottom=-45.0, top=44.9)
    assert (bottom.kind, bottom.height, bottom.uncovered) == ("flat", -45.0, 0.0)
    assert (top.kind, top.height) == ("flat", 45.0)


def test_a_section_that_is_not_seen_whole_from_its_middle_is_told():
    heights, grid, (low, high) = contours("cylinder", 5.0)
    angle = np.pi * np.linspace(0.0, 1.6, 40)
    arc = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    horseshoe = np.concatenate([30 * arc, 20 * arc[::-1]])
    kidneys = np.broadcast_to(horseshoe, (27, 80, 2))
    assert all(end.starlike for end in close_ends(heights, grid, bottom=low, top=high))
    assert not any(end.starlike for end in close_ends(heights, kidneys))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"heights": [0.0, 0.0, 1.0]}, "heights must ascend"),
        ({"heights": [], "grid": np.zeros((0, 4, 2))}, "heights must ascend, and be at least one"),
        ({"heights": [0.0, 1.0]}, r"grid must have shape \(2, any, 2\)"),
        ({"heights": [0.0, np.nan, 1.0]}, "heights must be finite"),
        ({"grid": np.zeros((3, 8, 2))}, "contours must have a width, got radius 0 in 3"),
        ({"noise": -1.0}, "noise must be 0 or more"),
        ({"noise": np.inf}, "noise must be 0 or more and finite"),
        ({"top": 0.5}, "top must not lie within the contours, got 0.5 where the last is at 2"),
        ({"bottom": 1.5}, "bottom must not lie within the contours"),
        ({"bottom": np.nan}, "bottom must be finite"),
    ],
)
def test_contours_that_have_no_ends_are_refused(change, words):
    angle = 2 * np.pi * np.arange(8) / 8
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    given = {"heights": [0.0, 1.0, 2.0], "grid": np.stack([ring] * 3), **change}
    with pytest.raises(ValueError, match=words):
        close_ends(**given)  # type: ignore[arg-type]


def test_far_beyond_the_contours_the_axis_leans_no_further():
    heights = np.linspace(0.0, 1.0, 9)
    turn = 2 * np.pi * np.arange(48) / 48
    ring = 0.3 * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    grid = ring + 0.5 * heights[:, None, None] * np.array([1.0, 0.0])
    near, far = (close_ends(heights, grid, bottom=-0.1, top=top)[1] for top in (1.2, 10.0))
    assert near.middle == pytest.approx([0.6, 0.0], abs=1e-9)
    assert far.middle == pytest.approx([1.0, 0.0], abs=1e-9)
    assert (near.unseen, far.unseen) == pytest.approx((0.2, 9.0))


HALF, GAP = 50.0, 0.5


def free_shoulder_contours(count: int) -> Floats:
    """Heights, the last one half a millimetre before the end."""
    return np.linspace(-HALF + GAP, HALF - GAP, count)


def rounded(depths: Floats, power: float = 10.0) -> Floats:
    """A box whose edges are rounded off."""
    return 30.0 * (1.0 - np.abs(depths / HALF) ** power) ** (1.0 / power)


@pytest.mark.parametrize("count", [20, 24, 27, 40])
def test_a_rounded_edge_tells_where_the_box_ends(count):
    depths = free_shoulder_contours(count)
    found = free_shoulder(depths, rounded(depths), 0.0)
    assert found == pytest.approx(GAP, abs=0.4 * GAP)


def test_noise_lets_it_be_told_as_well_as_it_can():
    depths = free_shoulder_contours(27)
    rng = np.random.default_rng(4)
    noisy = rounded(depths) + 0.02 * rng.normal(size=(30, 27))
    found = [free_shoulder(depths, radii, 0.02) for radii in noisy]
    told = np.array([GAP if one is None else abs(one - GAP) for one in found])
    assert np.sqrt(np.mean(told**2)) < 0.6 * GAP


def test_nothing_is_told_by_a_wall_a_cone_a_zigzag_or_few_contours():
    depths = free_shoulder_contours(27)
    wall, cone = np.full(27, 30.0), 30.0 - 0.2 * depths
    zigzag = (20.0 + 8.0 * np.sin(depths)) * np.sqrt(1.0 - (depths / 51.0) ** 2)
    assert free_shoulder(depths, wall, 0.0) is None
    assert free_shoulder(depths, cone, 0.0) is None
    assert free_shoulder(depths, zigzag, 0.0) is None
    assert free_shoulder(depths[-11:], rounded(depths[-11:]), 0.0) is None


def test_it_does_not_depend_on_the_unit():
    depths = free_shoulder_contours(27)
    near, far = (free_shoulder(s * depths, s * rounded(depths), 0.0) for s in (1.0, 1e-3))
    assert near is not None and far == pytest.approx(1e-3 * near, rel=1e-9)
