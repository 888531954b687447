"""Laws of the thesis's solid: its lattice, shell and core, its model, its mesh."""

import dataclasses
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from scipy.integrate import simpson

from palpate.core.archive import tree_from_arrays, tree_to_arrays, tree_to_bytes
from palpate.core.arrays import Floats
from palpate.core.geometry import signed_area, solidity, turn_between, winding_number
from palpate.core.shapes import Superquadric
from palpate.core.splines import fold_report
from palpate.core.thesis import ThesisSolid, interpolated_parameters, rebuild_thesis
from palpate.core.thesis.layers import searched_scale
from tests.core.rebuild.objects import polar
from tests.core.thesis.contours import figure, prism, vase, vase_radius

ETA, NU = np.linspace(0.0, 1.0, 21), np.linspace(0.0, 1.0, 25)
both = pytest.mark.parametrize("faithful", [False, True], ids=["corrected", "program"])


@cache
def vase_solid(faithful: bool = False, rows: int = 13, count: int = 40, **options) -> ThesisSolid:
    return rebuild_thesis(vase(rows, count), faithful=faithful, **options)


@cache
def prism_solid(name: str, rows: int = 5, side: int = 7, faithful: bool = False) -> ThesisSolid:
    contours = prism(figure(name, 80) + [4.0, 1.0], rows)
    return rebuild_thesis(contours, layer=(side, side), faithful=faithful)


def true_volume() -> float:
    """Of the vase between its end rows, by Simpson's rule."""
    rings = vase(129)
    return float(simpson([signed_area(ring[:, :2]) for ring in rings], x=rings[:, 0, 2]))


def volume(solid: ThesisSolid) -> float:
    return solidity(*solid.mesh(80, 96)).volume


@both
def test_vase_is_rebuilt_to_few_hundredths(faithful: bool):
    mesh = vase_solid(faithful, 17).mesh(80, 96)
    assert mesh.vertices.shape == (80 * 96 + 2, 3)
    measures = solidity(*mesh)
    assert measures[:3] == (True, 1, 0)
    assert measures.volume == pytest.approx(true_volume(), rel=0.06)
    x, y, z = mesh.vertices[np.abs(mesh.vertices[:, 2]) < 0.85].T
    off = np.hypot(x, y) - vase_radius(z, np.arctan2(y, x))
    assert np.sqrt((off**2).mean()) < 0.02
    assert np.abs(mesh.vertices[:, 2]).max() <= 1.0 + 0.01


@both
def test_surface_and_mesh_follow_lattice_and_parameters(faithful: bool):
    solid = vase_solid(faithful, layer=(5, 6))
    assert solid.lattice.control.shape == (5, 6, 13, 3)
    assert np.allclose(solid.lattice.control[..., 2], np.linspace(-1, 1, 13), atol=1e-12)
    assert solid.parameters.shape == (13, 41, 3)
    assert solid.parameters.min() >= 0.0 and solid.parameters.max() <= 1.0
    assert np.allclose(solid.parameters[:, 0], solid.parameters[:, -1], atol=1e-6)
    surface = solid.surface(ETA, NU)
    triples = solid.triples.at(ETA, NU).reshape(-1, 3)
    assert np.array_equal(surface.reshape(-1, 3), solid.lattice.volume.at(triples))
    assert np.allclose(surface[:, 0], surface[:, -1], atol=1e-6)
    assert (np.diff(surface[..., 2].mean(axis=1)) > 0.0).all()
    rows = np.linspace(0, 1, 20) if faithful else np.linspace(0, 1, 22)[1:-1]
    rings = solid.mesh(20, 30).vertices[1:-1].reshape(20, 30, 3)
    assert np.allclose(rings, solid.surface(rows, np.arange(30) / 30), rtol=0, atol=1e-12)
    assert solid.surface(np.zeros(0), NU).shape == (0, 25, 3)
    again = tree_from_arrays(tree_to_arrays(solid))  # bit for bit
    assert np.array_equal(again.surface(ETA, NU), surface)
    assert np.array_equal(tree_to_bytes(again), tree_to_bytes(solid))


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_solid_does_not_depend_on_affine_scaling(unit: float):
    scale, shift = unit * np.array([1.0, 2.0, 0.5]), unit * np.array([3.0, -2.0, 7.0])
    contours = vase() * scale + shift
    solid = rebuild_thesis(contours)
    surface = (solid.surface(ETA, NU) - shift) / scale
    assert np.allclose(surface, vase_solid().surface(ETA, NU), rtol=0, atol=1e-9)
    box, points = solid.lattice.undeformed.control.reshape(-1, 3), contours.reshape(-1, 3)
    assert np.allclose([box.min(axis=0), box.max(axis=0)], [points.min(axis=0), points.max(axis=0)])


