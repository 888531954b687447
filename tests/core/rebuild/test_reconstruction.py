from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.geometry.meshes import solidity
from palpate.core.poses import pose_of
from palpate.core.rebuild import reconstruction
from palpate.core.rebuild.contours.contacts import ContactPoints
from palpate.core.rebuild.reconstruction import coarse_patch, fit_coarse, reconstruct
from palpate.core.rebuild.recovery import recover
from palpate.core.rebuild.recovery.report import Recovery
from palpate.core.rebuild.solid import LatticeSolid, Method
from palpate.core.rebuild.surface.closed import closed_surface, measure_surface
from palpate.core.shapes.deformed_superquadrics import DeformedSuperquadric
from palpate.core.shapes.global_deformations import Bend
from palpate.core.shapes.protocol import PosedShape
from palpate.core.shapes.superquadric_measures import area_samples, sampled_surface
from palpate.core.shapes.superquadrics import Superquadric
from palpate.core.shapes.tessellations import icosphere

RADIUS, HALF = 30.0, 50.0
TOPS = np.array([[0.0, 0.0, HALF], [1.0, 2.0, -HALF]])


def ball(count: int, around: int, seed: int = 0, noise: float = 0.0) -> list[Floats]:
    """Contours of a ball of 100 mm, begun anywhere, in either direction and in no order."""
    rng = np.random.default_rng(seed)
    contours = []
    for height in np.linspace(-HALF + 0.5, HALF - 0.5, count):
        many = int(rng.integers(around, around + around // 4))
        turn = 2 * np.pi * (np.arange(many) / many + rng.random())
        radius = np.sqrt(HALF**2 - height**2)
        ring = np.column_stack(
            [radius * np.cos(turn), radius * np.sin(turn), np.full(many, height)]
        )
        contours.append((ring + noise * rng.normal(size=ring.shape))[:: rng.choice([-1, 1])])
    return [contours[i] for i in rng.permutation(count)]


@cache
def plain_ball() -> LatticeSolid:
    return reconstruct(ball(15, 60), tops=TOPS)


def prism(count: int) -> list[Floats]:
    turn = 2 * np.pi * np.arange(60) / 60
    ring = RADIUS * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(60)])
    return [ring + [0.0, 0.0, height] for height in np.linspace(-HALF + 0.5, HALF - 0.5, count)]


def eight(height: float) -> Floats:
    turn = 2 * np.pi * np.arange(60) / 60
    return np.column_stack([RADIUS * np.sin(turn), RADIUS * np.sin(2 * turn), np.full(60, height)])


def test_a_ball_comes_back_from_contours_in_any_order_and_direction():
    rebuilt = plain_ball()
    measures = rebuilt.measures()
    assert measures.volume_m3 == pytest.approx(4 / 3 * np.pi * HALF**3, rel=1e-4)
    assert measures.area_m2 == pytest.approx(4 * np.pi * HALF**2, rel=1e-4)
    assert (rebuilt.closed.bottom.kind, rebuilt.closed.top.kind) == ("conic", "conic")


def test_the_mesh_is_closed_of_one_piece_and_as_fine_as_asked_for():
    rebuilt = plain_ball()
    coarse, fine = rebuilt.mesh(1.0), rebuilt.mesh(0.1)
    assert len(fine.faces) > 2 * len(coarse.faces)
    for mesh in (coarse, fine):
        found = solidity(mesh.vertices, mesh.faces)
        assert found.watertight and found.genus == 0
    exact = rebuilt.search().nearest(0.5 * (fine.vertices[0] + fine.vertices[1])[None])
    assert np.isfinite(exact.distances).all()


def test_noise_is_smoothed_and_estimated():
    rebuilt = reconstruct(ball(27, 80, noise=0.2), tops=TOPS)
    mesh = rebuilt.mesh(0.02)
    radii = np.linalg.norm(mesh.vertices, axis=1)
    assert rebuilt.health()["sigma"] == pytest.approx(0.2, rel=0.15)
    assert np.sqrt(np.mean((radii - HALF) ** 2)) < 0.1


