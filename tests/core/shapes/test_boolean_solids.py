from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.arrays import Floats
from palpate.core.geometry.meshes import is_closed
from palpate.core.shapes.boolean_solids import (
    BooleanShape,
    Complement,
    Intersection,
    Tree,
    Union,
    complement,
    complement_of,
    conjunction,
    conjunction_slopes,
    difference,
    disjunction,
    disjunction_slopes,
    tree_enclosure,
    tree_leaves,
    tree_membership,
    unbounded_part,
)
from palpate.core.shapes.deformed_superquadrics import DeformedSuperquadric
from palpate.core.shapes.generalised_cylinders import GeneralisedCylinder, SplineSection
from palpate.core.shapes.global_deformations import Bend
from palpate.core.shapes.half_spaces import HalfSpace
from palpate.core.shapes.hyperquadrics import Dent, Hyperquadric
from palpate.core.shapes.polyhedra import Polyhedron
from palpate.core.shapes.protocol import INSIDE, MISS, PosedSolid
from palpate.core.shapes.superquadrics import Superquadric

DOWN, R = np.array([0.0, 0.0, -1.0]), 0.03
UPPER = HalfSpace(np.array([0.0, 0.0, -1.0]), 0.0)


def ball(x=0.0, y=0.0, z=0.0, radius=R):
    return PosedSolid(
        Superquadric(np.full(3, radius), np.ones(2)), np.array([x, y, z, 0.0, 0.0, 0.0, 1.0])
    )


def block(x, y, z):
    """The box from the origin to a corner, out of half-spaces alone."""
    faces = [HalfSpace(n, 0.0) for n in -np.eye(3)]
    return Intersection(
        (*faces, *(HalfSpace(n, s) for n, s in zip(np.eye(3), (x, y, z), strict=True)))
    )


def union_of(pairs):
    return Union(tuple(Union((ball(), ball(0.01))) for _ in range(pairs)))


def nested(levels):
    tree: Tree = ball()
    for _ in range(levels):
        tree = Complement(tree)
    return tree


DENTED = Hyperquadric(
    np.column_stack([np.eye(3) / 0.04, np.zeros(3)]),
    np.full(3, 4.0),
    (Dent(1.0, np.array([[50.0, 0, 0, -2.0], [0, 50, 0, 0], [0, 0, 50, 0]]), np.full(3, 2.0)),),
)
TREES: dict[str, Tree] = {
    "union": Union((ball(-0.02), ball(0.02), ball(0.0, 0.03))),
    "lens": Intersection((ball(-0.02), ball(0.02))),
    "bite": difference(ball(), ball(0.02, 0.01)),
    "cut": difference(ball(), UPPER),
    "block": block(0.05, 0.04, 0.03),
    "nested": difference(Union((ball(-0.02), ball(0.02))), Intersection((ball(), UPPER))),
    "dented": difference(
        DENTED,
        GeneralisedCylinder(
            SplineSection(np.array([0.02, 0.012, 0.02, 0.012])),
            np.array([-0.1, 0.0, 0.1]),
            np.array([1.0, 0.5, 1.0]),
        ),
    ),
}
every = pytest.mark.parametrize("name", TREES)


def membership(tree, points):
    """Least or largest of the leaves' functions: the definition."""
    if isinstance(tree, Complement):
        return -membership(tree.part, points)
    if isinstance(tree, (Union, Intersection)):
        choose = np.minimum if isinstance(tree, Union) else np.maximum
        return choose.reduce([membership(part, points) for part in tree.parts])
    flat = np.asarray(points, float).reshape(-1, 3)
    return tree.inside_out(flat, np.zeros_like(flat))[0].reshape(points.shape[:-1])