def test_corrected_solid_ignores_order_start_and_direction():
    rng, listed = np.random.default_rng(3), []
    for contour in vase()[rng.permutation(13), :-1]:
        ring = np.roll(contour, rng.integers(40), axis=0)
        listed.append(ring[::-1] if rng.random() < 0.5 else ring)
    solid = rebuild_thesis(listed)
    wanted = vase_solid().surface(ETA, NU)
    assert np.allclose(solid.surface(ETA, NU), wanted, rtol=0, atol=1e-9)
    heights = np.array([contour[0, 2] for contour in listed])
    assert (np.diff(heights[solid.order]) > 0.0).all()
    # The program needs contours with the same start.
    begun = vase()[:, :-1].copy()
    begun[1::2] = np.roll(begun[1::2], 20, axis=1)
    assert np.abs(rebuild_thesis(begun).surface(ETA, NU) - wanted).max() < 1e-9
    program = rebuild_thesis(begun, faithful=True).surface(ETA, NU)
    assert np.abs(program - vase_solid(True).surface(ETA, NU)).max() > 0.02
    tilted = vase()[:, :-1].copy()  # A contour lies at the mean of its heights
    tilted[..., 2] += 0.01 * tilted[..., 0]
    levels = rebuild_thesis(tilted).lattice.control[0, 0, :, 2]
    assert np.allclose(levels, tilted[..., 2].mean(axis=1), rtol=0, atol=1e-12)


@pytest.mark.parametrize("exponents", [(0.15, 0.15), (1.0, 0.3), (0.4, 1.7), (2.0, 2.0)])
def test_parameters_belong_to_model_points(exponents: tuple[float, float]):
    model = Superquadric(np.ones(3), np.array(exponents))
    solid = vase_solid(exponents=exponents)
    before = solid.lattice.undeformed
    box = before.control.reshape(-1, 3)

    def in_cube(triples: Floats) -> Floats:
        points = before.at(triples.reshape(-1, 3))
        return (2 * (points - box.min(axis=0)) / np.ptp(box, axis=0) - 1).reshape(triples.shape)

    rows = in_cube(solid.parameters)
    assert np.allclose(rows[..., 2], np.linspace(-1, 1, 13)[:, None], rtol=0, atol=1e-12)
    assert np.allclose(model.gauge(rows.reshape(-1, 3)), 1.0, rtol=0, atol=1e-12)
    azimuths = np.linspace(-np.pi, np.pi, 41)[1:-1]
    assert np.allclose(np.arctan2(*rows[6, 1:-1, 1::-1].T), azimuths, rtol=0, atol=1e-9)
    points = in_cube(solid.triples.at(np.linspace(0, 1, 7), np.linspace(0, 1, 9)))
    assert np.allclose(model.gauge(points.reshape(-1, 3)), 1.0, rtol=0, atol=1e-10)
    assert np.allclose(points[[0, -1]], [[[0, 0, -1]], [[0, 0, 1]]], rtol=0, atol=1e-12)
    assert np.allclose(points[3, [0, 6]], [[-1, 0, 0], [0, 1, 0]], rtol=0, atol=1e-12)
    # The program's rows lie at latitudes up to 45 degrees, and are level on a ball alone.
    program = rebuild_thesis(vase(), exponents=exponents, faithful=True)
    rows = in_cube(program.parameters)
    assert np.allclose(model.gauge(rows.reshape(-1, 3)), 1.0, rtol=0, atol=2e-4)
    assert np.abs(rows[6, :, 2]).max() < 1e-5


def rim_of(layer: Floats) -> Floats:
    """Control points around a layer, counter-clockwise from the north-west."""
    south, east = layer[:, 0], layer[-1, :]
    return np.concatenate([layer[0, :0:-1], south[:-1], east[:-1], layer[:0:-1, -1]])


@pytest.mark.parametrize("name", ["lobes", "u", "c"])
def test_core_is_largest_rectangle_in_shell(name: str):
    solid = prism_solid(name)
    for number in range(5):
        layer = solid.lattice.control[:, :, number, :2]
        rim, core = rim_of(layer), layer[1:-1, 1:-1].reshape(-1, 2)
        assert signed_area(rim) > 0.0 and (winding_number(rim, core) == 1).all()
        low, high = rim.min(axis=0), rim.max(axis=0)
        half, middle = 0.5 * (high - low), 0.5 * (core.min(axis=0) + core.max(axis=0))
        share = np.linspace(0, 1, 400)[:, None, None]
        fine = rim + share * (np.roll(rim, -1, axis=0) - rim)
        room = np.abs((fine - middle) / half).max(axis=2).min()
        assert solid.health.core_scales[number] == pytest.approx(room, rel=5e-3)
        assert np.ptp(core, axis=0) == pytest.approx(1.9 * solid.health.core_scales[number] * half)
        moved = not np.allclose(middle, 0.5 * (low + high), atol=1e-9)
        assert solid.health.cores_moved[number] == moved == (name != "lobes")
        corner = np.arctan2(*(layer[0, -1] - 0.5 * (low + high))[::-1])
        assert corner == pytest.approx(0.75 * np.pi, abs=np.pi / 8)
    assert not solid.health.cores_outside.any() and not solid.health.gaps.any()
    assert (solid.health.core_scales > 0.1).all()
    assert solid.health.one_to_one.all() == (name == "lobes")