def test_a_touched_end_is_where_it_was_touched_and_an_untouched_flat_one_is_doubted():
    touched, open_ended = reconstruct(prism(11), tops=TOPS), reconstruct(prism(11))
    assert np.ptp(touched.mesh().vertices[:, 2]) == pytest.approx(2 * HALF)
    assert touched.uncovered == (0.0, 0.0)
    assert np.ptp(open_ended.mesh().vertices[:, 2]) == pytest.approx(2 * HALF - 1.0)
    assert min(open_ended.uncovered) == pytest.approx(9.9)


def test_a_control_lattice_takes_the_shape_of_the_side():
    lattice = plain_ball().lattice
    assert lattice.health.rms < 1e-4 * HALF
    assert lattice.health.folded == 0.0


@pytest.mark.parametrize(
    ("contours", "tops", "words"),
    [
        ([], None, "contours must"),
        ([np.zeros((5, 3))], None, "contours must"),
        (
            prism(1),
            None,
            "contours must leave at least 2 to rebuild from, or 1 with tops .*, got 1$",
        ),
        ([1e-300 * one for one in prism(4)], None, "contours and tops must span from 1e-50"),
        ([1e60 * one for one in prism(4)], None, "contours and tops must span from 1e-50"),
        (prism(4), [[0.0, 0.0, 1e300]], "contours and tops must span from 1e-50"),
        ([eight(-HALF), eight(HALF)], None, "contours must run around an area"),
        (prism(4), [[0.0, 0.0]], "tops must have shape"),
        (prism(4), [[0.0, 0.0, np.nan]], "tops must be finite"),
    ],
)
def test_what_cannot_be_rebuilt_is_refused(contours, tops, words):
    with pytest.raises(ValueError, match=words):
        reconstruct(contours, tops=tops)


def test_no_tops_may_be_an_empty_list():
    assert reconstruct(prism(4), tops=[]).uncovered == reconstruct(prism(4)).uncovered


def test_a_side_through_contours_close_together_and_unlike_does_not_swing_out():
    even = plain_ball()
    low, high = prism(2)
    narrow = np.array([0.6, 0.6, 1.0])
    step = reconstruct(
        [low, high * [1.0, 1.0, 0.0], narrow * high * [1.0, 1.0, 0.02], narrow * high],
        method="skin",
    )
    assert even.overshoot < 0.01 and even.health()["reparametrised"] == 0.0
    assert step.health()["overshoot"] == step.overshoot < 0.1
    assert step.health()["reparametrised"] == 1.0


@pytest.mark.parametrize("share", [0.002, 0.05, 100.0])
def test_a_wild_side_is_meshed_however_coarsely(share):
    wide = prism(9)
    contours = [one * [0.1, 0.1, 1.0] if row % 2 else one for row, one in enumerate(wide)]
    rebuilt = reconstruct(contours)
    mesh = rebuilt.mesh(share * rebuilt.surface.size)
    found = solidity(mesh.vertices, mesh.faces)
    assert found.watertight and found.genus == 0


@pytest.mark.parametrize("count", [9, 11, 12, 15])
def test_of_few_contours_a_neck_that_one_alone_has_touched_stays_and_is_listed(count):
    contours = prism(count)
    which = count // 2
    contours[which] = contours[which] * [0.8, 0.8, 1.0]
    rebuilt = reconstruct(contours, tops=TOPS, method="skin")
    listed = [one.which for one in rebuilt.evidence.feature_candidates]
    dropped = [(one.which, one.may_be_feature) for one in rebuilt.slices.dropped]
    assert (listed, dropped) == (([which], []) if count < 12 else ([], [(which, True)]))


