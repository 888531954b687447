from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.tracing.contour_trace import TraceGoal
from palpate.core.geometry.distances import PreparedSurface, compare_surfaces, prepare_surface
from palpate.core.geometry.meshes import close_rings, solidity
from palpate.core.poses import FACING_DOWN, pose_of
from palpate.core.rebuild.closed_sides import close_contours, runs_through_axis
from palpate.core.rebuild.contours.contacts import ContactPoints, stack_points
from palpate.core.rebuild.reconstruction import reconstruct
from palpate.core.rebuild.solid import LatticeSolid
from palpate.core.rebuild.surface.closed import measure_surface
from palpate.core.rebuild.surface.meshing import mesh_surface
from palpate.core.shapes.protocol import Mesh, PosedShape
from palpate.core.shapes.superquadrics import Superquadric

K = 60
# r = 30 (1 - |z / 50|^p)^(1/p), and the plain cylinder.
EXPONENTS = {"ball": 2.0, "rounded": 10.0, "cylinder": np.inf}


def radius(name: str, heights: Floats) -> Floats:
    power = EXPONENTS[name]
    if np.isinf(power):
        return np.full_like(heights, 30.0)
    share = np.minimum(np.abs(heights) / 50.0, 1.0)
    return np.asarray(30.0 * (1.0 - share**power) ** (1.0 / power))


def rings(heights: Floats, radii: Floats, count: int = K) -> Floats:
    angle = 2 * np.pi * np.arange(count) / count
    across = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    flat = radii[:, None, None] * across
    return np.concatenate(
        [flat, np.broadcast_to(heights[:, None, None], (*flat.shape[:2], 1))], axis=2
    )


def truth(name: str) -> PreparedSurface:
    latitude = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 300)[1:-1]
    heights = 50.0 * np.sign(latitude) * (1.0 - (1.0 - np.abs(np.sin(latitude))) ** 1.5)
    poles = np.array([[0.0, 0.0, -50.0], [0.0, 0.0, 50.0]])
    solid = close_rings(poles[0], rings(heights, radius(name, heights), 200), poles[1])
    return prepare_surface(*solid)


@pytest.mark.parametrize("name", EXPONENTS)
def test_with_touched_ends_the_solid_is_far_better_than_a_loft_of_its_contours(name):
    heights = np.linspace(-45.0, 45.0, 27)
    contours = rings(heights, radius(name, heights))
    loft = close_rings(np.array([0, 0, -45.0]), contours, np.array([0, 0, 45.0]))
    found = close_contours(heights, contours[:, :, :2], bottom=-50.0, top=50.0)
    mesh = mesh_surface(found.surface, 0.02)
    assert solidity(mesh.vertices, mesh.faces)[:3] == (True, 1, 0)
    whole = truth(name)
    near = compare_surfaces(whole, prepare_surface(mesh.vertices, mesh.faces)).chamfer
    assert near < 0.15 * compare_surfaces(whole, prepare_surface(*loft)).chamfer


def test_a_ball_is_whole_without_a_touch():
    heights = np.linspace(-45.0, 45.0, 9)
    contours = rings(heights, np.sqrt(2500.0 - heights**2))[:, :, :2]
    found = close_contours(heights, contours)
    assert (found.bottom.kind, found.top.kind) == ("pole", "pole")
    volume = measure_surface(found.surface).moments.volume
    assert volume == pytest.approx(4 / 3 * np.pi * 50.0**3, rel=1e-4)


def test_two_contours_are_enough():
    contours = rings(np.array([0.0, 10.0]), np.array([10.0, 10.0]))[:, :, :2]
    found = close_contours(np.array([0.0, 10.0]), contours, top=15.0)
    volume = measure_surface(found.surface).moments.volume
    assert volume == pytest.approx(np.pi * 100.0 * 15.0, rel=1e-3)


def test_one_contour_between_touched_ends_is_a_prism():
    contour = rings(np.zeros(1), np.full(1, 10.0))[:, :, :2]
    found = close_contours(np.zeros(1), contour, bottom=-5.0, top=15.0)
    volume = measure_surface(found.surface).moments.volume
    assert volume == pytest.approx(np.pi * 100.0 * 20.0, rel=1e-3)