def test_program_lattice_is_mirrored():
    assert fold_report(vase_solid().lattice).verdict == "sound"
    assert fold_report(vase_solid(True).lattice).share > 0.9
    health = vase_solid(True).health
    assert (health.gaps > 0.01).all() and not vase_solid().health.gaps.any()
    assert health.core_scales == pytest.approx(np.full(13, 0.618), abs=1e-3)
    assert (prism_solid("lobes", side=5, faithful=True).health.cores_outside > 0).all()
    for begin, step in ((-0.5, 1), (0.0, 1), (-0.5, -1)):
        contours = prism(polar(begin + step * np.arange(40) / 40), 2)
        layer = rebuild_thesis(contours, faithful=True).lattice.control[:, :, 0, :2]
        assert signed_area(rim_of(layer)) * step < 0.0
        if step > 0:  # The core follows the shell only if the contour begins west of the origin
            shell = np.array([layer[-1, 0] - layer[0, 0], layer[0, -1] - layer[0, 0]])
            core = np.array([layer[-2, 1] - layer[1, 1], layer[1, -2] - layer[1, 1]])
            turns = np.abs(turn_between(shell, core))
            assert (turns < 0.25 * np.pi).all() == (begin == -0.5)


def buildgrid(polygon: Floats, middle: Floats, half: Floats, edges: int) -> float:
    """The search of buildgrid.m and isint.m, with b1 for its second a1."""
    (x, y), (dx, dy) = polygon[:edges].T, (np.roll(polygon, -1, axis=0) - polygon)[:edges].T
    # An ellipse meets dy x + dx y + c = 0; as printed a sign is lost.
    offset = np.abs(dy * middle[0] + dx * middle[1] + y * dx - x * dy)
    reach = np.hypot(dy * half[0], dx * half[1])
    fib = [1.0, 1.0]
    for _ in range(48):
        fib.append(fib[-1] + fib[-2])
    low, high, count = 1e-6, 1.0, 1
    while high - low > 1e-6 and count < 49:
        meets = [((offset <= one * reach) & (reach > 0.0)).any() for one in (low, high)]
        first, second = (
            low + fib[50 - count - by] / fib[50 - count] * (high - low) for by in (2, 1)
        )
        if all(meets):
            high = first
        elif meets[1]:
            low, high = first, second
        else:
            low = second
        count += 1
    return 0.5 * (low + high)


def test_core_search_equals_that_of_program():
    for seed in range(30):
        rng = np.random.default_rng(seed)
        polygon, edges = rng.uniform(-1, 1, (9, 2)), 1 + seed % 9
        polygon[4] = polygon[5]  # an edge without length is no line
        middle, half = rng.uniform(-0.3, 0.3, 2), rng.uniform(0.2, 1.0, 2)
        wanted = buildgrid(polygon, middle, half, edges)
        assert searched_scale(polygon, middle, half, edges) == pytest.approx(wanted, abs=1e-9)


def test_ends_are_poles_or_program_caps():
    assert vase_solid().cap is None
    ends = vase_solid().surface(np.array([0.0, 1.0]), NU)
    assert np.ptp(ends, axis=1).max() < 1e-12
    assert ends[:, 0, 2].tolist() == pytest.approx([-1.0, 1.0])
    # On a ten times smaller object the cap has the same length.
    for solid in (vase_solid(True), rebuild_thesis(0.1 * vase(), faithful=True)):
        heights = solid.mesh(40, 48).vertices[:, 2]
        assert heights[-1] == pytest.approx(heights[-49:-1].mean() + 0.01)
        assert heights[0] == pytest.approx(heights[1:49].mean() - 0.01)


