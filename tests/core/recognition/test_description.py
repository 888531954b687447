"""Laws of the description of a closed surface, and of its scatter over noisy copies."""

from functools import cache

import numpy as np
import pytest

from palpate.core import recognition, shapes
from palpate.core.arrays import Floats
from palpate.core.geometry import nearest_points, nearest_search, signed_volume, solidity
from palpate.core.poses import Pose
from palpate.core.recognition import FEATURES, Description, describe, feature_vector, noisy_copy

NAMES = [one.name for one in FEATURES]


def superquadric(*size: float, exponents: tuple[float, float] = (1.0, 1.0)) -> shapes.Superquadric:
    return shapes.Superquadric(np.array(size), np.array(exponents))


def bored(outer: tuple, hole: tuple, height: float) -> shapes.BooleanShape:
    """An upright cylinder without another one, whose middle is higher by `height`."""
    parts = [
        shapes.PosedSolid(
            superquadric(*size, exponents=(0.1, 1.0)), Pose(np.array([0.0, 0.0, z]), np.eye(3))
        )
        for size, z in ((outer, 0.0), (hole, height))
    ]
    return shapes.BooleanShape(shapes.difference(*parts))


BODIES = {
    "ball": superquadric(0.04, 0.04, 0.04),
    "egg": shapes.DeformedSuperquadric(
        superquadric(0.03, 0.025, 0.04, exponents=(1.0, 0.9)),
        np.array([-0.2, -0.2]),
        shapes.Bend(0.0),
    ),
    "horn": shapes.DeformedSuperquadric(
        superquadric(0.03, 0.02, 0.05, exponents=(0.8, 0.7)),
        np.array([0.3, -0.1]),
        shapes.Bend(4.0, 0.6),
    ),
    "box": superquadric(0.035, 0.025, 0.045, exponents=(0.1, 0.1)),
    "tube": bored((0.025, 0.025, 0.04), (0.018, 0.018, 0.06), 0.0),
    "cup": bored((0.04, 0.04, 0.05), (0.035, 0.035, 0.05), 0.008),
}


@cache
def mesh_of(name: str, level: int = 3) -> shapes.Mesh:
    return BODIES[name].mesh(level)


@cache
def described(name: str, level: int = 3) -> Description:
    return describe(*mesh_of(name, level))


def still(mesh: shapes.Mesh, longest: float, seed: int = 0, noise: float = 0.0) -> shapes.Mesh:
    """A copy with edges of at most `longest`, in a random pose."""
    return noisy_copy(mesh, np.random.default_rng(seed), noise, (longest, longest))


def test_box_has_true_measures():
    description = described("box", 5)
    areas = np.repeat([6.3e-3, 4.5e-3, 3.5e-3], 2)
    assert description.faces.areas == pytest.approx(areas, rel=0.2)  # its edges are round
    assert (description.faces.certainty > 0.99).all()
    cosines = np.clip(description.faces.normals @ description.faces.normals.T, -1.0, 1.0)
    angles = np.sort(np.degrees(np.arccos(cosines[np.triu_indices(6, 1)])))
    assert angles == pytest.approx([90.0] * 12 + [180.0] * 3, abs=0.5)
    assert description.fitted.size == pytest.approx([0.045, 0.035, 0.025], rel=1e-3)
    assert description.fitted.exponents == pytest.approx([0.1, 0.1], abs=0.01)
    assert (description.voids.holes, len(description.voids.pockets)) == (0, 0)
    assert description.sections.areas == pytest.approx(np.full(7, 6.3e-3 * 0.994), rel=0.02)
    sides = np.array([0.09, 0.07, 0.05])
    assert description.whole.gyration == pytest.approx(sides / np.sqrt(12), rel=0.02)
    assert description.whole.facing == pytest.approx(np.array([6.3, 4.5, 3.5]) / 14.3, rel=0.05)