def test_of_few_contours_one_of_another_shape_goes():
    contours = prism(9)
    turn = 2 * np.pi * np.arange(60) / 60
    contours[4] = contours[4] * (1 + 0.3 * np.cos(3 * turn))[:, None] ** [1, 1, 0]
    dropped = reconstruct(contours, tops=TOPS, method="skin").slices.dropped
    assert [(one.which, one.may_be_feature) for one in dropped] == [(4, False)]


TURN = 2 * np.pi * np.arange(48) / 48
VOLUME = 4 / 3 * np.pi * 50.0 * 40.0 * 30.0


def egg(heights: Floats, points: int = 48) -> list[Floats]:
    turn = 2 * np.pi * np.arange(points) / points
    share = np.sqrt(1.0 - (heights / 30.0) ** 2)
    return [
        np.column_stack([50 * s * np.cos(turn), 40 * s * np.sin(turn), np.full(points, z)])
        for s, z in zip(share, heights, strict=True)
    ]


EGG = egg(np.linspace(-29.5, 29.5, 15))


@cache
def whole(method: Method, faithful: bool = False) -> LatticeSolid:
    return reconstruct(EGG, method=method, faithful=faithful)


@pytest.mark.parametrize(
    ("method", "faithful", "off"),
    [
        ("lattice", False, 1e-3),
        ("skin", False, 1e-3),
        ("thesis", False, 0.06),
        ("thesis", True, 0.06),
        ("coarse", False, 1e-6),
    ],
)
def test_every_method_gives_a_closed_solid(method, faithful, off):
    solid = whole(method, faithful)
    mesh = solid.mesh()
    found = solidity(mesh.vertices, mesh.faces)
    assert (solid.method, found.watertight, found.genus) == (method, True, 0)
    if not faithful:
        assert solid.volume == pytest.approx(VOLUME, rel=off)
    assert solid.search().inside(np.zeros((1, 3))).all()
    assert all(np.isfinite(value) for value in solid.health().values())


def test_what_does_not_come_from_a_loft_claims_no_uncertainty():
    told = whole("skin").uncertainty()
    assert told is not None and told.most > 0.0
    for solid in (whole("coarse"), whole("thesis")):
        assert solid.uncertainty() is None is solid.whole_deviation()


def test_the_program_differs_from_what_is_right():
    right, program = whole("thesis"), whole("thesis", True)
    assert program.health()["widest_gap"] > 0.01 > right.health()["widest_gap"]


def test_a_superquadric_tells_how_well_it_fits():
    bulge = [ring * np.array([1 + 0.3 * np.sin(ring[0, 2] / 5), 1, 1]) for ring in EGG]
    misses = reconstruct(bulge, method="coarse").health()["rms"]
    assert whole("coarse").health()["rms"] < 1e-9 < 1.0 < misses


@pytest.mark.parametrize(
    ("contours", "options", "sentence"),
    [
        (EGG, {"method": "loft"}, "method must be one of lattice, skin, draft, thesis, coarse"),
        (EGG, {"method": "skin", "faithful": True}, "faithful goes with the method 'thesis'"),
        (
            [*EGG[:3], *egg(np.array([10.0]), 40)],
            {"method": "thesis", "faithful": True},
            "contours must have as many points each, got 40 to 48",
        ),
        (
            [EGG[7]],
            {"method": "coarse"},
            "contours must determine a superquadric, got coplanar points",
        ),
    ],
)
def test_what_a_method_cannot_do_is_refused(contours, options, sentence):
    with pytest.raises(ValueError, match=re.escape(sentence)):
        reconstruct(contours, **options)


@pytest.mark.parametrize("size", [(6,), (3, 12), (500, 500), (8, 8.0), "ab", (16, 600)])
def test_a_lattice_of_no_size_or_of_too_much_is_refused(size):
    with pytest.raises(ValueError, match="size must be two whole numbers, from 4 to 64 across"):
        reconstruct(EGG, size=size)