def test_volume_depends_mainly_on_model():
    solid = vase_solid(False, 27, 80)
    splined = dataclasses.replace(solid, triples=interpolated_parameters(solid.parameters))
    assert volume(splined) == pytest.approx(volume(solid), rel=0.01)
    rounder = volume(vase_solid(False, 27, 80, exponents=(1.0, 1.0))) / true_volume()
    assert 1 - rounder > 0.15 and 0.0 < 1 - volume(solid) / true_volume() < 0.04
    chosen = np.round(128 + 128 * np.sin(0.5 * np.pi * np.linspace(-1, 1, 21))).astype(int)
    assert volume(rebuild_thesis(vase(257)[chosen])) == pytest.approx(true_volume(), rel=0.03)
    rough = vase()  # Two contours at one height, and noise
    rough[5, :, 2] = rough[4, :, 2]
    rough[:, :-1, :2] += 0.01 * np.random.default_rng(0).normal(size=(13, 40, 2))
    assert volume(rebuild_thesis(rough[:, :-1])) == pytest.approx(true_volume(), rel=0.08)
    uneven = np.concatenate([0.25 * np.arange(60) / 60, 0.25 + 0.75 * np.arange(20) / 20])
    even, dense = (
        rebuild_thesis(prism(polar(turns), 5)).surface(ETA, NU)
        for turns in (np.arange(80) / 80, uneven)
    )
    assert np.abs(dense - even).max() < 0.005


@both
def test_degenerate_contours_are_flagged_and_rebuilt(faithful: bool):
    turn = (np.arange(60) + 0.5) / 60
    contours = prism(polar(turn), 5)
    contours[2, :, :2] = np.column_stack([polar(turn)[:, 1], 0.6 * polar(2 * turn)[:, 1]])
    solid = rebuild_thesis(contours, faithful=faithful)
    assert solid.health.self_intersecting.tolist() == [False, False, True, False, False]
    assert np.isfinite(solid.mesh(30, 40).vertices).all()
    pointed = vase()
    pointed[[0, -1], :, :2] = 0.0
    solid = rebuild_thesis(pointed, faithful=faithful)
    assert solid.health.degenerate.tolist() == [True] + 11 * [False] + [True]
    assert not vase_solid(faithful).health.degenerate.any()
    assert solidity(*solid.mesh(60, 80)).watertight
    for end in (0, -1):
        assert np.ptp(solid.lattice.control[:, :, end, :2].reshape(-1, 2), axis=0).max() < 1e-9
    for rows in (2, 3, 4):
        few = vase_solid(faithful, rows)
        assert few.lattice.volume.bases[2].degree == min(3, rows - 1)
        assert solidity(*few.mesh(40, 48)).watertight


def spoiled(change: Callable[[Floats], object], **options: object) -> object:
    return rebuild_thesis(change(vase()), **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(("call", "words"), [
    (lambda: vase_solid(layer=(3, 5)), r"layer must be two numbers .* at least 4 each, got \(3, 5"),
    (lambda: vase_solid(layer=(5,)), r"layer must be two numbers of points, .* got \(5,\)"),
    (lambda: vase_solid(exponents=(0.1, 3.0)), "exponents must lie between 0.02 and 2.0"),
    (lambda: vase_solid(exponents=(0.1, 0.2, 0.3)), r"exponents must have shape \(2\), got \(3,\)"),
    (lambda: vase_solid(exponents=(0.1, np.nan)), "exponents must be finite"),
    (lambda: spoiled(lambda x: x[:1]), "contours must be at least 2, got 1"),
    (lambda: spoiled(lambda x: [x[0], x[1][:-3]]), "as many points each, got 38 to 41"),
    (lambda: spoiled(lambda x: [x[0], np.float64(3.0)]), "as many points each, got 0 to 41"),
    (lambda: spoiled(lambda x: x[..., :2]), r"contours must have shape \(any, any, 3\), got \(13,"),
    (lambda: spoiled(lambda x: np.where(x > 0.69, np.nan, x)), "contours must be finite"),
    (lambda: spoiled(lambda x: x * [1, 1, 0]), "contours must extend along x, y and z"),
    (lambda: spoiled(lambda x: x * [1, 0, 1]), "contours must extend along x, y and z"),
    (lambda: spoiled(lambda x: x[:, [0, 10, 20, 0]]), "at least 4 different points, got 3"),
    (lambda: vase_solid().mesh(1, 10), "at least 2 rows and 3 columns, got 1 and 10"),
    (lambda: vase_solid().mesh(10, 2), "at least 2 rows and 3 columns, got 10 and 2"),
    *((lambda at=at: vase_solid().surface(np.array([at]), NU), "eta must")
      for at in (-0.1, 1.1, np.nan)),
    *((lambda at=at: vase_solid().surface(ETA, np.array([at])), "nu must")
      for at in (-0.1, 1.1, np.nan)),
])  # fmt: skip
def test_invalid_input_raises(call: Callable[[], object], words: str):
    with pytest.raises(ValueError, match=words):
        call()
