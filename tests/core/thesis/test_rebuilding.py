import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.geometry.meshes import solidity
from palpate.core.geometry.polygons import signed_area
from palpate.core.shapes.superquadrics import Superquadric
from palpate.core.splines.bases import clamped_basis, evaluate_grid
from palpate.core.splines.inversion import invert_points
from palpate.core.splines.lattices import fold_report
from palpate.core.splines.spline_volumes import SplineVolume, upright_parallelepiped
from palpate.core.thesis.layers import invert_thesis
from palpate.core.thesis.rebuilding import (
    ModelTriples,
    interpolated_parameters,
    latitude_points,
    level_points,
    match_contour,
    ray_azimuths,
    rebuild_thesis,
    stack_contours,
    triples_of,
)

Vase = Callable[..., Floats]
Figure = Callable[[str, int], Floats]
Prism = Callable[[Floats, int], Floats]
ETA, NU = np.linspace(0.0, 1.0, 21), np.linspace(0.0, 1.0, 25)


def rings_volume(rings):
    """Volume between the first and last of level rings (m, n, 3), by Simpson's rule."""
    areas = np.array([signed_area(ring[:, :2]) for ring in rings])
    heights = rings[:, 0, 2]
    weights = np.array([1, *([4, 2] * (len(rings) // 2))[:-1], 1]) / 3
    return float(weights @ areas) * float(heights[1] - heights[0])


@pytest.mark.parametrize("faithful", [False, True])
def test_a_vase_is_rebuilt_to_a_few_hundredths_of_its_size(vase, faithful):
    solid = rebuild_thesis(vase(17), faithful=faithful)
    mesh = solid.mesh(80, 96)
    found = solidity(*mesh)
    assert found.watertight
    assert found.genus == 0
    assert found.volume == pytest.approx(rings_volume(vase(129)), rel=0.06)
    side = mesh.vertices[np.abs(mesh.vertices[:, 2]) < 0.85]
    turn = np.arctan2(side[:, 1], side[:, 0])
    wanted = (0.7 + 0.15 * np.sin(3 * side[:, 2])) * (1 + 0.1 * np.cos(3 * turn))
    off = np.linalg.norm(side[:, :2], axis=1) - wanted
    assert np.sqrt((off**2).mean()) < 0.02
    assert np.abs(mesh.vertices[:, 2]).max() <= 1.0 + 0.01


def test_parameters_surface_and_lattice_belong_together(vase):
    for faithful in (False, True):
        solid = rebuild_thesis(vase(), layer=(5, 6), faithful=faithful)
        assert solid.lattice.control.shape == (5, 6, 13, 3)
        assert np.allclose(solid.lattice.control[..., 2], np.linspace(-1, 1, 13), atol=1e-12)
        assert solid.parameters.shape == (13, 41, 3)
        assert solid.parameters.min() >= 0.0
        assert solid.parameters.max() <= 1.0
        assert np.allclose(solid.parameters[:, 0], solid.parameters[:, -1], atol=1e-6)
        surface = solid.surface(ETA, NU)
        triples = solid.triples.at(ETA, NU).reshape(-1, 3)
        assert np.array_equal(surface.reshape(-1, 3), solid.lattice.volume.at(triples))
        assert np.allclose(surface[:, 0], surface[:, -1], atol=1e-6)


def test_the_parameters_are_those_of_the_models_points_in_the_contours_box(vase):
    # Affine maps leave them as they are: theorem 1 of 4.2.1.
    solid = rebuild_thesis(vase() * [0.02, 0.03, 0.05] + 0.3)
    assert isinstance(solid.lattice.undeformed, SplineVolume)
    box = solid.lattice.undeformed.control.reshape(-1, 3)
    given = (vase() * [0.02, 0.03, 0.05] + 0.3).reshape(-1, 3)
    assert np.allclose([box.min(axis=0), box.max(axis=0)], [given.min(axis=0), given.max(axis=0)])
    points = solid.lattice.undeformed.at(solid.parameters.reshape(-1, 3))
    local = 2 * (points - box.min(axis=0)) / np.ptp(box, axis=0) - 1
    level = np.repeat(np.linspace(-1, 1, 13), 41)
    assert np.allclose(local[:, 2], level, rtol=0, atol=1e-12)
    assert np.allclose(solid.lattice.local(points), solid.parameters.reshape(-1, 3), atol=1e-12)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_the_solid_does_not_depend_on_the_unit_the_place_or_the_proportions(vase, unit):
    expected = rebuild_thesis(vase()).surface(ETA, NU)
    scale, shift = unit * np.array([1.0, 2.0, 0.5]), unit * np.array([3.0, -2.0, 7.0])
    found = rebuild_thesis(vase() * scale + shift).surface(ETA, NU)
    assert np.allclose((found - shift) / scale, expected, rtol=0, atol=1e-9)


def test_the_solid_does_not_depend_on_how_contours_are_listed(vase):
    expected = rebuild_thesis(vase()).surface(ETA, NU)
    rng = np.random.default_rng(3)
    listed = []
    for contour in vase()[rng.permutation(13), :-1]:
        ring = np.roll(contour, rng.integers(40), axis=0)
        listed.append(ring[::-1] if rng.random() < 0.5 else ring)
    solid = rebuild_thesis(listed)
    assert np.allclose(solid.surface(ETA, NU), expected, rtol=0, atol=1e-9)
    heights = np.array([contour[0, 2] for contour in listed])
    assert (np.diff(heights[solid.order]) > 0.0).all()


def test_the_program_needs_contours_that_begin_alike(vase):
    begun = vase()[:, :-1].copy()
    begun[1::2] = np.roll(begun[1::2], 20, axis=1)
    off = [
        np.abs(
            rebuild_thesis(begun, faithful=faithful).surface(ETA, NU)
            - rebuild_thesis(vase(), faithful=faithful).surface(ETA, NU)
        ).max()
        for faithful in (False, True)
    ]
    assert off[0] < 1e-9
    assert off[1] > 0.02


def test_the_lattice_is_sound_where_that_of_the_program_is_a_mirror_image(vase):
    assert fold_report(rebuild_thesis(vase()).lattice).verdict == "sound"
    assert fold_report(rebuild_thesis(vase(), faithful=True).lattice).share > 0.9


def test_the_solid_closes_in_the_poles_of_the_model_and_the_programs_in_a_mean_point(vase):
    ours, program = rebuild_thesis(vase()), rebuild_thesis(vase(), faithful=True)
    assert ours.cap is None
    ends = ours.surface(np.array([0.0, 1.0]), NU)
    assert np.ptp(ends, axis=1).max() < 1e-12
    assert ends[:, 0, 2].tolist() == pytest.approx([-1.0, 1.0])
    vertices = program.mesh(40, 48).vertices
    assert vertices[-1, 2] == pytest.approx(vertices[-49:-1, 2].mean() + 0.01)
    assert vertices[0, 2] == pytest.approx(vertices[1:49, 2].mean() - 0.01)
    # Of an object a tenth as large the same hundredth is ten times as much.
    small = rebuild_thesis(0.1 * vase(), faithful=True).mesh(40, 48).vertices
    assert small[-1, 2] - small[-49:-1, 2].mean() == pytest.approx(0.01)


def test_the_spline_of_4_3_may_take_the_place_of_the_models_own_triples(vase):
    solid = rebuild_thesis(vase(27, 80))
    splined = dataclasses.replace(solid, triples=interpolated_parameters(solid.parameters))
    volumes = [solidity(*one.mesh(80, 96)).volume for one in (solid, splined)]
    assert volumes[1] == pytest.approx(volumes[0], rel=0.01)


def test_a_rounder_model_is_drawn_inwards(vase):
    true = rings_volume(vase(129))
    lost = [
        1 - solidity(*rebuild_thesis(vase(27, 80), exponents=e).mesh(80, 96)).volume / true
        for e in ((1.0, 1.0), (0.15, 0.15))
    ]
    assert lost[0] > 0.15
    assert 0.0 < lost[1] < 0.04


def test_row_43_contours_of_uneven_points_make_the_same_solid_as_even_ones(prism):
    def circle(turns):
        return np.column_stack([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)])

    uneven = np.concatenate([0.25 * np.arange(60) / 60, 0.25 + 0.75 * np.arange(20) / 20])
    even = rebuild_thesis(prism(circle(np.arange(80) / 80), 9)).surface(ETA, NU)
    found = rebuild_thesis(prism(circle(uneven), 9)).surface(ETA, NU)
    assert np.abs(found - even).max() < 0.005


@pytest.mark.parametrize("name", ["c", "u"])
def test_rows_44_and_45_slices_around_a_middle_outside_give_a_closed_solid_and_are_flagged(
    name, figure, prism
):
    points = figure(name, 80)
    solid = rebuild_thesis(prism(points + [4.0, 1.0], 11), layer=(7, 7))
    assert not solid.health.one_to_one.any()
    assert not solid.health.cores_outside.any()
    assert solid.health.cores_moved.all()
    assert (solid.health.core_scales > 0.1).all()
    found = solidity(*solid.mesh(60, 120))
    assert found.watertight
    assert found.genus == 0
    assert found.volume == pytest.approx(2.0 * signed_area(points), rel=0.08)


def test_row_71_lobed_slices_have_a_core_with_the_room_that_there_is(figure, prism):
    contours = prism(figure("lobes", 96), 5)
    ours, program = rebuild_thesis(contours), rebuild_thesis(contours, faithful=True)
    assert (ours.health.core_scales > 0.25).all()
    assert not ours.health.cores_outside.any()
    assert program.health.cores_outside.all()


def test_the_health_says_what_the_program_does_not(vase):
    ours, program = (rebuild_thesis(vase(), faithful=f).health for f in (False, True))
    assert ours.one_to_one.all()
    assert not ours.degenerate.any()
    assert not ours.gaps.any()
    assert (program.gaps > 0.01).all()
    assert program.core_scales == pytest.approx(np.full(13, 0.618), abs=1e-3)


def test_a_contour_that_meets_itself_is_flagged(prism):
    turn = 2.0 * np.pi * (np.arange(60) + 0.5) / 60
    eight = np.column_stack([np.sin(turn), 0.6 * np.sin(2.0 * turn)])
    contours = prism(np.column_stack([np.cos(turn), np.sin(turn)]), 5)
    contours[2, :, :2] = eight
    for faithful in (False, True):
        solid = rebuild_thesis(contours, faithful=faithful)
        assert solid.health.self_intersecting.tolist() == [False, False, True, False, False]
        assert np.isfinite(solid.mesh(30, 40).vertices).all()


def test_end_contours_may_be_a_point(vase):
    pointed = vase()
    pointed[[0, -1], :, :2] = 0.0
    for faithful in (False, True):
        solid = rebuild_thesis(pointed, faithful=faithful)
        assert solid.health.degenerate.tolist() == [True] + 11 * [False] + [True]
        mesh = solid.mesh(60, 80)
        assert np.isfinite(mesh.vertices).all()
        assert solidity(*mesh).watertight


@pytest.mark.parametrize("rows", [2, 3, 4])
def test_few_contours_lower_the_degree_along_the_height(vase, rows):
    for faithful in (False, True):
        solid = rebuild_thesis(vase(rows), faithful=faithful)
        assert solid.lattice.volume.bases[2].degree == min(3, rows - 1)
        assert solidity(*solid.mesh(40, 48)).watertight


def test_repeated_heights_and_noise_leave_a_closed_solid(vase):
    contours = vase()
    contours[5, :, 2] = contours[4, :, 2]
    contours[:, :-1, :2] += 0.01 * np.random.default_rng(0).normal(size=(13, 40, 2))
    solid = rebuild_thesis(contours[:, :-1])
    found = solidity(*solid.mesh(60, 80))
    assert found.watertight
    assert found.volume == pytest.approx(rings_volume(vase(129)), rel=0.08)


def test_uneven_heights_are_no_distortion(vase):
    fine = vase(257)
    chosen = np.round(128 + 128 * np.sin(0.5 * np.pi * np.linspace(-1, 1, 21))).astype(int)
    volume = solidity(*rebuild_thesis(fine[chosen]).mesh(80, 96)).volume
    assert volume == pytest.approx(rings_volume(vase(129)), rel=0.03)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"layer": (3, 5)}, r"layer must be two numbers of points, at least 4 each, got \(3, 5\)"),
        ({"layer": (5,)}, r"layer must be two numbers of points, at least 4 each, got \(5,\)"),
        ({"exponents": (0.1, 3.0)}, "exponents must lie between 0.02 and 2.0"),
        ({"exponents": (0.1, 0.2, 0.3)}, r"exponents must have shape \(2\), got \(3,\)"),
        ({"exponents": (0.1, np.nan)}, "exponents must be finite"),
    ],
)
def test_a_layer_or_exponents_that_cannot_work_are_refused(vase, options, message):
    with pytest.raises(ValueError, match=message):
        rebuild_thesis(vase(), **options)  # type: ignore[arg-type]