def test_the_lattice_is_put_around_the_section_that_a_grasp_found():
    found = whole("coarse").model
    assert isinstance(found, Recovery)
    fitted, grasped = whole("lattice"), reconstruct(EGG, grasp=found)
    assert fitted.lattice is not None and grasped.lattice is not None
    assert grasped.lattice.section.half_extent == pytest.approx(found.size[:2], rel=0.02)
    assert grasped.volume == pytest.approx(VOLUME, rel=1e-3)
    with pytest.raises(ValueError, match="size and grasp must be left out"):
        reconstruct(EGG, method="skin", grasp=found)


def test_what_is_no_patches_is_refused():
    with pytest.raises(ValueError, match=r"patches must be ContactPoints\(.*\), got int"):
        reconstruct(EGG, patches=3)  # type: ignore[arg-type]


def test_the_side_tells_its_deviation_place_by_place():
    heights, turns = np.linspace(-20.0, 20.0, 5), np.arange(4) / 4
    traced, coarse = whole("lattice"), whole("coarse")
    rng = np.random.default_rng(0)
    points = np.concatenate(EGG) + 0.05 * rng.normal(size=(sum(map(len, EGG)), 3))
    numbers = np.repeat(np.arange(len(EGG), dtype=np.int32), [len(ring) for ring in EGG])
    contacts = reconstruct(EGG, patches=ContactPoints(points, None, numbers))
    for solid in (traced, contacts):
        told = solid.deviation(heights, turns)
        assert told is not None and told.shape == (5, 4) and (told >= 0.0).all()
    assert coarse.deviation(heights, turns) is None


UPDATE_TOPS = np.array([[0.0, 0.0, 50.0], [0.0, 0.0, -50.0]])


def contours(count: int = 15, noise: float = 0.2, seed: int = 0) -> list[Floats]:
    """Of a lobed vase: begun anywhere, of many counts, with a few points far off."""
    rng = np.random.default_rng(seed)
    found = []
    for z in np.linspace(-49, 49, count):
        many = int(rng.integers(50, 80))
        turn = 2 * np.pi * (np.arange(many) / many + rng.random())
        radius = (30 + 8 * np.sin(z / 25)) * (1 + 0.1 * np.cos(3 * turn + 0.01 * z))
        one = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.full(many, z)])
        one += noise * rng.normal(size=one.shape)
        one[rng.integers(many), :2] *= 1.1
        found.append(one[:: rng.choice([-1, 1])])
    return found


def apart(one: LatticeSolid, other: LatticeSolid) -> float:
    rows, turns = np.linspace(0.0, 1.0, 41)[:, None], np.arange(30)[None] / 30
    return float(np.abs(one.surface.at(rows, turns) - other.surface.at(rows, turns)).max())


@pytest.mark.parametrize("method", ["skin", "lattice"])
def test_one_contour_more_is_a_fit_of_all_at_once(method):
    given = contours()
    at_once = reconstruct(given, tops=UPDATE_TOPS, method=method)
    updated = reconstruct(given[:-4], tops=UPDATE_TOPS, method=method)
    for one in given[-4:]:
        updated = updated.update(one)
    assert apart(updated, at_once) == 0.0
    assert updated.health() == at_once.health()
    assert updated.slices.rows.tolist() == at_once.slices.rows.tolist()


def test_contours_may_arrive_in_any_order():
    given = contours()
    given.append(given[4].copy())  # two of them say the same
    at_once = reconstruct(given, tops=UPDATE_TOPS, method="skin")
    for seed in range(1):
        order = np.random.default_rng(seed).permutation(len(given))
        solid = reconstruct(
            [given[i] for i in order[:3]], tops=UPDATE_TOPS[:0].tolist(), method="skin"
        )
        assert solid.evidence.tops is None
        solid = reconstruct([given[i] for i in order[:10]], tops=UPDATE_TOPS, method="skin")
        for i in order[10:]:
            solid = solid.update(given[i])
        assert apart(solid, at_once) < 1e-12 * 50.0


