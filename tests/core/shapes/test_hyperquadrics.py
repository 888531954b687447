from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.arrays import Floats
from palpate.core.shapes.hyperquadrics import (
    LARGEST,
    MOST_TERMS,
    Dent,
    Hyperquadric,
    line_above,
    line_below,
    power_slopes,
    powers,
    range_of_powers,
    range_of_slopes,
)
from palpate.core.shapes.protocol import INSIDE, MISS
from palpate.core.shapes.superquadrics import Superquadric

SIZE = np.array([0.04, 0.03, 0.05])
AXES = np.column_stack([np.diag(1 / SIZE), np.zeros(3)])
SLANTED = np.array([[1, 1, 1, 0.1], [1, -1, 1, 0], [1, 1, -1, -0.1], [-1, 1, 1, 0.2]]) / 0.05


SLANTED[:, 3] *= 0.05


BOTH = np.concatenate([AXES, SLANTED])
DOWN = np.array([0.0, 0.0, -1.0])


def dent(depth, *exponents):
    planes = np.array([[60.0, 0.0, 0.0, -2.4], [0.0, 50.0, 0.0, 0.0], [0.0, 0.0, 40.0, 0.3]])
    return Dent(depth, planes, np.array(exponents))


SOLIDS = {
    "box": Hyperquadric(AXES, np.array([8.0, 3.0, 30.0])),
    "octahedron": Hyperquadric(AXES, np.ones(3)),
    "cut box": Hyperquadric(BOTH, np.array([12.0, 2, 5, 1, 4, 9, 60])),
    "star": Hyperquadric(AXES, np.array([0.5, 0.6, 0.8])),
    "creased": Hyperquadric(BOTH, np.array([4.0, 4, 4, 0.7, 0.9, 0.7, 0.5])),
    "dented": Hyperquadric(AXES, np.array([4.0, 3, 6]), (dent(0.8, 2, 2, 4),)),
    "swollen": Hyperquadric(AXES, np.array([4.0, 3, 6]), (dent(-0.8, 2, 3, 2), dent(0.3, 2, 2, 2))),
    "sharply dented": Hyperquadric(AXES, np.array([4.0, 0.8, 2]), (dent(0.9, 1, 0.6, 1.5),)),
}
solids = pytest.mark.parametrize("name", SOLIDS)


def level_of(solid):
    """H less 1 by its definition, in extended precision."""
    wide = np.longdouble

    def forms(planes, points):
        planes = planes.astype(wide)
        return points @ planes[:, :3].T + planes[:, 3]

    def level(points):
        total = (np.abs(forms(solid._planes, points)) ** solid._exponents.astype(wide)).sum(axis=-1)
        for one in solid._dents:
            sum_ = (np.abs(forms(one.planes, points)) ** one.exponents.astype(wide)).sum(axis=-1)
            total = total + one.depth * np.exp(-sum_)
        return total - 1

    return level