def circle(turns):
    return np.column_stack([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)])


def test_rays_begin_in_the_west_and_leave_out_the_seam():
    assert np.allclose(ray_azimuths(4), [-np.pi, -np.pi / 2, 0, np.pi / 2])


def test_points_of_a_circle_lie_on_their_rays():
    azimuths = ray_azimuths(40)
    match = match_contour(circle(np.arange(40) / 40 + 0.013), azimuths)
    assert match.one_to_one
    assert not match.degenerate
    assert np.allclose(
        match.points, np.column_stack([np.cos(azimuths), np.sin(azimuths)]), rtol=0, atol=1e-4
    )


def test_row_43_the_middle_of_an_unevenly_sampled_circle_is_that_of_its_area():
    turns = np.concatenate([0.25 * np.arange(60) / 60, 0.25 + 0.75 * np.arange(20) / 20])
    points = circle(turns)
    assert np.linalg.norm(points.mean(axis=0)) > 0.4
    assert np.linalg.norm(match_contour(points, ray_azimuths(80)).middle) < 0.005


@pytest.mark.parametrize("name", ["u", "c"])
def test_row_44_a_contour_around_a_middle_outside_is_matched_in_order_and_flagged(name, figure):
    points = figure(name, 80) + [3.0, 0.5]
    match = match_contour(points, ray_azimuths(80))
    assert not match.one_to_one
    distances = np.linalg.norm(match.points[:, None] - points, axis=2)
    assert distances.min(axis=1).max() < 0.08  # on the contour
    assert distances.min(axis=0).max() < 0.2  # all around it
    numbers = np.unwrap(distances.argmin(axis=1), period=80)
    assert (np.diff(numbers) >= 0).all()
    assert 70 <= numbers[-1] - numbers[0] <= 80