def test_ball_has_round_sections_and_no_face():
    description = described("ball", 5)
    assert len(description.faces.areas) == 0
    assert description.faces.round_area == pytest.approx(description.whole.area)
    assert description.whole.volume == pytest.approx(4.0 / 3.0 * np.pi * 0.04**3, rel=2e-3)
    assert description.whole.area == pytest.approx(4.0 * np.pi * 0.04**2, rel=2e-3)
    assert description.whole.gyration == pytest.approx(np.full(3, 0.04 / np.sqrt(5.0)), rel=1e-3)
    assert description.whole.widths == pytest.approx(np.full(3, 0.08), rel=2e-3)
    assert description.whole.facing == pytest.approx(np.full(3, 1 / 3), rel=1e-2)
    assert description.whole.skew == pytest.approx(0.0, abs=1e-6)
    assert description.sections.compactness == pytest.approx(np.ones(7), abs=1e-3)
    heights = (np.arange(7) + 0.5) * 2.0 / 7.0 - 1.0
    areas = np.pi * 0.04**2 * (1.0 - heights**2)
    assert description.sections.areas == pytest.approx(areas, rel=5e-3)
    moments = np.repeat(areas[:, None] ** 2 / (4 * np.pi), 2, axis=1)
    assert description.sections.moments == pytest.approx(moments, rel=1e-2)
    assert description.fitted.residual < 1e-5


def test_holes_and_pockets_are_distinguished():
    assert (described("tube").voids.holes, described("cup").voids.holes) == (1, 0)
    for name, radius, length in (("tube", 0.018, 0.08), ("cup", 0.035, 0.092)):
        description = described(name)
        (pocket,) = description.voids.pockets
        assert pocket == pytest.approx(np.pi * radius**2 * length, rel=0.1)
        full = description.whole.volume / (1.0 - description.voids.share)
        assert description.voids.share == pytest.approx(pocket / full, abs=0.02)
        assert description.voids.certain == 1.0
    outer, inner = mesh_of("egg"), superquadric(0.012, 0.012, 0.012).mesh(3)
    vertices = np.concatenate([outer.vertices, inner.vertices])
    faces = np.concatenate([outer.faces, inner.faces[:, ::-1] + len(outer.vertices)])
    hollow = describe(vertices, faces)
    assert hollow.voids.holes == 0
    volume = signed_volume(inner.vertices[inner.faces])
    assert hollow.voids.pockets == pytest.approx([volume], rel=0.15)