@every
def test_casts_pass_nothing(name, cast_check):
    tree, rng, met = TREES[name], np.random.default_rng(4), 0
    shape = BooleanShape(tree)
    low, high = shape.enclosure()
    for number in range(6):
        towards = rng.normal(size=3) if number % 2 else np.eye(3)[number // 2]
        towards /= np.linalg.norm(towards)
        origins = rng.uniform(low, high, (40, 3)) - rng.choice([0, 0.12], 40)[:, None] * towards
        met += cast_check(shape, lambda points: membership(tree, points), origins, towards, 0.3)
    assert met > 40


def test_two_balls_together_are_met_where_the_nearer_one_is():
    shape = BooleanShape(Union((ball(-0.02), ball(0.02))))
    places = np.linspace(-0.0551, 0.0549, 45)
    origins = np.column_stack([places, np.zeros(45), np.full(45, 0.1)])
    away = np.minimum(np.abs(places - 0.02), np.abs(places + 0.02))
    with np.errstate(invalid="ignore"):
        wanted = np.where(away <= R, 0.1 - np.sqrt(R**2 - away**2), MISS)
    assert np.allclose(shape.cast(origins, DOWN, 1.0), wanted, rtol=0, atol=1e-15)
    inside = shape.cast(np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0299]]), DOWN, 1.0)
    assert (inside == INSIDE).all()
    assert shape.cast(origins[:1] + [0.01, 0, 0], DOWN, 0.05)[0] == MISS


def test_a_ball_within_a_ball_leaves_a_hollow():
    shape = BooleanShape(difference(ball(), ball(radius=0.01)))
    found = shape.cast(np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.0], [0.0, 0.0, 0.02]]), DOWN, 1.0)
    assert np.allclose(found[:2], [0.07, 0.01], rtol=0, atol=1e-15)
    assert found[2] == INSIDE
    spans = shape.spans(np.array([[0.0, 0.0, 0.1]]), DOWN)[0]
    assert np.allclose(spans[:2], [[0.07, 0.09], [0.11, 0.13]], rtol=0, atol=1e-15)


def test_two_blocks_that_touch_are_one():
    lower, upper = block(0.04, 0.04, 0.02), block(0.04, 0.04, 0.05)
    whole = BooleanShape(Union((lower, difference(upper, block(0.05, 0.05, 0.02)))))
    assert whole.cast(np.array([[0.01, 0.01, 0.02]]), DOWN, 1.0)[0] == INSIDE
    assert whole.cast(np.array([[0.01, 0.01, 0.06]]), DOWN, 1.0)[0] == pytest.approx(0.01)
    spans = whole.spans(np.array([[0.01, 0.01, 0.06]]), DOWN)[0]
    spans = spans[np.isfinite(spans[:, 0])]
    assert spans[0, 0] == pytest.approx(0.01)
    assert np.allclose(spans[1:, 0], spans[:-1, 1])  # no gap between


def test_edges_stay_sharp():
    shape = BooleanShape(TREES["block"])
    near = np.array([0.05 - 1e-9, 0.05 + 1e-9])
    found = shape.cast(np.column_stack([near, [0.02] * 2, [0.1] * 2]), DOWN, 1.0)
    assert found[0] == pytest.approx(0.07, abs=1e-15)
    assert found[1] == MISS


def test_volumes_of_meshes_tend_to_the_closed_forms(signed_volume):
    height = R - 0.02
    cap = math.pi * height**2 * (3 * R - height) / 3
    whole = 4 / 3 * math.pi * R**3
    wanted = {"lens": 2 * cap, "cut": whole / 2, "block": 0.05 * 0.04 * 0.03}
    for name, volume in wanted.items():
        found = signed_volume(BooleanShape(TREES[name]).mesh(5))
        assert found == pytest.approx(volume, rel=2e-3)
    both = signed_volume(BooleanShape(Union((ball(-0.02), ball(0.02)))).mesh(5))
    assert both == pytest.approx(2 * whole - 2 * cap, rel=2e-3)


@every
def test_meshes_are_closed_within_the_enclosure_and_on_the_surface(name):
    from palpate.core.geometry.meshes import is_closed, is_inside_out

    shape = BooleanShape(TREES[name])
    mesh = shape.mesh(4)
    assert is_closed(mesh.faces)
    assert not is_inside_out(*mesh)
    low, high = shape.enclosure()
    assert ((mesh.vertices >= low - 1e-9) & (mesh.vertices <= high + 1e-9)).all()
    assert np.abs(membership(TREES[name], mesh.vertices)).max() < 0.02


@every
def test_the_function_has_the_sign_of_the_definition_and_its_slope(name):
    shape, rng = BooleanShape(TREES[name]), np.random.default_rng(9)
    low, high = shape.enclosure()
    points, ways = rng.uniform(low - 0.01, high + 0.01, (300, 3)), rng.normal(size=(300, 3))
    value, slope = shape.inside_out(points, ways)
    wanted = membership(TREES[name], points)
    clear = np.abs(wanted) > 1e-9
    assert np.array_equal(value[clear] > 0, wanted[clear] > 0)
    step = 1e-9
    there, back = (shape.inside_out(points + s * ways, ways)[0] for s in (step, -step))
    assert np.quantile(np.abs(slope - (there - back) / (2 * step)), 0.95) < 1e-3