def test_a_contour_is_matched_the_same_way_however_it_is_begun_and_directed(figure):
    points, azimuths = figure("lobes", 48), ray_azimuths(48)
    expected = match_contour(points, azimuths).points
    for other in (np.roll(points, 17, axis=0), points[::-1]):
        assert np.allclose(match_contour(other, azimuths).points, expected, rtol=0, atol=1e-12)


def test_points_in_one_place_are_that_place_and_reported_to_be():
    match = match_contour(np.tile([0.3, -0.2], (12, 1)), ray_azimuths(12))
    assert match.degenerate
    assert np.allclose(match.points, [0.3, -0.2], rtol=0, atol=1e-15)


def test_contours_come_out_upwards_in_the_cube_from_minus_1_to_1(vase):
    given = vase() * [0.02, 0.03, 0.05] + [0.4, -0.2, 0.1]
    mixed = given[[3, 0, *range(4, 13), 2, 1]]
    stack = stack_contours(mixed)
    assert stack.order.tolist() == [1, 12, 11, 0, *range(2, 11)]
    assert np.allclose(stack.heights, np.linspace(-1, 1, 13), rtol=0, atol=1e-12)
    assert np.allclose(stack.points.min(axis=(0, 1)), -1.0, rtol=0, atol=1e-12)
    assert np.allclose(stack.points.max(axis=(0, 1)), 1.0, rtol=0, atol=1e-12)
    level = np.broadcast_to(stack.heights[:, None, None], (13, 40, 1))
    back = stack.box.points(0.5 * (np.concatenate([stack.points, level], axis=-1) + 1.0))
    assert np.allclose(back, given[:, :-1], rtol=0, atol=1e-15)