@pytest.mark.parametrize("name", ["egg", "box", "tube", "cup"])
def test_description_does_not_depend_on_pose(name):
    mesh, first = mesh_of(name), feature_vector(described(name))
    assert np.array_equal(feature_vector(describe(*mesh)), first)  # to the last bit
    rng = np.random.default_rng(0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    other = feature_vector(describe(mesh.vertices @ turn.T + rng.normal(size=3), mesh.faces))
    exact = ["volume", "area", *(f"{one} radius of gyration" for one in ("largest", "middle"))]
    for feature, limit in [(one, 1e-9) for one in exact] + [
        (one, 0.25) for one in ("holes", "pockets", "plane faces")
    ]:
        i = NAMES.index(feature)
        assert other[i] == pytest.approx(first[i], abs=limit), feature


def test_only_sizes_depend_on_scale():
    mesh, small = mesh_of("egg"), feature_vector(described("egg"))
    large = feature_vector(describe(1.2 * mesh.vertices, mesh.faces))
    powers = {"log volume": 3.0, "log area": 2.0, "log length": 1.0}
    for feature, before, after in zip(FEATURES, small, large, strict=True):
        growth = powers.get(feature.kind, 0.0) * np.log(1.2)
        limit = 0.02 if feature.kind in powers else 0.1
        assert after - before == pytest.approx(growth, abs=limit), feature.name


def test_mirror_images_have_equal_sizes():
    mesh, here = mesh_of("horn"), feature_vector(described("horn"))
    there = feature_vector(describe(mesh.vertices * [1.0, 1.0, -1.0], mesh.faces[:, ::-1]))
    sizes = [i for i, one in enumerate(FEATURES) if one.kind.startswith("log")]
    assert np.abs(here - there)[sizes].max() < 0.03
    assert described("horn").whole.skew > 0.05


@pytest.mark.parametrize("name", ["egg", pytest.param("cup", marks=pytest.mark.slow)])
def test_noise_of_tenths_of_millimetre_changes_little(name):
    plain, noisy = (describe(*still(mesh_of(name), 3.3e-3, 7, noise)) for noise in (0.0, 2e-4))
    assert noisy.whole.volume == pytest.approx(plain.whole.volume, rel=0.02)
    assert noisy.whole.gyration == pytest.approx(plain.whole.gyration, rel=0.01)
    assert noisy.voids.holes == plain.voids.holes
    assert noisy.faces.certainty.sum() == pytest.approx(plain.faces.certainty.sum(), abs=0.5)
    assert noisy.sections.areas == pytest.approx(plain.sections.areas, rel=0.08)


@pytest.mark.parametrize(
    ("stretch", "longest"), [(1.0, 0.02), (1.0, 0.0093), ([3.0, 1.0, 0.2], 0.006)]
)
def test_refined_copy_has_same_surface(stretch, longest):
    vertices, faces = superquadric(0.05, 0.05, 0.05).mesh(0)
    coarse = shapes.Mesh(vertices * stretch, faces)
    fine, before = still(coarse, longest), solidity(*coarse)
    after = solidity(*fine)
    assert (after.watertight, after.genus) == (True, 0)
    assert after.volume == pytest.approx(before.volume, rel=1e-12)
    edges = fine.vertices[fine.faces] - fine.vertices[np.roll(fine.faces, -1, axis=1)]
    assert np.linalg.norm(edges, axis=2).max() <= longest
    corners = fine.vertices[: len(coarse.vertices)][coarse.faces]  # old vertices come first
    assert nearest_points(nearest_search(corners), fine.vertices).distances.max() < 1e-15


def test_noisy_copy_is_near_surface_and_repeatable():
    copy, again = (noisy_copy(mesh_of("ball"), np.random.default_rng(3)) for _ in range(2))
    assert np.array_equal(copy.vertices, again.vertices)
    middle = copy.vertices.mean(axis=0)
    off = np.linalg.norm(copy.vertices - middle, axis=1) - 0.04
    assert off.std() == pytest.approx(recognition.ScatterSettings().noise, rel=0.35)
    assert np.linalg.norm(middle) > 0.01 and solidity(*copy).watertight


@pytest.mark.parametrize("repeated", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_learned_scatter_is_repeatable_with_true_slopes(repeated):
    meshes = [superquadric(0.015, 0.015, 0.015).mesh(level) for level in (2, 3)]
    learned = recognition.learn_scatter(meshes, 2, seed=5)
    assert learned.vectors.shape == (2, len(FEATURES))
    assert not np.array_equal(*learned.vectors)
    # Of the logarithms of volume and area.
    assert learned.slopes[:2] == pytest.approx([3.0 / 0.015, 2.0 / 0.015], rel=0.02)
    if repeated:
        again, other = (recognition.learn_scatter(meshes, 2, seed=seed) for seed in (5, 6))
        assert all(map(np.array_equal, learned, again))
        assert not np.array_equal(learned.vectors, other.vectors)


def egg(vertices: Floats | float = 1.0, skip: int = 0, step: int = 1, name: int = 0) -> Description:
    mesh = mesh_of("egg", 2)
    return describe(mesh.vertices * vertices, mesh.faces[skip:, ::step] + name)


@pytest.mark.parametrize(("call", "words"), [
    (lambda: egg(skip=1), "must be closed"),
    (lambda: egg(step=-1), "must be closed, and its normals must point outwards"),
    (lambda: egg(np.nan), "vertices must be finite"),
    (lambda: egg(name=1000), "faces must name vertices"),
    (lambda: egg(np.array([1.0, 1.0, 0.0])), "must enclose a volume"),
    (lambda: describe(np.zeros((9, 2)), [[0, 1, 2]]), "vertices must have shape"),
])  # fmt: skip
def test_surface_without_volume_raises(call, words):
    with pytest.raises(ValueError, match=words):
        call()