def test_a_plane_contour_comes_with_its_height():
    given = contours(9, 0.0)
    at_once = reconstruct([one[:, :2] for one in given], heights=[one[0, 2] for one in given])
    most = reconstruct([one[:, :2] for one in given[1:]], heights=[one[0, 2] for one in given[1:]])
    assert apart(most.update(given[0][:, :2], height=given[0][0, 2]), at_once) < 1e-12 * 50.0


def test_a_contour_that_cannot_be_used_is_listed_and_changes_nothing():
    solid = reconstruct(contours(), tops=UPDATE_TOPS, method="skin")
    updated = solid.update(np.zeros((2, 3)))
    assert updated.slices.dropped[-1].which == 15
    assert apart(updated, solid) == 0.0


def test_what_is_no_contour_is_refused():
    solid = reconstruct(contours(5), tops=UPDATE_TOPS, method="skin")
    with pytest.raises(ValueError, match=r"contour 5 must have shape \(any, 3\)"):
        solid.update(np.zeros((4, 2)))
    bare = LatticeSolid(surface=solid.surface, method="skin", evidence=solid.evidence)
    with pytest.raises(ValueError, match="solid must be rebuilt by reconstruct to be updated"):
        bare.update(contours(5)[0])


BASE = Superquadric(np.array([30.0, 20.0, 50.0]), np.array([0.6, 0.9]))


def test_taper_and_bend_are_fitted_where_the_points_ask_for_them():
    rng = np.random.default_rng(3)
    plain = area_samples(sampled_surface(BASE), 900, rng)
    tapered = area_samples(sampled_surface(BASE, taper=np.array([-0.3, -0.2])), 900, rng)
    straight, narrowed = fit_coarse(plain + 0.1 * rng.normal(size=plain.shape)), fit_coarse(tapered)
    assert "taper x" not in straight.names
    assert narrowed.taper == pytest.approx([-0.3, -0.2], abs=1e-3)


def test_its_patch_is_the_surface_of_the_solid_where_it_stands():
    bend = Bend(0.005, 0.7)
    warped = PosedShape(
        DeformedSuperquadric(BASE, np.array([0.2, -0.1]), bend),
        pose_of(np.array([5.0, -3.0, 8.0]), np.eye(3)),
    )
    mesh = warped.mesh(5)
    found = fit_coarse(mesh.vertices)
    surface = closed_surface((coarse_patch(found),))
    triangles = mesh.vertices[mesh.faces]
    volume = (
        np.einsum("ni,ni->n", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum() / 6
    )
    assert measure_surface(surface).moments.volume == pytest.approx(volume, rel=5e-3)


def test_every_step_is_named_and_closed_and_naming_them_changes_nothing():
    told: list[str] = []

    @contextmanager
    def step(name: str) -> Iterator[None]:
        told.append(name)
        yield
        told.append(f"end of {name}")

    rings = ball(9, 40)
    named = reconstruct(rings, tops=TOPS, step=step)
    assert told == [
        "contours",
        "end of contours",
        "cross-validation",
        "ends",
        "end of ends",
        "end of cross-validation",
        "lattice",
        "end of lattice",
    ]
    plain = reconstruct(rings, tops=TOPS)
    np.testing.assert_array_equal(named.mesh(1.0).vertices, plain.mesh(1.0).vertices)


def test_what_fits_within_the_noise_is_neither_tapered_nor_bent_nor_tried_so(monkeypatch):
    tried = []

    def counted(points, **how):
        tried.append((how["taper"], how["bend"]))
        return recover(points, **how)

    monkeypatch.setattr(reconstruction, "recover", counted)
    points = 0.03 * icosphere(1)[0]
    assert not fit_coarse(points, noise=1e-4).taper.any()
    assert tried == [(False, False)]
    narrowed = points * (1.0 + 10.0 * points[:, 2:]) ** [1, 1, 0]
    assert fit_coarse(narrowed, noise=1e-4).taper.any()
    assert tried[1:3] == [(False, False), (True, False)]