@given(
    places=st.lists(st.tuples(*[st.floats(-0.03, 0.03)] * 3), min_size=3, max_size=3),
    kind=st.integers(0, 3),
)
@settings(derandomize=True, deadline=None, max_examples=25)
def test_balls_however_combined_have_the_spans_of_the_definition(
    places: list[tuple[float, float, float]], kind: int
) -> None:
    a, b, c = (ball(*place) for place in places)
    tree = (
        Union((a, b, c)),
        Union((a, Intersection((b, c)))),
        Union((difference(a, b), c)),
        difference(Union((a, b)), complement_of(complement_of(c)), UPPER),
    )[kind]
    assume_there = membership(tree, np.random.default_rng(0).uniform(-0.06, 0.06, (4000, 3)))
    if not (assume_there < -0.05).any():
        return
    origins = np.random.default_rng(1).uniform(-0.05, 0.05, (30, 3)) + [0, 0, 0.1]
    spans = BooleanShape(tree).spans(origins, DOWN)
    ways = np.linspace(0.0, 0.25, 401)
    level = membership(tree, origins[:, None] + ways[:, None] * DOWN)
    within = ((ways >= spans[..., :1]) & (ways <= spans[..., 1:])).any(axis=1)
    assert (within == (level <= 0))[np.abs(level) > 1e-9].all()


@pytest.mark.parametrize(
    ("tree", "sentence"),
    [
        (complement_of(ball()), "the complement that is the tree is unbounded"),
        (Union((ball(), UPPER)), r"the half-space that is union\[1\] of the tree is unbounded"),
        (
            Union((ball(), Union((ball(), complement_of(ball()))))),
            r"the complement that is union\[1\] of union\[1\] of the tree is unbounded",
        ),
        (difference(UPPER, ball()), "the intersection that is the tree is unbounded"),
        (UPPER, "the half-space that is the tree is unbounded"),
        (Intersection((ball(), ball(0.2))), "the tree leaves nothing"),
        (Intersection((ball(), ball(0.05, 0.05))), "the tree leaves nothing"),
        (difference(ball(), ball(radius=0.04)), "the tree leaves nothing"),
        (union_of(33), "the tree must have at most 64 parts in all"),
        (nested(2000), "the tree must have at most 64 parts in all"),
        (Intersection((UPPER, HalfSpace(DOWN, -1.0), HalfSpace(-DOWN, -1.0), ball())), "nothing"),
    ],
)
def test_what_is_unbounded_or_empty_is_refused(tree, sentence):
    with pytest.raises(ValueError, match=sentence):
        BooleanShape(tree)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Union((ball(),)), "union must have at least 2 parts, got 1"),
        (lambda: Intersection(()), "intersection must have at least 2 parts, got 0"),
        (lambda: difference(ball()), "difference must have at least 2 parts, got 1"),
    ],
)
def test_too_few_parts_are_refused(make, sentence):
    with pytest.raises(ValueError, match=sentence):
        make()


def test_what_complements_and_nesting_bound_is_bounded():
    lens = complement_of(Union((complement_of(ball(-0.02)), complement_of(ball(0.02)))))
    assert np.allclose(tree_enclosure(lens), [[-0.01, -R, -R], [0.01, R, R]])
    assert BooleanShape(lens).bounds()[1, 0] == pytest.approx(0.01, rel=1e-3)
    walls = [HalfSpace(np.array(n, float), 0.02) for n in ([1, 1, 0], [-1, 1, 0], [0, -1, 0])]
    prism = Intersection((Intersection((walls[0], walls[1])), Intersection((walls[2], ball()))))
    assert np.allclose(tree_enclosure(prism), [[-R, -0.02, -R], [R, 0.02 * math.sqrt(2), R]])
    slab = difference(ball(), Union((UPPER, HalfSpace(DOWN * -1.0, -0.01))))
    assert np.allclose(tree_enclosure(slab)[:, 2], [-0.01, 0.0])