@pytest.mark.parametrize("ends", [(0,), (-1,), (0, -1)])
def test_hard_case_49_a_contour_that_collapsed_to_a_point_closes_the_end(ends):
    heights = np.linspace(-45.0, 45.0, 13)
    heights[list(ends)] = np.sign(heights[list(ends)]) * 50.0
    contours = rings(heights, np.sqrt(2500.0 - heights**2))[:, :, :2]
    found = close_contours(heights, contours)
    whole = measure_surface(found.surface)
    assert whole.moments.volume == pytest.approx(4 / 3 * np.pi * 50.0**3, rel=1e-3)
    mesh = mesh_surface(found.surface, 0.1)
    assert solidity(mesh.vertices, mesh.faces)[:3] == (True, 1, 0)
    assert np.isfinite(mesh.vertices).all()


@pytest.mark.parametrize(
    ("count", "radius", "told"), [(0, 1.0, {}), (1, 1.0, {"top": 1.0}), (3, 0.0, {})]
)
def test_too_few_contours_are_refused(count, radius, told):
    heights = np.arange(count, dtype=float)
    contours = rings(heights, np.full(count, radius))[:, :, :2]
    with pytest.raises(ValueError, match="heights must be at least 2 unless both ends were"):
        close_contours(heights, contours, **told)


TURN = 2.0 * np.pi * np.arange(24) / 24


def ball(count: int, corner: float = 2.0) -> list[Floats]:
    """Contours of a ball, squarer with a larger exponent."""
    cosine, sine = np.cos(TURN), np.sin(TURN)
    shape = (np.abs(cosine) ** corner + np.abs(sine) ** corner) ** (-1.0 / corner)
    heights = np.linspace(0.0, 1.0, count)
    radii = 0.3 * np.sqrt(1.02 - (2.0 * heights - 1.0) ** 2)
    return [
        np.column_stack([radius * shape * cosine, radius * shape * sine, np.full(24, height)])
        for radius, height in zip(radii, heights, strict=True)
    ]


@pytest.mark.parametrize("method", ["skin", "lattice"])
def test_an_end_far_out_is_a_piece_of_its_own_where_the_side_would_turn_inside_out(method):
    solid = reconstruct(ball(4, 20.0), tops=[[0, 0, -0.2], [0, 0, 1.2]], method=method)
    assert solid.closed is not None
    assert (solid.closed.bottom.kind, solid.closed.top.kind) == ("conic", "conic")
    assert solid.closed.bottom.apart or solid.closed.top.apart
    assert solid.health()["apart_below"] + solid.health()["apart_above"] >= 1.0
    assert solid.check()[:4] == (True, True, 0, 0)
    reached = solid.mesh().vertices[:, 2]
    assert (reached.min(), reached.max()) == pytest.approx((-0.2, 1.2), abs=1e-9)


def test_the_side_of_a_ball_runs_on_to_its_poles():
    solid = reconstruct(ball(9), tops=[[0, 0, -0.005], [0, 0, 1.005]], method="skin")
    assert solid.closed is not None
    assert solid.closed.top.round and not solid.closed.top.apart
    assert solid.health()["apart_above"] == 0.0
    surface = solid.closed.loft.surface
    assert not runs_through_axis(surface, 1.0, 1.005)
    inverted = replace(
        surface,
        control=surface.control * np.linspace(1.0, -1.0, len(surface.control))[:, None, None],
    )
    assert runs_through_axis(inverted, 0.4, 1.0)


Make = Callable[..., Any]
Closed = Callable[[Mesh], bool]
NINE = np.linspace(-0.94, 0.94, 9)
BALL = ([0.03] * 3, [1.0, 1.0])
V, TURNS = np.linspace(0.002, 0.998, 60), np.arange(48) / 48


def rms(error: Floats) -> float:
    return float(np.sqrt(np.mean(error**2)))


def places(solid: LatticeSolid) -> Floats:
    return solid.surface.at(V[:, None], TURNS).reshape(-1, 3)


