from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.arrays import Floats
from palpate.core.splines.basis import Basis, clamped_basis
from palpate.core.splines.collocation import interpolable, interpolate
from palpate.core.splines.knots import averaged_knots
from palpate.core.splines.tensor import evaluate_grid

RNG = np.random.default_rng(5)


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_curves_surfaces_and_solids_go_through_their_values(axes: int) -> None:
    sites = [np.sort(RNG.random(n)) for n in (7, 5, 6)[:axes]]
    bases = [Basis(averaged_knots(places, 3), 3) for places in sites]
    values = RNG.normal(size=(*(len(places) for places in sites), 2))
    found = interpolate(bases, sites, values)
    assert np.allclose(evaluate_grid(bases, found.control, sites), values, rtol=0, atol=1e-10)
    assert found.condition >= 1.0


def test_a_polynomial_of_the_degree_is_found_again() -> None:
    basis = clamped_basis(9, 3)
    sites = basis.greville()
    found = interpolate([basis], [sites], (sites**3 - sites)[:, None])
    x = np.linspace(0.0, 1.0, 50)
    assert np.allclose(basis.matrix(x) @ found.control, (x**3 - x)[:, None], rtol=0, atol=1e-14)


def test_the_condition_is_that_of_the_whole_system() -> None:
    bases = [clamped_basis(5), clamped_basis(6)]
    sites = [basis.greville() for basis in bases]
    whole = np.kron(*(b.matrix(x).toarray() for b, x in zip(bases, sites, strict=True)))
    found = interpolate(bases, sites, np.zeros((5, 6, 1)))
    assert found.condition == pytest.approx(np.linalg.cond(whole))


@given(st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6, unique=True))
@settings(derandomize=True, deadline=None, max_examples=50)
def test_what_counts_as_interpolable_is_what_has_a_solution(places: list[float]) -> None:
    basis, sites = clamped_basis(6), np.sort(places)
    if np.diff(sites).min() < 1e-3:
        return  # the system is regular, but only just
    regular = np.linalg.cond(basis.matrix(sites).toarray()) < 1e15
    assert interpolable(basis, sites) is bool(regular)


@pytest.mark.parametrize(
    "sites",
    [[0, 0.2, 0.4, 0.6, 1], [0, 0.2, 0.2, 0.4, 0.7, 1], [0, 0.1, 0.2, 0.25, 0.3, 0.32]],
)
def test_sites_that_determine_no_spline_are_refused(sites: list[float]) -> None:
    assert not interpolable(clamped_basis(6), np.array(sites))
    with pytest.raises(ValueError, match="sites of axis 0 must be 6, increase, and lie"):
        interpolate([clamped_basis(6)], [np.array(sites)], np.zeros((len(sites), 1)))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.zeros((5, 1)), r"values must have shape \(6, any\)"),
        (np.full((6, 1), math.nan), "values must be finite"),
    ],
)
def test_values_that_do_not_fit_are_refused(values: Floats, words: str) -> None:
    basis = clamped_basis(6)
    with pytest.raises(ValueError, match=words):
        interpolate([basis], [basis.greville()], values)


def test_sites_outside_are_refused() -> None:
    with pytest.raises(ValueError, match="x must lie in the domain"):
        interpolable(clamped_basis(4), np.array([0.0, 0.3, 0.6, 1.2]))
    with pytest.raises(ValueError, match="sites must be finite"):
        interpolable(clamped_basis(4), np.array([0.0, 0.3, 0.6, math.inf]))


def test_axes_without_sites_are_refused() -> None:
    basis = clamped_basis(4)
    with pytest.raises(ValueError, match="sites must be given for 2 axes, got 1"):
        interpolate([basis, basis], [basis.greville()], np.zeros((4, 1)))