def test_facets_are_small_on_planes_too():
    vertices, faces = BooleanShape(TREES["block"]).mesh(4)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    longest = max(np.linalg.norm(one - two, axis=1).max() for one, two in ((a, b), (b, c), (c, a)))
    assert longest <= 2.0 * math.hypot(0.05, 0.04, 0.03) / 16


def test_many_solids_have_no_more_facets_than_a_few():
    few, many = (
        BooleanShape(Union(tuple(ball(0.1 * i) for i in range(n)))).mesh(5) for n in (7, 8)
    )
    assert len(many.faces) < 0.3 * len(few.faces)


def test_half_spaces_cut_the_enclosure():
    box: Floats = tree_enclosure(difference(ball(), UPPER))
    assert np.allclose(box, [[-R, -R, -R], [R, R, 0.0]])
    assert np.allclose(tree_enclosure(TREES["block"]), [[0, 0, 0], [0.05, 0.04, 0.03]])


def test_a_leaf_whose_tessellation_is_open_is_refused():
    class Open(PosedSolid):
        def mesh(self, level):
            vertices, faces = super().mesh(level)
            return vertices, faces[1:]

    pierced = Open(Superquadric(np.full(3, R), np.ones(2)), np.array([0.0, 0, 0, 0, 0, 0, 1]))
    with pytest.raises(ValueError, match="a leaf's tessellation is not closed"):
        BooleanShape(Union((pierced, ball())))


STRAIGHT_DOWN = np.array([0.0, 0.0, -1.0])
CORNERS = 0.04 * np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
SQUARES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def test_polyhedra_and_warped_superquadrics_are_combined():
    box = Polyhedron(CORNERS, SQUARES)
    pear = DeformedSuperquadric(
        Superquadric(np.array([0.02, 0.02, 0.03]), np.ones(2)), np.array([0.3, 0.3]), Bend(5.0)
    )
    ball = PosedSolid(
        Superquadric(np.full(3, 0.01), np.ones(2)), np.array([0.04, 0.04, 0.04, 0, 0, 0, 1.0])
    )
    shape = BooleanShape(difference(box, pear, ball))
    rng = np.random.default_rng(6)
    points = rng.uniform(-0.005, 0.045, (400, 3))
    level = shape.inside_out(points, np.zeros_like(points))[0]
    for towards in (STRAIGHT_DOWN, np.array([0.48, 0.6, 0.64])):
        inside = shape.cast(points, towards, 1.0) == INSIDE
        assert np.array_equal(inside, level < 0.0)
    vertices, faces = shape.mesh(4)
    assert is_closed(faces)
    assert np.abs(shape.inside_out(vertices, vertices)[0]).max() < 0.02


A, B, C = (Superquadric(np.full(3, 0.01 * n), np.ones(2)) for n in (1, 2, 3))
UP = HalfSpace(np.array([0.0, 0.0, 1.0]), 0.02)


def test_leaves_come_in_the_order_of_the_tree():
    tree = Union((difference(A, B, UP), Complement(C)))
    found = list(tree_leaves(tree))
    assert found[:2] == [A, B]
    assert isinstance(found[2], HalfSpace)
    assert found[3] is C


def test_the_complement_of_a_complement_is_the_part_and_a_half_space_is_turned():
    assert complement_of(complement_of(A)) is A
    turned = complement_of(UP)
    assert isinstance(turned, HalfSpace)
    assert turned.normal.tolist() == [0.0, 0.0, -1.0]
    assert turned.offset == -0.02


def test_membership_is_that_of_sets():
    a, b, c = np.array([[bool(n & bit) for bit in (1, 2, 4)] for n in range(8)]).T
    cases = (
        (Union((A, B, C)), a | b | c),
        (Intersection((A, B, C)), a & b & c),
        (difference(A, B, C), a & ~b & ~c),
        (Union((Complement(A), Intersection((B, Complement(C))))), ~a | (b & ~c)),
    )
    for tree, wanted in cases:
        assert np.array_equal(tree_membership(tree, iter([a, b, c])), wanted)


def test_the_part_that_makes_a_tree_unbounded_is_named():
    assert (
        unbounded_part(Union((A, Complement(B)))) == "the complement that is union[1] of the tree"
    )
    assert unbounded_part(UP) == "the half-space that is the tree"


OMEGAS = [1.0, 0.5, 0.0, -0.5, -1.0 + 1e-12]
VALUES = st.one_of(
    st.floats(-10.0, 10.0),
    st.floats(-1e200, 1e200),
    st.sampled_from([0.0, 1e8, -1e8, 1e-8, -1e-8, 1.0, -1.0, 1.0 + 1e-12]),
)


