from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.shapes.deformed_superquadrics import (
    UNIT_BOUND,
    DeformedSuperquadric,
    DerivativeBound,
    Straightening,
    largest_curvature,
)
from palpate.core.shapes.global_deformations import Bend, Taper
from palpate.core.shapes.protocol import INSIDE, MISS
from palpate.core.shapes.superquadrics import Superquadric

SIZE = np.array([0.03, 0.02, 0.05])
ROUNDING = 1e-12  # Logarithm of the gauge within which rounding may decide whether a ray grazes


def warped(exponents, taper=(0.0, 0.0), curvature=0.0, azimuth=0.0):
    base = Superquadric(SIZE, np.array(exponents))
    return DeformedSuperquadric(base, np.array(taper), Bend(curvature, azimuth))


def random_solid(rng, oracle):
    """Any exponents, sizes, tapers nearly to a tip and bends nearly to a fold."""
    exponents = np.exp(rng.uniform(math.log(0.02), math.log(2.0), 2))
    size, azimuth = rng.uniform(0.01, 0.06, 3), rng.uniform(-4, 4)
    tapers = np.zeros(2), rng.uniform(-0.95, 0.95, 2), np.full(2, rng.uniform(-0.99, 0.99))
    taper = tapers[rng.integers(3)]
    base = Superquadric(size, exponents)
    bend = largest_curvature(base, taper, azimuth) * rng.choice([0, 1e-16, 0.3, -0.3, 1.0, -1.0])
    bend *= rng.uniform(0.5, 1.0)
    solid = DeformedSuperquadric(base, taper, Bend(bend, azimuth))
    return solid, oracle(size, exponents, tuple(taper), bend, azimuth)


def rays_at(solid, rng):
    """Rays at random places on the surface, through it, and just past it."""
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    surface = solid.mesh(3).vertices
    spread = np.repeat([0.0, 1e-5, 1e-3], 8)[:, None]
    targets = surface[rng.integers(len(surface), size=24)] + spread * rng.normal(size=(24, 3))
    return targets - rng.uniform(0.0, 0.15) * direction, direction


@pytest.mark.parametrize("trials", [12, pytest.param(60, marks=pytest.mark.slow)])
def test_rays_agree_with_bisection_in_extended_precision(oracle, trials):
    rng = np.random.default_rng(11)
    hits = inside = misses = 0
    for _ in range(trials):
        solid, wanted = random_solid(rng, oracle)
        origins, direction = rays_at(solid, rng)
        found, (ranges, least) = (
            solid.cast(origins, direction, 0.3),
            wanted.entries(origins, direction, 0.3),
        )
        clear = np.abs(least) > ROUNDING
        assert np.array_equal(np.isfinite(found)[clear], np.isfinite(ranges)[clear])
        apart = ~np.isfinite(found) & clear
        assert np.array_equal(found[apart], ranges[apart].astype(float))
        met = np.isfinite(found) & np.isfinite(ranges)
        assert np.abs(found[met] - ranges[met]).max(initial=0.0) < 1e-12
        hits += int(met.sum())
        inside += int((found == INSIDE).sum())
        misses += int((found == MISS).sum())
    assert min(hits - 15 * trials, inside - 1.5 * trials, misses - 0.3 * trials) > 0