@solids
def test_casts_pass_nothing(name, cast_check):
    solid, rng, met = SOLIDS[name], np.random.default_rng(7), 0
    for number in range(6):
        towards = rng.normal(size=3) if number % 3 else np.eye(3)[number // 3]
        towards /= np.linalg.norm(towards)
        places = solid.enclosure().mean(axis=0) + rng.uniform(-0.5, 0.5, (30, 3)) * SIZE
        origins = places - rng.choice([0.0, 0.12], 30)[:, None] * towards
        met += cast_check(solid, level_of(solid), origins, towards, 0.25)
    assert met > 12


@given(
    exponent=st.sampled_from([0.3, 0.8, 1.0, 2.0, 5.0, 50.0]),
    shift=st.tuples(*[st.floats(-0.02, 0.02)] * 3),
    scale=st.floats(0.2, 20.0),
    seed=st.integers(0, 99),
)
@settings(derandomize=True, deadline=None, max_examples=25)
def test_shift_scale_and_mirror_carry_over_to_the_ranges(
    exponent: float, shift: tuple[float, ...], scale: float, seed: int
) -> None:
    planes = AXES + np.array([0.0, 0.0, 0.0, 0.1])
    moved = planes.copy()
    moved[:, :3] /= scale
    moved[:, 3] -= moved[:, :3] @ np.array(shift)
    one, other = (Hyperquadric(p, np.full(3, exponent)) for p in (planes, moved))
    rng = np.random.default_rng(seed)
    towards = rng.normal(size=3)
    towards /= np.linalg.norm(towards)
    origins = rng.uniform(-0.6, 0.6, (60, 3)) * SIZE - 0.1 * towards
    wanted = one.cast(origins, towards, 1.0)
    found = other.cast(scale * origins + shift, towards, scale)
    both = np.isfinite(wanted) & np.isfinite(found)
    assert (np.isfinite(wanted) == np.isfinite(found)).mean() > 0.98  # but for grazing rays
    assert np.allclose(found[both] / scale, wanted[both], rtol=0, atol=1e-9)
    middle = -planes[:, 3] / np.diag(planes)
    mirrored = one.cast(2 * middle - origins, -towards, 1.0)
    assert np.allclose(mirrored[both], wanted[both], rtol=0, atol=1e-12)


def test_three_equal_powers_are_a_superquadric():
    for power in (1.0, 1.6, 5.0, 20.0):
        one = Hyperquadric(AXES, np.full(3, power))
        other = Superquadric(SIZE, np.full(2, 2.0 / power))
        rng = np.random.default_rng(3)
        towards = rng.normal(size=3)
        towards /= np.linalg.norm(towards)
        origins = rng.uniform(-1, 1, (500, 3)) * SIZE - 0.2 * towards
        found, wanted = one.cast(origins, towards, 1.0), other.cast(origins, towards, 1.0)
        assert np.array_equal(np.isfinite(found), np.isfinite(wanted))
        met = np.isfinite(found)
        assert np.allclose(found[met], wanted[met], rtol=0, atol=1e-13)


def test_an_ellipsoid_is_met_where_it_is_starts_inside_and_misses_are_told():
    ball = Hyperquadric(np.column_stack([np.eye(3) / 0.03, [0.0, 0, 0]]), np.full(3, 2.0))
    origins = np.array([[0, 0, 0.1], [0.018, 0, 0.1], [0, 0, 0.02], [0.031, 0, 0.1], [0, 0, -0.1]])
    found = ball.cast(origins, DOWN, 1.0)
    assert np.allclose(found[:2], [0.07, 0.076], rtol=0, atol=1e-15)
    assert found[2] == INSIDE
    assert (found[3:] == MISS).all()
    assert ball.cast(origins[:1], DOWN, 0.0699)[0] == MISS
    grazing = ball.cast(np.array([[0.03 * (1 + 1e-9), 0, 0.1]]), DOWN, 1.0)
    assert grazing[0] == MISS
    on = ball.cast(np.array([[0.0, 0.0, 0.03 + 1e-15]]), -DOWN, 1.0)
    assert on[0] == MISS


@solids
def test_meshes_are_closed_and_lie_on_the_surface(name, is_closed, signed_volume):
    solid = SOLIDS[name]
    mesh = solid.mesh(4)
    assert is_closed(mesh)
    assert signed_volume(mesh) > 0.0
    level = solid.inside_out(mesh.vertices, np.zeros_like(mesh.vertices))[0]
    assert np.abs(level).max() < 1e-9
    low, high = solid.enclosure()
    assert (mesh.vertices >= low - 1e-12).all()
    assert (mesh.vertices <= high + 1e-12).all()


def test_the_tips_of_a_star_are_in_its_mesh():
    assert np.allclose(SOLIDS["star"].bounds(), [-SIZE, SIZE], rtol=0, atol=1e-12)


@solids
def test_slopes_are_derivatives_and_finite_in_creases(name):
    solid, rng = SOLIDS[name], np.random.default_rng(5)
    points, ways = rng.uniform(-0.8, 0.8, (200, 3)) * SIZE, rng.normal(size=(200, 3))
    step = 1e-9
    there, back = (solid.inside_out(points + s * step * ways, ways)[0] for s in (1, -1))
    value, slope = solid.inside_out(points, ways)
    assert np.median(np.abs(slope - (there - back) / (2 * step))) < 1e-4 * np.abs(slope).max()
    assert np.allclose(value, level_of(solid)(points.astype(np.longdouble)).astype(float))
    for crease in (np.zeros((1, 3)), np.array([[0.0, 0.01, 0.0]])):
        assert np.isfinite(solid.inside_out(crease, np.ones((1, 3)))).all()
    assert np.isfinite(solid.inside_out(np.full((1, 3), 10.0), np.ones((1, 3)))).all()


@solids
def test_spans_begin_and_end_where_the_solid_does(name):
    solid, rng = SOLIDS[name], np.random.default_rng(11)
    towards = rng.normal(size=3)
    towards /= np.linalg.norm(towards)
    origins = rng.uniform(-0.6, 0.6, (40, 3)) * SIZE - rng.choice([0, 0.1], 40)[:, None] * towards
    spans = solid.spans(origins, towards)
    ways = np.linspace(0.0, 0.25, 801)
    level = level_of(solid)(origins[:, None] + ways[:, None] * towards)
    within = ((ways >= spans[..., :1]) & (ways <= spans[..., 1:])).any(axis=1)
    clear = np.abs(level) > 1e-5
    assert (within == (level <= 0))[clear].all()
    assert np.array_equal(spans[:, 0, 0] == INSIDE, level[:, 0] <= 0)


@pytest.mark.parametrize(
    ("planes", "exponents", "sentence"),
    [
        (AXES[:2], [2, 2], "planes must face in three independent directions"),
        (AXES[[0, 0, 1]], [2, 2, 2], "or the solid is unbounded"),
        (
            np.concatenate([AXES, AXES + [0, 0, 0, 1.5]]),
            [2] * 6,
            "nowhere below 1, the least that was found is 3.37",
        ),
        (np.tile(BOTH, (4, 1)), [2] * 28, f"planes must be at most {MOST_TERMS}, got 28"),
        (AXES, [2, 2, 0.0], "exponents must lie between 0.1 and 100"),
        (AXES[:, :3], [2, 2, 2], r"planes must have shape \(any, 4\)"),
    ],
)
def test_what_is_empty_or_unbounded_is_refused(planes, exponents, sentence):
    with pytest.raises(ValueError, match=sentence):
        Hyperquadric(planes, np.array(exponents))


def test_a_solid_far_from_the_origin_is_found():
    far = AXES - np.array([[0, 0, 0, 250.0], [0, 0, 0, 0], [0, 0, 0, 0]])
    assert np.allclose(
        Hyperquadric(far, np.full(3, 2.0)).enclosure(), [[9.96, -0.03, -0.05], [10.04, 0.03, 0.05]]
    )


def test_what_is_too_thin_to_be_meshed_is_refused():
    # Six planes through nearly one point, with powers that leave a speck about it.
    normals = np.concatenate([np.eye(3), np.eye(3) + 0.5]) / 0.04
    planes = np.column_stack([normals, [0.0, 0.0, 0.0, 1e-7, 0.0, 0.0]])
    with pytest.raises(ValueError, match="planes leave so little inside that a grid of 16 cells"):
        Hyperquadric(planes, np.full(6, 0.15))


def test_a_solid_that_is_far_longer_than_wide_is_bounded():
    thin = np.column_stack([np.diag([1e6, 1.0, 1e-6]), np.zeros(3)])
    low, high = Hyperquadric(thin, np.full(3, 2.0)).enclosure()
    assert np.allclose(high - low, [2e-6, 2.0, 2e6], rtol=1e-12)


PLANES = np.array([[40.0, 0.0, 0.0, -1.0], [0.0, 30.0, 10.0, 0.5]])
ALONG = np.linspace(0.0, 1.0, 801)


def value(dent, h):
    found: Floats = dent.depth * np.exp(-(np.abs(h) ** dent.exponents[:, None]).sum(axis=0))
    return found


@given(
    depth=st.sampled_from([2.0, 0.5, -0.7]),
    exponents=st.tuples(*[st.sampled_from([0.3, 1.0, 1.5, 2.0, 3.0, 6.0])] * 2),
    h=st.tuples(*[st.floats(-2.0, 2.0)] * 2),
    rate=st.tuples(*[st.floats(-40.0, 40.0)] * 2),
    length=st.floats(1e-3, 0.1),
)
@settings(derandomize=True, deadline=None, max_examples=50)
def test_lines_and_the_dip_hold(
    depth: float, exponents: tuple[float], h: tuple[float], rate: tuple[float], length: float
) -> None:
    dent = Dent(depth, PLANES, np.array(exponents))
    here, rates, lengths = np.array(h)[:, None], np.array(rate)[:, None], np.array([length])
    way = length * ALONG
    values = value(dent, here + rates * way)
    low, high = (dent.line(here, rates, lengths, below=below) for below in (True, False))
    assert (values >= values[0] - low.gap[0] + low.slope[0] * way - 1e-12).all()
    assert (values <= values[0] + high.gap[0] + high.slope[0] * way + 1e-12).all()
    bends = np.diff(values, 2) / (length / 800) ** 2
    assert bends.min() >= -dent.dip(rates) * (1 + 1e-6) - 1e-3


def test_the_slope_is_the_derivative():
    dent = Dent(-0.7, PLANES, np.array([2.0, 3.0]))
    h, rate = np.array([[0.4, -1.0], [0.3, 0.8]]), np.array([[5.0, -2.0], [1.0, 7.0]])
    numeric = (value(dent, h + 1e-6 * rate) - value(dent, h - 1e-6 * rate)) / 2e-6
    found = dent.along(h, rate)
    assert np.allclose(found[0], value(dent, h), rtol=1e-14)
    assert np.allclose(found[1], numeric, rtol=1e-8)


def test_the_dip_of_a_round_dent_is_exact_and_a_crease_has_none():
    rate = np.array([[3.0], [4.0]])
    assert Dent(0.5, PLANES, np.full(2, 2.0)).dip(rate) == pytest.approx(0.5 * 2 * 25)
    assert Dent(0.5, PLANES, np.array([2.0, 1.9])).dip(rate) == math.inf


@pytest.mark.parametrize(
    ("depth", "planes", "exponents", "sentence"),
    [
        (math.nan, PLANES, [2, 2], "depth must be finite, got nan"),
        (1.0, np.zeros((0, 4)), [], "planes must be at least one, got none"),
        (1.0, PLANES, [2], r"exponents must have shape \(2\)"),
        (1.0, PLANES, [2, 0.05], "exponents must lie between 0.1 and 100"),
        (1.0, PLANES, [2, 101], "exponents must lie between 0.1 and 100"),
        (1.0, np.full((2, 4), np.inf), [2, 2], "planes must be finite"),
        (1.0, PLANES * [[1], [0]], [2, 2], r"planes\[1\] must face somewhere: .* long, got 0"),
        (1.0, PLANES * [[1e-300], [1]], [2, 2], r"planes\[0\] must face somewhere"),
    ],
)
def test_what_cannot_be_is_refused(depth, planes, exponents, sentence):
    with pytest.raises(ValueError, match=sentence):
        Dent(depth, planes, np.array(exponents))


few = settings(derandomize=True, deadline=None, max_examples=50)
case = given(
    h=st.one_of(st.just(0.0), st.floats(-2.0, 2.0)),
    rate=st.floats(-50.0, 50.0),
    exponent=st.sampled_from([0.1, 0.5, 0.9, 1.0, 1.5, 2.0, 8.0, 40.0]),
    length=st.floats(1e-3, 0.1),
)
ALONG_POWERS = np.linspace(0.0, 1.0, 501)


def seen(h, rate, exponent, length):
    found: np.ndarray = np.abs(h + rate * length * ALONG_POWERS) ** exponent
    return found


@case
@few
def test_lines_stay_below_and_above(h, rate, exponent, length):
    one = np.array([[h]]), np.array([[rate]]), np.array([[exponent]]), np.array([length])
    values = seen(h, rate, exponent, length)
    room = 1e-12 * (1 + values.max())
    low, high = line_below(*one), line_above(*one)
    way = length * ALONG_POWERS
    assert (values >= values[0] - low.gap[0] + low.slope[0] * way - room).all()
    assert (values <= values[0] + high.gap[0] + high.slope[0] * way + room).all()


@case
@few
def test_ranges_hold_all_that_is_seen(h, rate, exponent, length):
    one = np.array([[h]]), np.array([[rate]]), np.array([[exponent]]), np.array([length])
    values = seen(h, rate, exponent, length)
    least, most = range_of_powers(*one)[:, 0, 0]
    assert least <= values.min() * (1 + 1e-12)
    assert values.max() <= most * (1 + 1e-12)
    low, high = range_of_slopes(*one)[:, 0, 0]
    slopes = np.diff(values) / (length / 500)
    room = 1e-9 * (1 + np.abs(slopes).max())
    assert low - room <= slopes.min()
    assert slopes.max() <= high + room


def test_slopes_are_derivatives_and_finite_in_a_cusp():
    h, rate = np.array([[0.7, -0.3, 0.0, 1.2]]), np.full((1, 4), -3.0)
    for exponent in (0.5, 1.0, 3.0):
        g = np.array([[exponent]])
        numeric = (powers(h + 1e-6 * rate, g) - powers(h - 1e-6 * rate, g)) / 2e-6
        assert np.allclose(power_slopes(h, rate, g), numeric, rtol=1e-6, atol=1e-6)
    assert power_slopes(np.zeros((1, 1)), np.ones((1, 1)), np.array([[0.1]]))[0, 0] == 0.0


def test_no_power_overflows():
    huge, g = np.array([[1e300]]), np.array([[100.0]])
    assert powers(huge, g)[0, 0] == pytest.approx(LARGEST**100)
    assert np.isfinite(power_slopes(huge, np.array([[1.0]]), g)).all()


def test_a_line_from_a_cusp_upwards_has_a_gap_and_no_slope():
    line = line_above(np.zeros((1, 1)), np.ones((1, 1)), np.array([[0.5]]), np.array([0.04]))
    assert line.slope[0, 0] == 0.0
    assert line.gap[0, 0] == pytest.approx(0.2)