def exact(f1, f2, omega, sign):
    with mpmath.workdps(900):
        a, b, w = mpmath.mpf(f1), mpmath.mpf(f2), mpmath.mpf(omega)
        root = mpmath.sqrt(a * a + b * b - 2 * w * a * b)
        return (a + b + sign * root) / (1 + w)


def close(found, wanted):
    if abs(wanted) < 1e-300:
        return abs(float(found)) < 1e-299
    return bool(abs(mpmath.mpf(float(found)) / wanted - 1) < 2e-15)


@settings(derandomize=True, deadline=None, max_examples=50)
@given(VALUES, VALUES, st.sampled_from(OMEGAS))
def test_values_are_those_of_the_definition_to_the_last_digits(
    f1: float, f2: float, omega: float
) -> None:
    assert close(conjunction(f1, f2, omega), exact(f1, f2, omega, -1))
    assert close(disjunction(f1, f2, omega), exact(f1, f2, omega, 1))


@settings(derandomize=True, deadline=None, max_examples=50)
@given(VALUES, VALUES, st.sampled_from(OMEGAS), st.integers(0, 2))
def test_the_signs_are_those_of_the_boolean_operations(
    f1: float, f2: float, omega: float, smoothness: int
) -> None:
    both = conjunction(f1, f2, omega, smoothness=smoothness)
    either = disjunction(f1, f2, omega, smoothness=smoothness)
    assert np.isfinite([both, either]).all()
    assert (both > 0.0) == (f1 > 0.0 and f2 > 0.0)
    assert (both < 0.0) == (f1 < 0.0 or f2 < 0.0)
    assert (either > 0.0) == (f1 > 0.0 or f2 > 0.0)
    assert (either < 0.0) == (f1 < 0.0 and f2 < 0.0)


@settings(derandomize=True, deadline=None, max_examples=50)
@given(VALUES, VALUES, st.sampled_from(OMEGAS))
def test_the_laws_of_de_morgan_hold_to_the_bit(f1: float, f2: float, omega: float) -> None:
    assert conjunction(f1, f2, omega) == complement(
        disjunction(complement(f1), complement(f2), omega)
    )
    assert conjunction(f1, f2, omega) == conjunction(f2, f1, omega)


def test_with_omega_1_they_are_minimum_and_maximum():
    f1, f2 = np.random.default_rng(0).normal(size=(2, 1000))
    assert np.allclose(conjunction(f1, f2, 1.0), np.minimum(f1, f2), rtol=1e-14, atol=0)
    assert np.allclose(disjunction(f1, f2, 1.0), np.maximum(f1, f2), rtol=1e-14, atol=0)


@pytest.mark.parametrize("omega", OMEGAS[:-1])
@pytest.mark.parametrize("smoothness", [0, 1, 2])
@pytest.mark.parametrize(
    ("function", "slopes"),
    [
        (conjunction, conjunction_slopes),
        (disjunction, disjunction_slopes),
    ],
)
def test_slopes_are_those_of_the_values(function, slopes, omega, smoothness):
    rng = np.random.default_rng(1)
    f1, f2 = rng.uniform(0.2, 2.0, (2, 500)) * rng.choice([-1.0, 1.0], (2, 500))
    # With omega 1 there is an edge where the two are equal, or opposite in the difference.
    keep = np.abs(np.abs(f1) - np.abs(f2)) > 1e-3
    f1, f2, step = f1[keep], f2[keep], 1e-5
    one, two = slopes(f1, f2, omega, smoothness=smoothness)

    def value(a, b):
        return function(a, b, omega, smoothness=smoothness)

    central = (value(f1 + step, f2) - value(f1 - step, f2)) / (2 * step)
    assert np.allclose(one, central, rtol=1e-5, atol=1e-7)
    central = (value(f1, f2 + step) - value(f1, f2 - step)) / (2 * step)
    assert np.allclose(two, central, rtol=1e-5, atol=1e-7)