def is_whole(solid: LatticeSolid, is_closed: Closed) -> bool:
    mesh = solid.mesh(1e-3 * solid.surface.size)
    return is_closed(Mesh(mesh.vertices, mesh.faces)) and bool(np.isfinite(mesh.vertices).all())


@pytest.mark.parametrize(
    ("size", "exponents", "mean", "most"),
    [
        (*BALL, 5e-6, 30e-6),
        ([0.04, 0.025, 0.03], [1.0, 1.0], 5e-6, 30e-6),
        ([0.025, 0.025, 0.04], [0.1, 1.0], 10e-6, 0.1e-3),
        ([0.03, 0.02, 0.025], [0.5, 0.3], 30e-6, 0.25e-3),
        ([0.03, 0.02, 0.04], [0.1, 0.1], 10e-6, 50e-6),
    ],
)
def test_nine_contours_and_a_touched_top_give_the_object_back(
    size: list[float], exponents: list[float], mean: float, most: float,
    oracle: Make, is_closed: Closed,
) -> None:  # fmt: skip
    true = oracle(size, exponents)
    solid = true.rebuilt(NINE)
    error = true.distances(places(solid))
    assert (rms(error) < mean, np.abs(error).max() < most) == (True, True)
    assert solid.health()["radial_unused"] == 0.0
    assert is_whole(solid, is_closed)


@pytest.mark.parametrize("shares", [[0.0], [0.4], [-0.5, 0.5], [-0.8, 0.0, 0.8]])
def test_a_few_contours_give_a_closed_solid_that_stands_on_the_platform(shares, oracle, is_closed):
    solid = oracle(*BALL).rebuilt(shares)
    assert is_whole(solid, is_closed)
    points = places(solid)
    assert solid.surface.at(0.0, 0.0)[2] == pytest.approx(0.0, abs=1e-6)
    assert points[:, 2].max() == pytest.approx(0.06, abs=2e-4)


def test_a_top_that_nobody_touched_is_told_to_be_open_by_the_contours_distance(oracle):
    solid = oracle([0.025, 0.025, 0.04], [0.05, 1.0]).rebuilt([-0.6, 0.0, 0.6], top=False)
    assert solid.uncovered[0] == 0.0
    assert solid.uncovered[1] == pytest.approx(0.6 * 0.04, rel=0.01)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
@pytest.mark.parametrize("shares", [[0.0], NINE])
def test_the_solid_of_a_larger_object_is_larger_and_else_the_same(scale, shares, oracle):
    size, exponents = [0.04, 0.025, 0.03], [1.0, 0.8]
    one = oracle(size, exponents).rebuilt(shares)
    other = oracle(size, exponents, scale).rebuilt(shares)
    assert np.allclose(places(other) / scale, places(one), rtol=0, atol=1e-8)


@pytest.mark.parametrize("method", ["skin", "draft"])
def test_the_order_of_the_contours_and_of_the_touches_does_not_matter(method, oracle):
    contours, contacts, tops = oracle(*BALL).evidence(NINE)
    touches = np.array_split(np.arange(len(contacts.points)), 90)
    shuffled = np.concatenate([touches[i] for i in np.random.default_rng(1).permutation(90)])
    for order in (np.arange(len(contacts.points))[::-1], shuffled):
        numbers = contacts.touch[order]
        met = ContactPoints(contacts.points[order], contacts.normals[order], numbers)
        one = reconstruct(contours, patches=contacts, tops=tops, method=method)
        other = reconstruct(contours[::-1], patches=met, tops=tops, method=method)
        assert np.allclose(places(one), places(other), rtol=0, atol=1e-12)


def test_the_figures_of_the_fit_are_told(oracle):
    contours, contacts, tops = oracle(*BALL).evidence(NINE)
    solid = reconstruct(contours, patches=contacts, tops=tops, method="skin")
    health = solid.health()
    assert 0.9 * len(contacts.points) < health["radial_points"] <= len(contacts.points)
    assert health["radial_rms"] < 1e-6
    assert health["sigma"] == health["radial_sigma"] < 1e-6
    assert 1.0 < health["radial_condition"] < 1e10
    assert (health["radial_pose_blocks"], health["radial_stretched"]) == (0.0, 0.0)
    assert 0.0 < health["radial_untouched_gap"] < 0.01
    uncertainty = solid.uncertainty()
    assert uncertainty is not None
    assert 0.0 < uncertainty.rms < uncertainty.most < 1e-3


