from __future__ import annotations

import numpy as np
import pytest

from palpate.core.rebuild.lattice.section import Section, fit_section, layers_of, rim_of
from palpate.core.rebuild.recovery.report import Recovery
from palpate.core.rebuild.side.lofting import fit_contour_loft
from palpate.core.splines.bases import PeriodicBasis

TURNS = np.arange(96) / 96
AZIMUTH = 2 * np.pi * TURNS


def superellipse(exponent: float, a: float, b: float, angle: float = 0.0) -> np.ndarray:
    places = rim_of(exponent, AZIMUTH)[0]
    places = (a * places.real + 1j * b * places.imag) * np.exp(1j * angle)
    return np.column_stack([places.real, places.imag])


def around(section: Section) -> np.ndarray:
    """The rim in the plane."""
    return section.middle + (2 * section.rim(TURNS) - 1) @ section.axes


@pytest.mark.parametrize("exponent", [1.0, 0.45, 0.2])
@pytest.mark.parametrize("angle", [0.0, 0.6, 1.3])
def test_a_superellipse_is_its_own_section(exponent, angle):
    curve = superellipse(exponent, 0.5, 0.3, angle) + [0.1, -0.2]
    section = fit_section(np.stack([curve, curve]))
    assert np.allclose(around(section), curve, rtol=0, atol=0.02)
    assert section.exponent == pytest.approx(exponent, abs=0.15)


def test_an_ellipse_is_met_exactly_at_its_own_turns():
    curve = superellipse(1.0, 0.5, 0.2, 0.4)
    section = fit_section(curve[None])
    assert np.allclose(around(section), curve, rtol=0, atol=2e-3)
    assert np.sort(section.half_extent) == pytest.approx([0.2, 0.5], rel=1e-2)


def test_layers_that_turn_and_shrink_and_points_keep_the_shape():
    curve = superellipse(0.33, 0.5, 0.4)
    turns = [(np.cos(a), np.sin(a)) for a in np.linspace(0.0, 3.0, 7)]
    layers = [curve @ np.array([[c, s], [-s, c]]) * (1 + 0.2 * s) for c, s in turns]
    section = fit_section(np.stack([np.zeros_like(curve), *layers]))
    assert section.exponent == pytest.approx(0.33, abs=0.15)
    ratio = section.half_extent.max() / section.half_extent.min()
    assert ratio == pytest.approx(1.25, rel=0.05)


def test_a_curve_that_runs_back_and_forth_in_azimuth_is_walked_forwards():
    bend = 1.9 * np.sin(AZIMUTH)
    width = 0.52 + 0.16 * np.cos(AZIMUTH)
    kidney = np.column_stack([width * np.cos(bend), width * np.sin(bend)])
    section = fit_section(kidney[None])
    places = section.rim(np.linspace(0.0, 1.0, 400)) - 0.5
    steps = np.diff(np.unwrap(np.arctan2(places[:, 1], places[:, 0])))
    assert (steps > 0.0).all() and steps.sum() == pytest.approx(2 * np.pi, rel=1e-9)


def test_the_section_of_a_grasp_is_taken():
    class Grasp:
        size = np.array([0.5, 0.3, 0.7])
        exponents = np.array([0.4, 0.5])
        pose = np.array([0.1, 0.2, 0.3, 0.0, 0.0, np.sin(0.2), np.cos(0.2)])

    grasp: Recovery = Grasp()  # type: ignore[assignment]
    section = fit_section(superellipse(1.0, 0.4, 0.4)[None], grasp)
    assert section.half_extent == pytest.approx([0.5, 0.3])
    assert section.exponent == 0.5
    assert section.middle == pytest.approx([0.1, 0.2])
    assert np.arctan2(section.axes[0, 1], section.axes[0, 0]) == pytest.approx(0.4)


@pytest.mark.parametrize("exponent", [1.0, 0.6, 0.25])
def test_derivatives_of_the_rim_are_those_of_differences(exponent):
    lead = 0.02 * np.cos(2 * np.pi * np.arange(16) / 16)
    section = Section(np.zeros(2), np.diag([0.5, 0.3]), exponent, lead)
    turns, step = np.linspace(0.01, 0.95, 40), 1e-5
    for order in (1, 2):
        lower, higher = section.rim(turns - step, order - 1), section.rim(turns + step, order - 1)
        slopes = (higher - lower) / (2 * step)
        assert np.allclose(section.rim(turns, order), slopes, rtol=1e-5, atol=2e-4)


def test_an_integral_over_the_section_is_its_share_of_the_box():
    section = Section(np.zeros(2), np.diag([0.5, 0.3]), 1.0, np.zeros(8))
    places, weights = section.inside()
    assert weights.sum() == pytest.approx(np.pi / 4, rel=1e-12)
    second = weights @ np.square(2 * places[:, 0] - 1)
    assert second == pytest.approx(np.pi / 16, rel=1e-10)


TURN = 2 * np.pi * np.arange(24) / 24
RIM = np.column_stack([np.cos(TURN), np.sin(TURN)])


@pytest.mark.parametrize("count", [1, 2, 3, 4, 9])
@pytest.mark.parametrize("poles", [(False, False), (True, True), (True, False)])
def test_layers_are_the_loft_itself_with_heights_to_a_millionth(count, poles):
    heights = np.linspace(-0.8, 0.8, count) if count > 1 else np.zeros(1)
    radius = np.sqrt(1 - heights**2)
    grid = radius[:, None, None] * RIM
    surface = fit_contour_loft(heights, grid, low=-1.0, high=1.0, pole=poles).surface
    layers = layers_of(surface)
    v, turns = np.linspace(0.0, 1.0, 50), np.arange(50) / 50
    low, high = surface.along.domain
    wanted = surface.places(low + (high - low) * v, turns)
    along = layers.basis.matrix(v).toarray()
    around = PeriodicBasis(layers.curves.shape[1]).matrix(turns).toarray()
    plane = np.einsum("nl,nk,lkd->nd", along, around, layers.curves)
    assert np.allclose(plane, wanted[:, :2], rtol=0, atol=1e-12)
    assert np.allclose(along @ layers.heights, wanted[:, 2], rtol=0, atol=4e-6)
    assert layers.pinned == poles
    assert (layers.basis.degree, layers.basis.domain) == (3, (0.0, 1.0))


def test_too_few_layers_are_refused():
    surface = fit_contour_loft([-0.5, 0.5], np.stack([RIM, RIM]), low=-1.0, high=1.0).surface
    with pytest.raises(ValueError, match="layers must be at least 4, got 3"):
        layers_of(surface, 3)