@settings(derandomize=True, deadline=None, max_examples=50)
@given(VALUES, VALUES, st.sampled_from(OMEGAS))
def test_a_small_slope_keeps_its_digits(f1: float, f2: float, omega: float) -> None:
    with mpmath.workdps(900):
        a, b, w = mpmath.mpf(f1), mpmath.mpf(f2), mpmath.mpf(omega)
        root = mpmath.sqrt(a * a + b * b - 2 * w * a * b)
        if root == 0:
            return
        wanted = (1 - (a - w * b) / root) / (1 + w)
    found = conjunction_slopes(f1, f2, omega)[0]
    assert abs(float(found) - wanted) <= 4e-15 * abs(wanted) + 1e-300


def test_where_both_vanish_the_slopes_are_the_middle_of_those_around():
    turn = 2 * np.pi * np.arange(400) / 400
    for omega in (-0.5, 0.0, 0.7, 1.0):
        around = conjunction_slopes(np.cos(turn), np.sin(turn), omega)
        for part, found in zip(around, conjunction_slopes(0.0, 0.0, omega), strict=True):
            assert found == pytest.approx(0.5 * (part.min() + part.max()), rel=1e-3)
    assert conjunction_slopes(0.0, 0.0, smoothness=1) == (0.0, 0.0)


def test_the_smooth_forms_multiply_by_a_power_of_both():
    f1, f2 = np.random.default_rng(2).normal(size=(2, 100))
    for k in (1, 2, 3):
        times = (f1**2 + f2**2) ** (k / 2)
        assert np.allclose(conjunction(f1, f2, smoothness=k), conjunction(f1, f2) * times)
        assert np.allclose(disjunction(f1, f2, smoothness=k), disjunction(f1, f2) * times)


def test_a_value_that_leaves_the_range_of_floats_keeps_its_sign():
    assert conjunction(1e200, 1e200, smoothness=1) == np.finfo(float).max
    assert conjunction(-1e200, 1e200, smoothness=1) == -np.finfo(float).max
    assert 0.0 < conjunction(1e-200, 1e-200, smoothness=1) < 1e-300


@pytest.mark.parametrize("smoothness", [2, 50])
def test_where_one_value_is_none_and_the_other_huge_there_is_no_nan(smoothness):
    assert conjunction(0.0, 1e200, smoothness=smoothness) == 0.0
    assert disjunction(0.0, -1e200, smoothness=smoothness) == 0.0


def test_arrays_broadcast():
    column, row = np.arange(3.0)[:, None], np.arange(4.0)
    assert conjunction(column, row).shape == (3, 4)
    assert all(part.shape == (3, 4) for part in conjunction_slopes(column, row))


@pytest.mark.parametrize("omega", [-1.0, 1.0 + 1e-12, math.nan])
def test_an_omega_out_of_range_is_refused(omega):
    with pytest.raises(ValueError, match=f"omega must be above -1 and at most 1, got {omega}"):
        conjunction(1.0, 1.0, omega)


def test_a_negative_smoothness_is_refused():
    with pytest.raises(ValueError, match="smoothness must be 0 or more, got -1"):
        disjunction(1.0, 1.0, smoothness=-1)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_values_that_are_not_finite_are_refused(value):
    with pytest.raises(ValueError, match="f2 must be finite"):
        disjunction(1.0, [1.0, value])
    with pytest.raises(ValueError, match="f must be finite"):
        complement(value)


def test_a_large_and_a_small_value_an_omega_near_its_end_huge_values_and_none_keep_all_digits():
    # As printed, the difference of two numbers near 1e8 leaves 1.49e-8.
    assert conjunction(1e8, 1e-8) == pytest.approx(1e-8, rel=1e-15)
    assert disjunction(-1e8, -1e-8) == pytest.approx(-1e-8, rel=1e-15)
    # As omega nears -1 the conjunction nears f1 f2 / (f1 + f2), 0 over 0 as printed.
    assert conjunction(0.3, 0.5, -1.0 + 1e-12) == pytest.approx(0.15 / 0.8, rel=1e-11)
    assert conjunction(1e200, 1e200) == pytest.approx((2 - math.sqrt(2)) * 1e200, rel=1e-15)
    assert conjunction(0.0, 0.0) == 0.0 == disjunction(0.0, 0.0)
    for omega in (-1.0 + 1e-12, 0.0, 1.0):
        for pair in ((0.0, 0.0), (1e200, 1e-200), (1e8, -1e-8), (3e-310, 3e-310)):
            slopes = [*conjunction_slopes(*pair, omega), *disjunction_slopes(*pair, omega)]
            assert np.isfinite(slopes).all()