@pytest.mark.parametrize("curvature", [0.0, 8.0, pytest.param(-8.0, marks=pytest.mark.slow)])
def test_chords_however_thin_are_found_and_gaps_however_thin_are_not_closed(curvature, oracle):
    solid = warped((0.7, 0.9), (0.5, 0.2), curvature, 0.4)
    wanted = oracle(SIZE, np.array([0.7, 0.9]), (0.5, 0.2), curvature, 0.4)
    rng = np.random.default_rng(3)
    place = solid.mesh(4).vertices[rng.integers(2562, size=40)]
    # Tangents: the normal is where the function grows.
    slopes = [solid.inside_out(place, np.tile(axis, (40, 1)))[1] for axis in np.eye(3)]
    normal = np.stack(slopes, axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    for at, out in zip(place, normal, strict=True):
        along = np.cross(out, rng.normal(size=3))
        along /= np.linalg.norm(along)
        depths = np.array([-1e-4, -1e-6, -1e-8, -1e-10, 1e-10, 1e-8, 1e-6, 1e-4])
        origins = at + depths[:, None] * out - 0.1 * along
        found, (ranges, least) = (
            solid.cast(origins, along, 0.3),
            wanted.entries(origins, along, 0.3),
        )
        clear = np.abs(least) > ROUNDING
        assert np.array_equal(np.isfinite(found)[clear], np.isfinite(ranges)[clear])
        met = np.isfinite(found) & np.isfinite(ranges) & clear
        assert np.abs(found[met] - ranges[met]).max(initial=0.0) < 1e-9


def test_a_tapered_side_that_a_ray_follows_is_missed_just_outside_and_met_just_inside():
    # The side of a tapered box is the plane x = 0.03 (1 + z / 0.1), nearly.
    solid = warped((0.02, 0.02), (0.5, 0.5))
    along = np.array([0.015, 0.0, 0.05]) / math.hypot(0.015, 0.05)
    out = np.array([along[2], 0.0, -along[0]])
    for aside in (1e-3, 1e-4, 1e-5):
        origins = np.array([0.0, 0.0, -0.05]) + 0.03 * np.array([1, 0, 0]) * 0.5
        origins = origins + np.array([[aside], [-aside]]) * out - 0.05 * along
        found = solid.cast(origins, along, 1.0)
        assert found[0] == MISS
        assert 0.049 < found[1] < 0.06


def test_the_function_bends_within_its_bounds(oracle):
    """The proof that no root is passed rests on them."""
    rng = np.random.default_rng(5)
    for _ in range(40):
        solid, _ = random_solid(rng, oracle)
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        dip, rise = solid._dip_and_rise(solid._axes.T @ direction)
        inner = solid.mesh(3).vertices  # on the surface, thus within the bent box
        step = 1e-4 * float(np.ptp(inner, axis=0).min())
        origins = inner - 0.5 * step * direction
        towards = np.broadcast_to(direction, origins.shape)
        first = solid.inside_out(origins, towards)[1]
        last = solid.inside_out(origins + step * direction, towards)[1]
        second = (last - first) / step
        slack = 1e-9 * np.abs(first).max() / step
        assert (second >= -1.01 * dip - slack).all()
        if solid._base.smoothness() < np.inf:
            assert (second <= 1.01 * rise + slack).all()


def test_a_bend_of_nothing_is_no_bend():
    straight, rng = warped((0.4, 0.7), (0.3, -0.2)), np.random.default_rng(0)
    origins = rng.uniform(-0.04, 0.04, (200, 3)) + np.array([0.2, 0.0, 0.0])
    towards = np.array([-1.0, 0.0, 0.0])
    wanted = straight.cast(origins, towards, 1.0)
    met = np.isfinite(wanted)
    assert met.sum() > 50
    for curvature in (1e-300, -1e-300, 1e-201, 1e-150, 1e-16, -1e-16, 1e-12):
        found = warped((0.4, 0.7), (0.3, -0.2), curvature, 2.0).cast(origins, towards, 1.0)
        assert np.array_equal(found[~met], wanted[~met])
        assert np.allclose(found[met], wanted[met], rtol=0, atol=1e-13)


def test_without_taper_and_bend_it_is_its_base():
    base, rng = Superquadric(SIZE, np.array([0.4, 0.7])), np.random.default_rng(0)
    origins = rng.uniform(-0.06, 0.06, (300, 3)) + np.array([0.0, 0.0, 0.2])
    towards = np.array([0.0, 0.0, -1.0])
    found = DeformedSuperquadric(base, np.zeros(2)).cast(origins, towards, 1.0)
    wanted = base.cast(origins, towards, 1.0)
    assert np.array_equal(np.isfinite(found), np.isfinite(wanted))
    met = np.isfinite(wanted)
    assert np.allclose(found[met], wanted[met], rtol=0, atol=1e-14)


def test_more_than_half_a_circle_is_cast_from_all_sides(oracle):
    size, exponents = np.array([0.01, 0.01, 0.1]), np.array([0.3, 1.0])
    base = Superquadric(size, exponents)
    solid = DeformedSuperquadric(base, np.zeros(2), Bend(27.0))
    wanted = oracle(size, exponents, (0.0, 0.0), 27.0)
    for angle in np.linspace(0, 2 * math.pi, 12, endpoint=False):
        towards = np.array([math.cos(angle), 0.0, math.sin(angle)])
        across = np.array([-towards[2], 0.0, towards[0]])
        offsets = np.linspace(-0.05, 0.05, 21)[:, None]
        origins = np.array([1 / 27.0, 1e-3, 0.0]) + offsets * across - 0.1 * towards
        found, (ranges, least) = (
            solid.cast(origins, towards, 0.3),
            wanted.entries(origins, towards, 0.3),
        )
        clear = np.abs(least) > ROUNDING
        assert np.array_equal(np.isfinite(found)[clear], np.isfinite(ranges)[clear])
        met = np.isfinite(found) & np.isfinite(ranges)
        assert np.abs(found[met] - ranges[met]).max(initial=0.0) < 1e-12


def test_a_ray_through_the_centre_of_curvature_meets_the_side_behind_it():
    solid = warped((1.0, 1.0), curvature=20.0)
    centre = np.array([1 / 20.0, 0.0, 0.0])
    towards = np.array([-1.0, 0.0, 0.0])
    origins = np.array([centre, centre + [0.0, 1e-9, 0.0], centre + [0.05, 0.0, 0.0]])
    found = solid.cast(origins, towards, 1.0)
    assert np.allclose(found, [0.02, 0.02, 0.07], rtol=0, atol=1e-12)


def test_a_ray_stops_at_its_reach():
    solid, towards = warped((1.0, 1.0), (0.2, 0.2), 5.0), np.array([-1.0, 0.0, 0.0])
    origin = np.array([[0.1, 0.0, 0.0]])
    assert solid.cast(origin, towards, 0.0699)[0] == MISS
    assert solid.cast(origin, towards, 0.0701)[0] == pytest.approx(0.07, abs=1e-14)
    assert solid.cast(origin, -towards, 1.0)[0] == MISS
    assert solid.cast(np.zeros((1, 3)), towards, 1e-9)[0] == INSIDE


@settings(max_examples=60, deadline=None)
@given(
    e1=st.floats(0.02, 2.0),
    e2=st.floats(0.02, 2.0),
    taper=st.tuples(st.floats(-0.9, 0.9), st.floats(-0.9, 0.9)),
    share=st.floats(-1.0, 1.0),
    azimuth=st.floats(-7.0, 7.0),
    seed=st.integers(0, 1 << 30),
)
def test_what_is_hit_is_on_the_surface_and_what_comes_before_is_outside(
    e1: float, e2: float, taper: tuple[float, float], share: float, azimuth: float, seed: int
) -> None:
    base = Superquadric(SIZE, np.array([e1, e2]))
    bend = share * largest_curvature(base, np.array(taper), azimuth)
    solid = DeformedSuperquadric(base, np.array(taper), Bend(bend, azimuth))
    origins, direction = rays_at(solid, np.random.default_rng(seed))
    found = solid.cast(origins, direction, 0.3)
    met = np.isfinite(found)
    for share_of_way in (0.1, 0.5, 0.9, 1.0 - 1e-9):
        before = origins[met] + (share_of_way * found[met])[:, None] * direction
        assert (solid.gauge(before) >= 1.0 - 1e-12).all()
    at = origins[met] + found[met, None] * direction
    assert np.allclose(solid.gauge(at), 1.0, rtol=0, atol=1e-11)
    farther = solid.cast(origins, direction, 0.6)
    assert np.array_equal(farther[met], found[met])
    nearer = solid.cast(origins, direction, 0.15)
    assert ((nearer == found) | ((nearer == MISS) & (found > 0.15))).all()


def test_the_mesh_is_closed_turned_outwards_and_on_the_surface(is_closed, signed_volume):
    solid = warped((0.4, 0.7), (0.5, -0.3), -9.0, 1.0)
    mesh = solid.mesh(4)
    assert is_closed(mesh)
    assert signed_volume(mesh) > 0.0
    assert np.allclose(solid.gauge(mesh.vertices), 1.0, atol=1e-13)


def test_a_bend_keeps_the_volume_of_what_is_symmetric(signed_volume):
    straight, bent = warped((0.4, 0.7)).mesh(6), warped((0.4, 0.7), curvature=12.0).mesh(6)
    assert signed_volume(bent) == pytest.approx(signed_volume(straight), rel=1e-4)


@pytest.mark.parametrize("curvature", [0.0, 10.0, -10.0, 24.0])
@pytest.mark.parametrize("azimuth", [0.0, 0.7, math.pi / 2, 4.0])
def test_the_enclosure_holds_the_solid_and_is_not_much_larger(curvature, azimuth):
    solid = warped((0.1, 0.1), (0.1, -0.2), curvature, azimuth)
    low, high = solid.enclosure()
    smallest, largest = solid.bounds()
    assert (low <= smallest).all()
    assert (high >= largest).all()
    assert (high - low <= 2.0 * (largest - smallest)).all()


def test_a_tapered_solid_is_exactly_as_high_as_its_base():
    assert warped((1.0, 1.0), (0.3, 0.3)).bounds()[:, 2].tolist() == [-0.05, 0.05]


@pytest.mark.parametrize("share", [1.001, -1.001, math.inf, math.nan])
def test_a_bend_that_folds_is_refused_with_what_would_be_right(share):
    base = Superquadric(SIZE, np.ones(2))
    most = largest_curvature(base, np.zeros(2), 0.0)
    assert most == pytest.approx(0.98 / 0.03)
    words = "bend must" if math.isfinite(share) else "finite curvature"
    if math.isfinite(share):
        words = rf"bend must lie between -{most:.4g} and {most:.4g} 1/m, or this solid folds"
    with pytest.raises(ValueError, match=words):
        DeformedSuperquadric(base, np.zeros(2), Bend(share * most))


def test_the_largest_bend_leaves_the_axis_open_and_the_inner_side_some_length():
    slim = Superquadric(np.array([0.001, 0.001, 0.1]), np.ones(2))
    assert largest_curvature(slim, np.zeros(2), 0.0) == pytest.approx(0.98 * math.pi / 0.1)
    wide = Superquadric(np.array([0.03, 0.01, 0.01]), np.array([1.0, 2.0]))
    assert largest_curvature(wide, np.zeros(2), 0.0) == pytest.approx(0.98 / 0.03)
    assert largest_curvature(wide, np.zeros(2), math.pi / 2) == pytest.approx(0.98 / 0.01)
    # In between a square reaches as far as its corner shows, a diamond as its nearer side.
    assert largest_curvature(wide, np.zeros(2), math.pi / 4) == pytest.approx(
        0.98 * math.sqrt(2) / 0.03
    )
    assert largest_curvature(wide, np.array([0.5, 0.0]), 0.0) == pytest.approx(0.98 / 0.045)


def test_a_taper_that_collapses_a_section_is_refused():
    with pytest.raises(ValueError, match="taper must lie between -1 and 1"):
        warped((1.0, 1.0), (1.0, 0.0))


# Half edges of a box that holds the tapered solids below, however it is turned.
HALF = np.array([0.03, 0.03, 0.05])
CASES = [
    ((0.0, 0.0), 0.0, 0.0),
    ((0.4, 0.4), 0.0, 0.0),
    ((0.3, -0.2), 0.0, 0.0),
    ((0.0, 0.0), 12.0, 0.7),
    ((0.3, 0.3), -12.0, 2.0),
    ((0.4, -0.3), 20.0, -1.0),
]


def turned(azimuth):
    cosine, sine = math.cos(azimuth), math.sin(azimuth)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def places_within(bend, count):
    """Places (3, n) of the bent box, in the bend's own frame."""
    straight = np.random.default_rng(0).uniform(-HALF, HALF, (count, 3))
    return Bend(bend.curvature)(straight).T


@pytest.mark.parametrize(("taper", "curvature", "azimuth"), CASES)
def test_the_curve_is_the_straightened_place_times_the_width(taper, curvature, azimuth):
    bend = Bend(curvature, azimuth)
    places = places_within(bend, 50)
    curve = Straightening(SIZE, np.array(taper), bend).along(places, np.ones(3))
    world = (turned(azimuth) @ places).T
    straight = Taper(*taper, SIZE[2]).inverse(bend.inverse(world)) / SIZE
    assert np.allclose(curve.place / curve.width, straight.T, rtol=0, atol=1e-13)


@pytest.mark.parametrize(("taper", "curvature", "azimuth"), CASES)
def test_slopes_are_right_and_values_slopes_and_curves_within_their_bounds(
    taper, curvature, azimuth
):
    straightening = Straightening(SIZE, np.array(taper), Bend(curvature, azimuth))
    places = places_within(straightening.bend, 3000)
    rng, step = np.random.default_rng(1), 1e-6
    for direction in [*np.eye(3), *rng.normal(size=(20, 3))]:
        direction = direction / np.linalg.norm(direction)
        ahead = straightening.along(places + step * direction[:, None], direction)
        back = straightening.along(places - step * direction[:, None], direction)
        here = straightening.along(places, direction)
        assert np.allclose((ahead.place - back.place) / (2 * step), here.slope, atol=1e-5)
        place_bounds, width_bound, least_width = straightening.bound(direction, HALF)
        curves = (ahead.slope - back.slope) / (2 * step)
        for value, slope, curve, most in zip(
            here.place, here.slope, curves, place_bounds, strict=True
        ):
            for some, limit in zip((value, slope, curve), most, strict=True):
                assert np.abs(some).max() <= limit * (1 + 1e-9) + 1e-5
        width = np.broadcast_to(here.width, len(places.T))
        assert width.max() <= width_bound.value * (1 + 1e-12)
        assert width.min() >= least_width * (1 - 1e-12)


coefficients = st.lists(st.floats(-5, 5), min_size=1, max_size=4)
T = np.linspace(-1.0, 1.0, 201)


def bound_of(polynomial):
    values = [float(np.abs(polynomial.deriv(n)(T)).max()) for n in (1, 2)]
    return DerivativeBound(float(np.abs(polynomial(T)).max()), *values)


@given(coefficients, coefficients, st.floats(-3, 3))
def test_products_sums_and_multiples_stay_within_their_bounds(
    first: list[float], second: list[float], factor: float
) -> None:
    f, g = np.polynomial.Polynomial(first), np.polynomial.Polynomial(second)
    for made, bound in (
        (f * g, bound_of(f).times(bound_of(g))),
        (f + g, bound_of(f).plus(bound_of(g))),
        (factor * f, bound_of(f).scaled(factor)),
    ):
        for have, most in zip(bound_of(made), bound, strict=True):
            assert have <= most * (1 + 1e-12) + 1e-12


def test_one_times_anything_is_that():
    some = DerivativeBound(2.0, 3.0, 4.0)
    assert UNIT_BOUND.times(some) == some


LONG = Superquadric(np.array([0.01, 0.012, 0.06]), np.array([0.5, 0.8]))
SOLIDS = {
    "tapered": DeformedSuperquadric(LONG, np.array([0.5, -0.4])),
    "bent": DeformedSuperquadric(LONG, np.zeros(2), Bend(30.0, 0.4)),
    "both": DeformedSuperquadric(LONG, np.array([0.3, 0.3]), Bend(-20.0, 2.0)),
    "octahedral": DeformedSuperquadric(
        Superquadric(np.full(3, 0.03), np.full(2, 2.0)), np.array([0.8, 0.1])
    ),
    "nearly a ring": DeformedSuperquadric(
        LONG, np.zeros(2), Bend(largest_curvature(LONG, np.zeros(2), 0.0), 0.0)
    ),
}
every = pytest.mark.parametrize("name", SOLIDS)


@every
def test_spans_are_where_the_function_is_negative(name):
    solid, rng = SOLIDS[name], np.random.default_rng(3)
    low, high = solid.enclosure()
    ways = np.linspace(0.0, 0.3, 601)
    for direction in (*np.eye(3), *rng.normal(size=(3, 3))):
        towards = direction / np.linalg.norm(direction)
        origins = rng.uniform(low, high, (40, 3)) - rng.choice([0.0, 0.15], (40, 1)) * towards
        spans = solid.spans(origins, towards)
        points = (origins[:, None] + ways[:, None] * towards).reshape(-1, 3)
        level = solid.gauge(points).reshape(40, -1) - 1.0
        within = ((spans[..., :1] <= ways) & (ways <= spans[..., 1:])).any(axis=1)
        clear = np.abs(level) > 1e-6
        assert (within == (level <= 0.0))[clear].all()
        assert np.array_equal(spans[:, 0, 0] == INSIDE, level[:, 0] <= 0.0)


@every
def test_the_first_span_begins_where_a_ray_is_cast(name):
    solid, rng = SOLIDS[name], np.random.default_rng(4)
    low, high = solid.enclosure()
    towards = np.array([0.48, -0.6, 0.64])
    origins = rng.uniform(low, high, (60, 3)) - 0.1 * towards
    spans, ranges = solid.spans(origins, towards)[:, 0, 0], solid.cast(origins, towards, 1.0)
    met = ranges < 1.0
    assert met.any()
    assert np.array_equal(np.isfinite(spans), met)
    assert np.allclose(spans[met], ranges[met], rtol=0, atol=1e-11)


def test_a_ray_through_both_arms_of_a_bent_bar_has_two_spans():
    spans = SOLIDS["nearly a ring"].spans(np.array([[0.03, 0.0, 0.1]]), np.array([0.0, 0.0, -1.0]))
    assert np.isfinite(spans[0]).all(axis=1).sum() == 2
