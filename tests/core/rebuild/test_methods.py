from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.measure.solidity import solidity
from palpate.core.rebuild.felt.felt_points import FeltPoints
from palpate.core.rebuild.reconstruct import reconstruct
from palpate.core.rebuild.recovery.recovery import Recovery
from palpate.core.rebuild.solid import Method

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
def test_every_method_gives_a_closed_solid(method: Method, faithful: bool, off: float) -> None:
    solid = reconstruct(EGG, method=method, faithful=faithful)

    mesh = solid.mesh()
    found = solidity(mesh.vertices, mesh.faces)
    assert (solid.method, found.watertight, found.genus) == (method, True, 0)
    assert solid.measures().moments.volume == pytest.approx(VOLUME, rel=off)
    assert solid.search().inside(np.zeros((1, 3))).all()
    assert all(np.isfinite(value) for value in solid.health().values())


def test_what_does_not_come_from_a_skin_claims_no_uncertainty() -> None:
    said = reconstruct(EGG, method="skin").uncertainty()

    assert said is not None and said.most > 0.0
    assert reconstruct(EGG, method="coarse").uncertainty() is None
    assert reconstruct(EGG, method="thesis").uncertainty() is None


def test_the_program_differs_from_what_is_right() -> None:
    right, program = (reconstruct(EGG, method="thesis", faithful=f) for f in (False, True))

    assert program.health()["widest_gap"] > 0.01 > right.health()["widest_gap"]


def test_a_superquadric_says_how_well_it_fits() -> None:
    bulge = [ring * np.array([1 + 0.3 * np.sin(ring[0, 2] / 5), 1, 1]) for ring in EGG]

    fits, misses = (reconstruct(c, method="coarse").health()["rms"] for c in (EGG, bulge))

    assert fits < 1e-9 < 1.0 < misses


@pytest.mark.parametrize(
    ("contours", "options", "sentence"),
    [
        (EGG, {"method": "loft"}, "method must be one of lattice, skin, thesis, coarse"),
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
def test_what_a_method_cannot_do_is_refused(
    contours: list[Floats], options: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(ValueError, match=re.escape(sentence)):
        reconstruct(contours, **options)


@pytest.mark.parametrize("size", [(6,), (3, 12), (500, 500), (8, 8.0), "ab", (16, 600)])
def test_a_lattice_of_no_size_or_of_too_much_is_refused(size: Any) -> None:
    with pytest.raises(ValueError, match="size must be two whole numbers, from 4 to 64 across"):
        reconstruct(EGG, size=size)


def test_the_lattice_is_put_around_the_section_that_a_grasp_found() -> None:
    found = reconstruct(EGG, method="coarse").model
    assert isinstance(found, Recovery)

    fitted, grasped = reconstruct(EGG), reconstruct(EGG, grasp=found)

    assert fitted.lattice is not None and grasped.lattice is not None
    assert grasped.lattice.section.half_extent == pytest.approx(found.size[:2], rel=0.02)
    assert grasped.measures().moments.volume == pytest.approx(VOLUME, rel=1e-3)
    with pytest.raises(ValueError, match="size and grasp must be left out"):
        reconstruct(EGG, method="skin", grasp=found)


def test_what_is_no_patches_is_refused() -> None:
    with pytest.raises(ValueError, match=r"patches must be FeltPoints\(.*\), got int"):
        reconstruct(EGG, patches=3)  # type: ignore[arg-type]


def test_the_side_says_its_deviation_place_by_place() -> None:
    heights, turns = np.linspace(-20.0, 20.0, 5), np.arange(4) / 4

    traced, coarse = reconstruct(EGG), reconstruct(EGG, method="coarse")
    rng = np.random.default_rng(0)
    points = np.concatenate(EGG) + 0.05 * rng.normal(size=(sum(map(len, EGG)), 3))
    numbers = np.repeat(np.arange(len(EGG), dtype=np.int32), [len(ring) for ring in EGG])
    felt = reconstruct(EGG, patches=FeltPoints(points, None, numbers))

    for solid in (traced, felt):
        said = solid.deviation(heights, turns)
        assert said is not None and said.shape == (5, 4) and (said >= 0.0).all()
    assert coarse.deviation(heights, turns) is None
