"""Laws of the thesis's curves, inversion, (4.25), match of contours, and spline of parameters."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial import cKDTree

from palpate.core import splines
from palpate.core.arrays import Floats
from palpate.core.thesis import (
    fit_closed_curve_thesis,
    interpolated_parameters,
    invert_thesis,
    match_contour,
    ray_azimuths,
    rebuild_thesis,
    solve_control_points,
)
from tests.core.rebuild.objects import polar
from tests.core.splines.test_volumes import noisy
from tests.core.thesis.contours import figure, vase

PLACES = np.random.default_rng(0).random((300, 3))
FINE = np.arange(4000) / 4000


def test_clamped_curves_do_not_close_and_fit_worse():
    turns, fine = np.arange(81) / 80, np.arange(20000) / 20000
    points = polar(turns) * [2, 1]
    ours, theirs = splines.fit_closed_curve(points, count=16), fit_closed_curve_thesis(points, 16)
    true = cKDTree(polar(fine) * [2, 1])
    errors = [true.query(curve.at(FINE))[0].max() for curve in (ours, theirs)]
    assert 5 * errors[0] < errors[1] < 0.3
    assert theirs.closure_gap > 0.05 and theirs.condition > 1e3
    assert theirs.control.shape == (16, 2) and theirs.effective == 16
    assert fit_closed_curve_thesis(points).control.shape == (16, 2)


def test_newton_inversion_is_exact_where_converged():
    regular = noisy(0.0)  # its affine guess is exact
    inversion = invert_thesis(regular, regular.at(PLACES))
    assert inversion.converged.all() and not inversion.steps.any()
    volume = noisy(0.1)
    inversion = invert_thesis(volume, volume.at(PLACES))
    assert inversion.converged.mean() > 0.99 and 1 < inversion.steps.max() <= 50
    assert np.abs(inversion.parameters - PLACES)[inversion.converged].max() < 1e-5
    residual = np.linalg.norm(volume.at(inversion.parameters) - volume.at(PLACES), axis=1)
    assert np.allclose(inversion.residual, residual, rtol=0, atol=1e-14)
    folded = noisy(0.8, seed=1)
    assert invert_thesis(folded, folded.at(PLACES)).converged.mean() < 0.7
    assert splines.invert_points(folded, folded.at(PLACES)).converged.mean() > 0.99
    assert [len(part) for part in invert_thesis(volume, np.zeros((0, 3)))] == [0] * 5
    for squeeze in ([1, 1, 0], [1, 0, 0], [0, 0, 0]):  # finite and folded
        flat = splines.SplineVolume(regular.control * squeeze, regular.bases)
        for z in (0.0, 0.5):
            inversion = invert_thesis(flat, flat.at(PLACES[:20]) + [0.0, 0.0, z])
            assert (inversion.converged == (z == 0.0)).all() and inversion.folded.all()
            assert np.isfinite([*inversion.parameters.T, inversion.residual]).all()


def test_points_inside_lattice_recover_control_points():
    rng, shape = np.random.default_rng(3), (4, 5, 6)
    bases = tuple(splines.clamped_basis(count) for count in shape)
    volume = splines.SplineVolume(rng.normal(size=(*shape, 3)), bases)
    triples, noise = rng.random((2000, 3)), 1e-6 * rng.normal(size=(2000, 3))
    fit, noisy_fit = (
        solve_control_points(volume.at(triples) + add, triples, shape) for add in (0.0, noise)
    )
    assert np.allclose(fit.volume.control, volume.control, rtol=0, atol=1e-14 * fit.condition)
    assert fit.condition < 1e5 and fit.rms < 1e-12
    # Noise is amplified by the condition at most.
    off = np.linalg.norm(noisy_fit.volume.control - fit.volume.control)
    assert off <= fit.condition * np.linalg.norm(noise)
    assert noisy_fit.rms == pytest.approx(np.sqrt(3.0) * 1e-6, rel=0.1)


def test_surface_points_do_not_determine_lattice():
    solid = rebuild_thesis(vase(9, 40))  # 5 by 5 by 9 control points, as in the thesis
    triples = solid.parameters.reshape(-1, 3)
    with pytest.raises(ValueError, match=r"condition number \S+ for 225 control points") as caught:
        solve_control_points(vase(9, 40).reshape(-1, 3), triples, (5, 5, 9))
    assert float(str(caught.value).split("number ")[1].split()[0]) > 1e15


def test_rays_meet_circle_at_their_azimuths():
    assert np.allclose(ray_azimuths(4), [-np.pi, -np.pi / 2, 0, np.pi / 2])
    azimuths = ray_azimuths(40)
    match = match_contour(polar(np.arange(40) / 40 + 0.013), azimuths)
    assert match.one_to_one and not match.degenerate and not match.self_intersecting
    assert np.allclose(match.points, polar(azimuths / (2 * np.pi)), rtol=0, atol=1e-4)
    # The middle is that of the area, wherever points are dense.
    turns = np.concatenate([0.25 * np.arange(60) / 60, 0.25 + 0.75 * np.arange(20) / 20])
    assert np.linalg.norm(match_contour(polar(turns), azimuths).middle) < 0.005
    point = match_contour(np.tile([0.3, -0.2], (12, 1)), azimuths)
    assert point.degenerate and np.allclose(point.points, [0.3, -0.2], rtol=0, atol=1e-15)
    lobes = figure("lobes", 48)
    wanted = match_contour(lobes, azimuths).points
    for other in (np.roll(lobes, 17, axis=0), lobes[::-1]):
        assert np.allclose(match_contour(other, azimuths).points, wanted, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["u", "c"])
def test_contour_with_outer_middle_is_matched_in_order(name: str):
    points = figure(name, 80) + [3.0, 0.5]
    match = match_contour(points, ray_azimuths(80))
    assert not match.one_to_one
    distances = np.linalg.norm(match.points[:, None] - points, axis=2)
    assert distances.min(axis=1).max() < 0.08  # on the contour
    assert distances.min(axis=0).max() < 0.2  # all around it
    numbers = np.unwrap(distances.argmin(axis=1), period=80)
    assert (np.diff(numbers) >= 0).all() and 70 <= numbers[-1] - numbers[0] <= 80


def box(rows: int, columns: int) -> Floats:
    """Triples on a rounded box, whose end rows are poles."""
    outline = polar(np.linspace(-0.5, 0.5, columns))
    outline /= (outline**12).sum(axis=1, keepdims=True) ** (1 / 12)
    height = np.linspace(-1, 1, rows)[:, None]
    width = (1 - np.abs(height) ** 12) ** (1 / 12)
    grid = np.empty((rows, columns, 3))
    grid[..., :2], grid[..., 2] = width[:, :, None] * outline, height
    return 0.5 * (grid + 1.0)


@pytest.mark.parametrize(("rows", "columns"), [(27, 81), (9, 13), (4, 5), (3, 9), (2, 9)])
def test_spline_interpolates_triples(rows: int, columns: int):
    grid = box(rows + 2, columns)[1:-1]
    spline = interpolated_parameters(grid)
    assert np.allclose(spline.at(*spline.sites), grid, rtol=0, atol=1e-12)
    assert spline.bases[0].degree == min(3, rows - 1) and 1.0 <= spline.condition < 1e3
    # Sites go by the square roots of the chords, averaged over columns and over rows.
    for sites, along in zip(spline.sites, (grid, grid.swapaxes(0, 1)), strict=True):
        steps = np.sqrt(np.linalg.norm(np.diff(along, axis=0), axis=2))
        wanted = (np.cumsum(steps, axis=0) / steps.sum(axis=0)).mean(axis=1)
        assert np.allclose(sites[1:], wanted, rtol=0, atol=1e-12) and sites[0] == 0.0
    for basis, sites in zip(spline.bases, spline.sites, strict=True):
        assert np.array_equal(basis.knots, splines.averaged_knots(sites, basis.degree))


def test_poles_have_no_length_and_overshoot_is_clipped():
    with_poles, without = (interpolated_parameters(one) for one in (box(9, 13), box(9, 13)[1:-1]))
    assert np.allclose(with_poles.sites[1], without.sites[1])
    poles = with_poles.at(np.array([0.0, 1.0]), np.linspace(0, 1, 50))
    assert np.allclose(poles, [[[0.5, 0.5, 0.0]], [[0.5, 0.5, 1.0]]], rtol=0, atol=1e-12)
    spline, fine = interpolated_parameters(box(27, 81)), np.linspace(0, 1, 201)
    raw = splines.evaluate_grid(spline.bases, spline.control, (fine, fine))
    assert raw.min() < -1e-5
    assert np.array_equal(spline.at(fine, fine), np.clip(raw, 0.0, 1.0))


FEW = PLACES[:100]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: fit_closed_curve_thesis(np.ones((5, 2))), "at least 2 places, got 1"),
        (lambda: invert_thesis(noisy(0.1), np.zeros(3)), r"points must have shape \(any, 3\)"),
        (lambda: interpolated_parameters(np.zeros((5, 9, 2))), r"must have shape \(any, any, 3\)"),
        (lambda: interpolated_parameters(box(1, 9)), "at least 2 rows and 4 columns, got 1, 9"),
        (lambda: interpolated_parameters(box(5, 3)), "at least 2 rows and 4 columns, got 5, 3"),
        (lambda: interpolated_parameters(box(5, 9) * np.nan), "parameters must be finite"),
        (lambda: interpolated_parameters(box(5, 9).repeat(2, axis=0)), "differ between .* rows"),
        (lambda: interpolated_parameters(box(5, 9).repeat(2, axis=1)), "differ between .* columns"),
        (lambda: interpolated_parameters(np.full((5, 9, 3), 0.5)), "between neighbouring rows"),
        (lambda: interpolated_parameters(box(5, 9)).at([1.1], [0.5]), "x must lie in the domain"),
        (lambda: solve_control_points(FEW, FEW, (4, 4, 3)), "at least 4, got"),
        (
            lambda: solve_control_points(FEW[:60], FEW[:60], (4, 4, 4)),
            "control points, 64, got 60",
        ),
        (lambda: solve_control_points(FEW, FEW + 2.0, (4, 4, 4)), "must lie between 0 and 1"),
    ],
)
def test_invalid_input_raises(call: Callable[[], object], words: str):
    with pytest.raises(ValueError, match=words):
        call()