def test_a_first_point_that_comes_again_is_one_point(vase):
    closed = stack_contours(vase())
    assert np.array_equal(closed.points, stack_contours(vase()[:, :-1]).points)
    assert closed.points.shape == (13, 40, 2)


def test_a_contour_lies_at_the_mean_of_its_heights(vase):
    tilted = vase()[:, :-1]
    tilted[..., 2] += 0.01 * tilted[..., 0]
    expected = tilted[..., 2].mean(axis=1)
    span = np.ptp(expected)
    assert np.allclose(
        stack_contours(tilted).heights, 2 * (expected - expected[0]) / span - 1, rtol=0, atol=1e-12
    )


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda x: x[:1], "contours must be at least 2, got 1"),
        (lambda x: [x[0], x[1][:-3]], "contours must have as many points each, got 38 to 41"),
        (lambda x: [x[0], np.float64(3.0)], "contours must have as many points each, got 0 to 41"),
        (lambda x: x[..., :2], r"contours must have shape \(any, any, 3\), got \(13, 41, 2\)"),
        (lambda x: np.where(x > 0.69, np.nan, x), "contours must be finite"),
        (lambda x: x * [1, 1, 0], "contours must extend along x, y and z"),
        (lambda x: x * [1, 0, 1], "contours must extend along x, y and z"),
        (lambda x: x[:, [0, 10, 20, 0]], "at least 4 different points, got 3"),
    ],
)
def test_contours_that_cannot_be_used_are_refused(vase, spoil, message):
    with pytest.raises(ValueError, match=message):
        stack_contours(spoil(vase()))


