"""Boolean combinations: sharp edges, facets, enclosures, R-functions."""

import math
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core import shapes
from palpate.core.shapes import INSIDE, MISS

# The R-functions of the text have parameters that the solids leave alone.
from palpate.core.shapes.boolean_solids import (
    complement,
    conjunction,
    conjunction_slopes,
    disjunction,
    disjunction_slopes,
)
from tests.core.shapes import definitions
from tests.core.shapes.definitions import DOWN

R = 0.03
UPPER = shapes.HalfSpace(DOWN, 0.0)


def ball(x: float = 0.0, y: float = 0.0, z: float = 0.0, radius: float = R) -> shapes.PosedSolid:
    return definitions.ball(x, y, z, radius).solid


def block(*corner: float) -> shapes.Polyhedron:
    return definitions.block([0.0, 0.0, 0.0], corner).solid


def test_blocks_that_touch_are_one_with_sharp_edges():
    upper = shapes.difference(block(0.04, 0.04, 0.05), block(0.05, 0.05, 0.02))
    whole = shapes.BooleanShape(shapes.Union((block(0.04, 0.04, 0.02), upper)))
    origins = np.array([[0.01, 0.01, 0.02], [0.01, 0.01, 0.06], [0.04 - 1e-9, 0.01, 0.06]])
    result = whole.cast(np.concatenate([origins, [[0.04 + 1e-9, 0.01, 0.06]]]), DOWN, 1.0)
    assert result[0] == INSIDE and result[3] == MISS
    assert result[1:3] == pytest.approx([0.01, 0.01], abs=1e-15)
    spans = whole.spans(origins[1:2], DOWN)[0]
    spans = spans[np.isfinite(spans[:, 0])]
    assert spans[0, 0] == pytest.approx(0.01) and spans[-1, 1] == pytest.approx(0.06)
    assert np.allclose(spans[1:, 0], spans[:-1, 1])  # no gap between


def test_facets_are_small_on_planes_and_few_on_many_solids():
    vertices, faces = shapes.BooleanShape(block(0.05, 0.04, 0.03)).mesh(4)
    sides = np.linalg.norm(vertices[faces] - np.roll(vertices[faces], 1, axis=1), axis=2)
    assert sides.max() <= 2.0 * math.hypot(0.05, 0.04, 0.03) / 16
    few, many, most = (
        shapes.BooleanShape(shapes.Union(tuple(ball(0.1 * i) for i in range(n)))).mesh(3)
        for n in (7, 8, 32)
    )
    assert len(many.faces) < 0.3 * len(few.faces) and len(most.faces) < 1.2 * len(many.faces)


def test_enclosures_are_cut_by_half_spaces_and_complements():
    outer = [shapes.complement_of(ball(x)) for x in (-0.02, 0.02)]
    lens = shapes.complement_of(shapes.Union(tuple(outer)))
    walls = np.array([[1, 1, 0], [-1, 1, 0], [0, -1, 0]], float)
    first, second, third = (shapes.HalfSpace(normal, 0.02) for normal in walls)
    pairs = shapes.Intersection((first, second)), shapes.Intersection((third, ball()))
    prism = shapes.Intersection(pairs)
    slab = shapes.difference(ball(), shapes.Union((UPPER, shapes.HalfSpace(-DOWN, -0.01))))
    turned = shapes.complement_of(shapes.complement_of(shapes.difference(ball(), UPPER)))
    for tree, box in (
        (lens, [[-0.01, -R, -R], [0.01, R, R]]),
        (prism, [[-R, -0.02, -R], [R, 0.02 * math.sqrt(2), R]]),
        (slab, [[-R, -R, -0.01], [R, R, 0.0]]),
        (turned, [[-R, -R, -R], [R, R, 0.0]]),
        (shapes.Intersection((ball(), shapes.complement_of(UPPER))), [[-R, -R, -R], [R, R, 0.0]]),
        (shapes.Union((ball(-0.02), ball(0.02))), [[-0.05, -R, -R], [0.05, R, R]]),
    ):
        assert np.allclose(shapes.BooleanShape(tree).enclosure(), box, rtol=0, atol=1e-12)
    part = ball()
    assert shapes.complement_of(shapes.complement_of(part)) is part
    vertices = shapes.BooleanShape(lens).mesh(4).vertices
    assert vertices[:, 0].max() == pytest.approx(0.01, rel=1e-2)


OMEGAS = [1.0, 0.5, 0.0, -0.5, -1.0 + 1e-12]
EDGES = [0.0, 1e8, -1e8, 1e-8, -1e-8, 1.0, -1.0, 1.0 + 1e-12]
VALUES = st.one_of(st.floats(-10, 10), st.floats(-1e200, 1e200), st.sampled_from(EDGES))