def test_a_side_that_was_touched_at_one_height_alone_is_stretched_and_it_is_told(oracle):
    contours, contacts, tops = oracle([0.03, 0.03, 0.4], [1.0, 1.0]).evidence([0.0], top=False)
    solid = reconstruct(contours, patches=contacts, tops=tops, method="skin")
    assert solid.health()["radial_stretched"] == 1.0


def kidney(points: int) -> tuple[Floats, Floats]:
    """A thick arc of 300 degrees, from whose middle nothing is seen whole, and its normals."""
    turn = np.linspace(0.15, 2 * np.pi - 0.15, points)
    out = np.column_stack([np.cos(turn), np.sin(turn)])
    ring = np.concatenate([0.04 * out, 0.025 * out[::-1]])
    return ring, np.concatenate([out, -out[::-1]])


def test_sections_that_are_not_star_shaped_are_left_to_the_contours_and_it_is_told():
    ring, across = kidney(120)
    heights = np.linspace(0.01, 0.05, 5)
    contours = [np.column_stack([ring, np.full(len(ring), z)]) for z in heights]
    normals = np.column_stack([across, np.zeros(len(across))])
    tops = np.array([[0.03, 0.0, 0.0], [0.03, 0.0, 0.06]])
    for given in (normals, None):
        contacts = ContactPoints(
            np.concatenate(contours),
            None if given is None else np.tile(given, (5, 1)),
            np.zeros(5 * len(ring), np.int32),
        )
        solid = reconstruct(contours, patches=contacts, tops=tops, method="skin")
        alone = reconstruct(contours, tops=tops, method="skin")
        assert solid.health()["radial_unused"] == 1.0
        assert np.array_equal(places(solid), places(alone))


def test_a_handful_of_points_is_left_out_and_it_is_told(oracle):
    contours, contacts, tops = oracle(*BALL).evidence(NINE)
    few = ContactPoints(contacts.points[:50], contacts.normals[:50], contacts.touch[:50])
    health = reconstruct(contours, patches=few, tops=tops, method="skin").health()
    assert health["radial_unused"] == 1.0


def test_normals_tell_what_lies_between_a_few_contours(oracle):
    true = oracle([0.05, 0.04, 0.05], [0.4, 0.9])
    contours, _, tops = true.evidence([-0.9, -0.45, 0.0, 0.45, 0.9])
    normals = [true.contacts_at(contour).normals for contour in contours]
    plain = reconstruct(contours, tops=tops, method="skin")
    with_them = reconstruct(contours, normals=normals, tops=tops, method="skin")
    assert with_them.health()["radial_unused"] == 0.0
    errors = [rms(true.distances(places(one))) for one in (with_them, plain)]
    assert errors[0] < 0.5 * errors[1]


@pytest.mark.parametrize("name", ["ball", "cylinder"])
def test_what_a_finger_touches_gives_the_object_back(name, finger, domed, oracle, request):
    shape: Superquadric = request.getfixturevalue(name)
    half = float(shape.size[2])
    hand = finger(PosedShape(shape, np.array([0, 0, half, 0, 0, 0, 1.0])), domed)
    contours = []
    for height in np.linspace(0.06, 1.94, 9) * half:
        trace, status = hand.contour(TraceGoal(height, np.zeros(2), 0.1, 150))
        assert status == "closed"
        contours.append(trace.path.points)
    for x, y in [(0.0, 0.0), *((x, y) for x in (-0.01, 0.01) for y in (-0.01, 0.01))]:
        hand.press(pose_of(np.array([x, y, 2 * half + 6e-3]), FACING_DOWN), 0.05, 1e-3, 0.0)
    tops = np.array([[0, 0, 0.0], [0, 0, 2 * half]])
    solid = reconstruct(contours, patches=stack_points(hand.contacts), tops=tops, method="skin")
    error = oracle(shape.size, shape.exponents).distances(places(solid))
    assert (rms(error) < 20e-6, np.abs(error).max() < 0.3e-3) == (True, True)