@pytest.fixture(scope="module", params=[False, True], ids=["corrected", "program"])
def solid(request, vase):
    return rebuild_thesis(vase(), faithful=request.param)


def test_a_mesh_has_the_rows_and_columns_asked_for_and_faces_outwards(solid):
    mesh = solid.mesh(20, 30)
    assert mesh.vertices.shape == (20 * 30 + 2, 3)
    found = solidity(*mesh)
    assert found.watertight
    assert found.components == 1
    assert found.volume > 0.0


def test_the_rows_of_a_mesh_are_rows_of_the_surface(solid):
    eta = np.linspace(0, 1, 22)[1:-1] if solid.cap is None else np.linspace(0, 1, 20)
    rings = solid.mesh(20, 30).vertices[1:-1].reshape(20, 30, 3)
    assert np.allclose(rings, solid.surface(eta, np.arange(30) / 30), rtol=0, atol=1e-12)


def test_the_surface_rises_with_eta(solid):
    surface = solid.surface(np.linspace(0, 1, 9), np.linspace(0, 1, 5))
    assert surface.shape == (9, 5, 3)
    assert (np.diff(surface[..., 2].mean(axis=1)) > 0.0).all()


@pytest.mark.parametrize("counts", [(1, 10), (10, 2)])
def test_a_mesh_of_too_few_points_is_refused(solid, counts):
    with pytest.raises(ValueError, match="at least 2 rows and 3 columns, got"):
        solid.mesh(*counts)