def is_near(result: Any, wanted: Any) -> bool:
    if abs(wanted) < 1e-300:
        return abs(float(result)) < 1e-299
    return bool(abs(mpmath.mpf(float(result)) / wanted - 1) < 4e-15)


@settings(derandomize=True, deadline=None, max_examples=25)
@given(VALUES, VALUES, st.sampled_from(OMEGAS), st.integers(0, 2))
def test_r_functions_have_all_digits_and_the_signs_of_logic(f1, f2, omega, smoothness):
    both, either = conjunction(f1, f2, omega), disjunction(f1, f2, omega)
    with mpmath.workdps(900):
        a, b, w = mpmath.mpf(f1), mpmath.mpf(f2), mpmath.mpf(omega)
        root = mpmath.sqrt(a * a + b * b - 2 * w * a * b)
        assert is_near(both, (a + b - root) / (1 + w))
        assert is_near(either, (a + b + root) / (1 + w))
        if root:
            wanted = (1 - (a - w * b) / root) / (1 + w), (1 - (b - w * a) / root) / (1 + w)
            for result, slope in zip(conjunction_slopes(f1, f2, omega), wanted, strict=True):
                assert is_near(result, slope)
    assert both == complement(disjunction(complement(f1), complement(f2), omega))  # De Morgan
    assert both == conjunction(f2, f1, omega)
    both = conjunction(f1, f2, omega, smoothness=smoothness)
    either = disjunction(f1, f2, omega, smoothness=smoothness)
    assert np.isfinite([both, either]).all()
    assert (both > 0.0, both < 0.0) == (f1 > 0.0 and f2 > 0.0, f1 < 0.0 or f2 < 0.0)
    assert (either > 0.0, either < 0.0) == (f1 > 0.0 or f2 > 0.0, f1 < 0.0 and f2 < 0.0)
    slopes = conjunction_slopes(f1, f2, omega, smoothness=smoothness)
    assert np.isfinite([*slopes, *disjunction_slopes(f1, f2, omega, smoothness=smoothness)]).all()


@pytest.mark.parametrize("omega", OMEGAS[:-1])
@pytest.mark.parametrize("smoothness", [0, 1, 2])
def test_slopes_of_r_functions_are_those_of_differences(omega, smoothness):
    rng, step = np.random.default_rng(1), 1e-5
    f1, f2 = rng.uniform(0.2, 2.0, (2, 500)) * rng.choice([-1.0, 1.0], (2, 500))
    keep = np.abs(np.abs(f1) - np.abs(f2)) > 1e-3  # with omega 1 there is an edge
    f1, f2 = f1[keep], f2[keep]
    for function, slopes in ((conjunction, conjunction_slopes), (disjunction, disjunction_slopes)):
        result = slopes(f1, f2, omega, smoothness=smoothness)
        for slope, d1, d2 in zip(result, (step, 0.0), (0.0, step), strict=True):
            ahead = function(f1 + d1, f2 + d2, omega, smoothness=smoothness)
            back = function(f1 - d1, f2 - d2, omega, smoothness=smoothness)
            assert np.allclose(slope, (ahead - back) / (2 * step), rtol=1e-5, atol=1e-7)
    times = (f1**2 + f2**2) ** (smoothness / 2)
    smooth = conjunction(f1, f2, omega, smoothness=smoothness)
    assert np.allclose(smooth, conjunction(f1, f2, omega) * times, rtol=1e-13)


def test_r_functions_at_their_limits():
    f1, f2 = np.random.default_rng(0).normal(size=(2, 1000))
    assert np.allclose(conjunction(f1, f2, 1.0), np.minimum(f1, f2), rtol=1e-14, atol=0)
    assert np.allclose(disjunction(f1, f2, 1.0), np.maximum(f1, f2), rtol=1e-14, atol=0)
    # What leaves the range of numbers stays at its end, with its sign.
    largest = np.finfo(float).max
    assert conjunction([1e200, -1e200], 1e200, smoothness=1).tolist() == [largest, -largest]
    assert 0.0 < conjunction(1e-200, 1e-200, smoothness=1) < 1e-300
    for smoothness in (2, 50):
        assert conjunction(0.0, 1e200, smoothness=smoothness) == 0.0
        assert disjunction(0.0, -1e200, smoothness=smoothness) == 0.0
    # Where both vanish, slopes are the middle of those around.
    turn = 2 * np.pi * np.arange(400) / 400
    for omega in (-0.5, 0.0, 0.7, 1.0):
        around = conjunction_slopes(np.cos(turn), np.sin(turn), omega)[0]
        middle = pytest.approx(0.5 * (around.min() + around.max()), rel=1e-3)
        assert conjunction_slopes(0.0, 0.0, omega) == (middle, middle)
    assert conjunction_slopes(0.0, 0.0, smoothness=1) == (0.0, 0.0)
