from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.arrays import Floats
from palpate.core.plane.inscribed_ellipse import ellipse_scale
from palpate.core.rebuild.thesis.program_search import searched_scale

Figure = Callable[[str, int], Floats]


def isint(line: tuple[float, float, float], d: Floats, center: Floats) -> bool:
    """isint.m."""
    a, b, c = line
    p, q = d
    xc, yc = center
    if a == 0:
        return bool(q >= abs(-c / b - yc))
    if b == 0:
        return bool(p >= abs(-c / a - xc))
    return bool(q * q * b * b + p * p * a * a >= (a * xc + b * yc + c) ** 2)


def buildgrid(polygon: Floats, center: Floats, half: Floats, n: int) -> float:
    """The search of buildgrid.m, line by line, with b1 for its second a1."""
    cpx, cpy = polygon.T
    dcpx, dcpy = np.diff([*cpx, cpx[0]]), np.diff([*cpy, cpy[0]])
    fib = [1.0, 1.0]
    for _ in range(48):
        fib.append(fib[-1] + fib[-2])
    a, b, tol, maxit, count = 1e-6, 1.0, 1e-6, 50, 1
    while abs(b - a) > tol and count < maxit - 1:
        y1 = y2 = 0
        for i in range(n):
            line = (dcpy[i], dcpx[i], cpy[i] * dcpx[i] - cpx[i] * dcpy[i])
            y1 += isint(line, a * half, center)
            y2 += isint(line, b * half, center)
        a1 = a + fib[maxit - count - 2] / fib[maxit - count] * (b - a)
        b1 = a + fib[maxit - count - 1] / fib[maxit - count] * (b - a)
        if y1 > 0 and y2 > 0:
            b = a1
        elif y2 > 0:
            a, b = a1, b1
        elif y1 == 0:
            a = b1
        count += 1
    return 0.5 * (a + b)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.integers(0, 10**6), st.integers(1, 9))
def test_the_search_is_that_of_the_program(seed: int, edges: int) -> None:
    rng = np.random.default_rng(seed)
    polygon = rng.uniform(-1, 1, (9, 2))
    middle, half = rng.uniform(-0.3, 0.3, 2), rng.uniform(0.2, 1.0, 2)
    assert searched_scale(polygon, middle, half, edges) == pytest.approx(
        buildgrid(polygon, middle, half, edges), abs=1e-9
    )


def test_the_search_ends_at_one_of_a_few_numbers_whatever_the_polygon() -> None:
    scales = set()
    for width in np.linspace(0.65, 0.95, 31):
        box = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]]) * [width, 1.0]
        scales.add(round(searched_scale(box, np.zeros(2), np.ones(2), 4), 3))
        assert ellipse_scale(box, np.zeros(2), np.ones(2)) == pytest.approx(width)
    assert scales == {0.618}


def test_an_edge_without_length_is_no_line() -> None:
    box = np.array([[-1, -1], [-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    assert np.isfinite(searched_scale(box, np.zeros(2), np.ones(2), 1))