@pytest.mark.parametrize("place", [-0.1, 1.1, np.nan])
def test_a_place_beyond_the_surface_is_refused(solid, place):
    with pytest.raises(ValueError, match="eta must"):
        solid.surface(np.array([place]), np.array([0.5]))
    with pytest.raises(ValueError, match="nu must"):
        solid.surface(np.array([0.5]), np.array([place]))
    assert solid.surface(np.zeros(0), np.array([0.5])).shape == (0, 1, 3)


AZIMUTHS = np.linspace(-np.pi, np.pi, 25)
CUBE = upright_parallelepiped(np.full(3, -1.0), np.full(3, 2.0))
EVEN = SplineVolume(
    CUBE.even_control((5, 5, 9)), (clamped_basis(5), clamped_basis(5), clamped_basis(9))
)


def model(e1, e2):
    return Superquadric(np.ones(3), np.array([e1, e2]))


@pytest.mark.parametrize("exponents", [(0.15, 0.15), (1.0, 0.3), (0.4, 1.7), (2.0, 2.0)])
def test_level_points_are_level_and_on_the_model_from_pole_to_pole(exponents):
    shape, heights = model(*exponents), np.linspace(-1.0, 1.0, 13)
    points = level_points(shape, heights, AZIMUTHS)
    assert np.array_equal(points[..., 2], np.repeat(heights[:, None], 25, axis=1))
    assert np.allclose(shape.gauge(points.reshape(-1, 3)), 1.0, rtol=0, atol=1e-12)
    assert not points[[0, -1], :, :2].any()
    azimuth = np.arctan2(points[6, 1:-1, 1], points[6, 1:-1, 0])
    assert np.allclose(azimuth, AZIMUTHS[1:-1], rtol=0, atol=1e-12)


def test_rows_by_latitude_are_not_level_where_the_section_is_no_circle():
    latitudes = np.arctan([-1.0, 0.0, 1.0])
    square = latitude_points(model(0.15, 0.15), latitudes, AZIMUTHS)
    assert np.ptp(square[2, :, 2]) > 0.04
    assert np.allclose(square[1, :, 2], 0.0)
    ball = latitude_points(model(1.0, 1.0), latitudes, AZIMUTHS)
    assert np.ptp(ball[2, :, 2]) < 1e-12
    assert ball[2, 0, 2] == pytest.approx(np.sqrt(0.5))  # the rest is left out


@pytest.mark.parametrize(("invert", "off"), [(invert_points, 1e-14), (invert_thesis, 5e-6)])
def test_triples_give_back_the_points_in_the_undeformed_lattice(invert, off):
    points = level_points(model(0.15, 0.15), np.linspace(-1.0, 1.0, 9), AZIMUTHS)
    triples = triples_of(EVEN, points, invert)
    back = EVEN.at(triples.reshape(-1, 3)).reshape(points.shape)
    assert np.abs(back - points).max() < off


def test_the_model_knows_its_triples_everywhere():
    shape = model(0.3, 0.8)
    triples = ModelTriples(shape, EVEN).at(np.linspace(0, 1, 7), np.linspace(0, 1, 9))
    points = EVEN.at(triples.reshape(-1, 3)).reshape(7, 9, 3)
    assert np.allclose(shape.gauge(points.reshape(-1, 3)), 1.0, rtol=0, atol=1e-12)
    assert np.allclose(points[0], [0, 0, -1], rtol=0, atol=1e-12)
    assert np.allclose(points[-1], [0, 0, 1], rtol=0, atol=1e-12)
    assert np.allclose(points[3, 0], [-1, 0, 0], rtol=0, atol=1e-12)
    assert np.allclose(points[:, 0], points[:, -1], rtol=0, atol=1e-12)
    assert np.allclose(points[3, 6], [0, 1, 0], rtol=0, atol=1e-12)


def box(rows, columns):
    """Triples on a rounded box, whose end rows are poles."""
    turn = np.linspace(-np.pi, np.pi, columns)
    x, y = np.cos(turn), np.sin(turn)
    outline = np.stack([x, y], axis=-1) / (x**12 + y**12)[:, None] ** (1 / 12)
    height = np.linspace(-1, 1, rows)
    width = (1 - np.abs(height) ** 12) ** (1 / 12)
    grid = np.empty((rows, columns, 3))
    grid[..., :2] = width[:, None, None] * outline
    grid[..., 2] = height[:, None]
    return np.asarray(0.5 * (grid + 1.0))


@pytest.mark.parametrize(("rows", "columns"), [(27, 81), (9, 13), (4, 5), (3, 9), (2, 9)])
def test_the_spline_passes_the_triples(rows, columns):
    grid = box(rows + 2, columns)[1:-1]
    spline = interpolated_parameters(grid)
    assert np.allclose(spline.at(*spline.sites), grid, rtol=0, atol=1e-12)
    assert spline.bases[0].degree == min(3, rows - 1)
    assert spline.condition < 1e3


def test_sites_go_by_the_square_root_of_the_chords():
    grid = np.zeros((4, 5, 3))
    grid[..., 2] = np.array([0.0, 0.01, 0.05, 0.14])[:, None]
    grid[..., 0] = np.linspace(0, 1, 5)
    eta, nu = interpolated_parameters(grid).sites
    assert np.allclose(eta, [0, 1 / 6, 3 / 6, 1])  # roots 0.1, 0.2, 0.3
    assert np.allclose(nu, np.linspace(0, 1, 5))


def test_sites_are_the_mean_over_the_rows_that_have_a_length():
    grid = box(9, 13)
    with_poles, without = interpolated_parameters(grid), interpolated_parameters(grid[1:-1])
    assert np.allclose(with_poles.sites[1], without.sites[1])
    poles = with_poles.at(np.array([0.0, 1.0]), np.linspace(0, 1, 50))
    assert np.allclose(poles, [[[0.5, 0.5, 0.0]], [[0.5, 0.5, 1.0]]], rtol=0, atol=1e-12)


def test_knots_average_three_sites_from_the_first_inner_one_on():
    spline = interpolated_parameters(box(12, 13)[1:-1])
    eta = spline.sites[0]
    assert np.allclose(spline.bases[0].knots[4:-4], [eta[i : i + 3].mean() for i in range(1, 7)])


def test_where_the_spline_overshoots_it_is_clipped():
    spline = interpolated_parameters(box(27, 81))
    fine = np.linspace(0, 1, 201)
    raw = evaluate_grid(spline.bases, spline.control, (fine, fine))
    assert raw.min() < -1e-5
    clipped = spline.at(fine, fine)
    assert clipped.min() == 0.0
    assert np.array_equal(clipped, np.clip(raw, 0.0, 1.0))


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        (np.zeros((5, 9, 2)), r"parameters must have shape \(any, any, 3\), got \(5, 9, 2\)"),
        (box(1, 9), "at least 2 rows and 4 columns, got 1, 9"),
        (box(5, 3), "at least 2 rows and 4 columns, got 5, 3"),
        (np.full((5, 9, 3), np.nan), "parameters must be finite"),
        (np.repeat(box(5, 9), 2, axis=0), "parameters must differ between neighbouring rows"),
        (np.repeat(box(5, 9), 2, axis=1), "parameters must differ between neighbouring columns"),
        (np.full((5, 9, 3), 0.5), "parameters must differ between neighbouring rows"),
    ],
)
def test_triples_that_determine_no_spline_are_refused(grid, message):
    with pytest.raises(ValueError, match=message):
        interpolated_parameters(grid)


def test_a_place_outside_is_refused():
    with pytest.raises(ValueError, match="x must lie in the domain"):
        interpolated_parameters(box(5, 9)).at(np.array([1.1]), np.array([0.5]))
