"""Objects of scenes: volume, extents and rays against closed forms, order of deformations."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.geometry import solidity
from palpate.core.shapes import Bend, Shape, Superquadric, Taper
from palpate.nodes.specs.objects import ObjectSpec, PoseSpec, build_shape, encode_mesh
from tests.messages.cases import cases

DOWN, SIDEWAYS = np.array([0.0, 0.0, -1.0]), np.array([-1.0, 0.0, 0.0])
SIZE, EXPONENTS = [0.03, 0.025, 0.05], [0.4, 0.8]
VASE = [{"scale": 0.8}, {"scale": 1.2, "turn": 10.0}, {"shift": [0.001, 0.0]}, {"scale": 1.1}]
FOLDED = [{}, {"turn": 170}, {"turn": -170}, {}]
BALL = {"superquadric": {"size": [0.03] * 3, "exponents": [1.0, 1.0]}}
SHIFTED = {**BALL, "pose": {"position": [0.01, 0.0, 0.0]}}
SHELL = {"superquadric": {"size": [0.031] * 3, "exponents": [1.0, 1.0]}}
TERMS = [{"plane": [25.0 * (i == k) for i in range(3)] + [0.0], "exponent": 4} for k in range(3)]
DENT = {"depth": 0.5, "terms": [{"plane": [40, 0, 0, -1.6], "exponent": 2}]}
SECTION, SWEEP = {"size": [0.03, 0.02]}, [[0.0, 1.0], [0.08, 0.5]]
DRILL = {"generalised_cylinder": {"section": {"size": [0.01, 0.01]}, "sweep": [[0, 1], [1, 1]]}}
SMALL = {"hyperquadric": {"terms": [{**t, "plane": [4 * v for v in t["plane"]]} for t in TERMS]}}
CORNERS = [[0, 0, 0], [0.06, 0, 0], [0, 0.06, 0], [0, 0, 0.06]]
ROUND = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
TETRAHEDRON = {"vertices": CORNERS, "faces": ROUND}
ROW = [{**BALL, "pose": {"position": [0.01 * i, 0, 0]}} for i in range(32)]
TAPERED = {"superquadric": {**BALL["superquadric"], "taper": [0.5, 0.2]}}
HOLE = {"cylinder": {"radius": 0.01, "height": 0.1}}
PLATE = {"box": {"size": [0.06, 0.06, 0.04]}}

# The measures of each, its volume [m^3], its extents [m], and its radius at a height [m].
PRIMITIVES: dict[str, Any] = {
    "sphere": ({"radius": 0.03}, 4.0 / 3.0 * math.pi * 0.03**3, (0.06, 0.06, 0.06)),
    "box": ({"size": [0.06, 0.044, 0.05]}, 0.06 * 0.044 * 0.05, (0.06, 0.044, 0.05)),
    "cylinder": ({"radius": 0.03, "height": 0.08}, math.pi * 0.03**2 * 0.08, (0.06, 0.06, 0.08)),
    "cone": (
        {"radius": 0.03, "height": 0.08, "top": 0.01},
        math.pi * 0.08 * (0.03**2 + 0.03 * 0.01 + 0.01**2) / 3.0,
        (0.06, 0.06, 0.08),
    ),
    "capsule": (
        {"radius": 0.025, "height": 0.09},
        math.pi * 0.025**2 * (0.04 + 4.0 / 3.0 * 0.025),
        (0.05, 0.05, 0.09),
    ),
    "torus": (
        {"radius": 0.04, "tube": 0.015},
        2.0 * math.pi**2 * 0.04 * 0.015**2,
        (0.11, 0.11, 0.03),
    ),
}
RADII = {
    "sphere": lambda z: np.sqrt(0.03**2 - z**2),
    "box": lambda z: np.full(len(z), 0.03),
    "cylinder": lambda z: np.full(len(z), 0.03),
    "cone": lambda z: 0.02 - 0.25 * z,
    "capsule": lambda z: np.full(len(z), 0.025),
    "torus": lambda z: 0.04 + np.sqrt(0.015**2 - z**2),
}


def made(**words: Any) -> Shape:
    return build_shape(msgspec.convert(words, ObjectSpec))


def solid(**words: Any) -> Shape:
    """The superquadric, with more words of its own or of the object."""
    outer = {key: words.pop(key) for key in ("lattice", "exact", "pose") if key in words}
    return made(superquadric={"size": SIZE, "exponents": EXPONENTS, **words}, **outer)


def half_space(up: float, offset: float = 0.0, z: float = 0.0) -> dict[str, Any]:
    plane = {"normal": [0, 0, up], "offset": offset}
    return {"half_space": plane, "pose": {"position": [0, 0, z]}}


def ranges(shape: Shape, x: float, z: float, towards: Floats = SIDEWAYS) -> float:
    return float(shape.cast(np.array([[x, 0.0, z]]), towards, 1.0)[0])


@pytest.mark.parametrize("kind", PRIMITIVES)
def test_primitive_has_volume_extents_and_radius_of_its_kind(kind: str):
    fields, volume, extents = PRIMITIVES[kind]
    shape = made(**{kind: fields})
    mesh = shape.mesh(5)
    body = solidity(mesh.vertices, mesh.faces)
    assert body.watertight and body.genus == (kind == "torus")
    assert body.volume == pytest.approx(volume, rel=2e-3)
    np.testing.assert_allclose(shape.bounds(), 0.5 * np.outer([-1, 1], extents), atol=1e-9)
    heights = np.linspace(-0.1, 0.1, 7) * extents[2]
    origins = np.column_stack([np.full(7, -0.2), np.zeros(7), heights])
    met = 0.2 - shape.cast(origins, np.array([1.0, 0.0, 0.0]), 0.4)
    # Capsule and torus are facets, within a ten-thousandth of the radius off the surface.
    off = 3e-6 if kind in ("capsule", "torus") else 1e-9
    np.testing.assert_allclose(met, RADII[kind](heights), atol=off)


@cases(
    "tree, top",
    ({"difference": [BALL, half_space(1.0)]}, 0.03),
    ({"difference": [BALL, half_space(-1.0, z=0.02)]}, 0.02),
    ({"intersection": [BALL, half_space(2.0, offset=0.01)]}, 0.01),
    ({"intersection": [BALL, {"complement": half_space(-1.0)}]}, 0.0),
    ({"difference": [BALL, {"union": [DRILL, SMALL]}]}, -0.01),
    ({"difference": [BALL, {"polyhedron": TETRAHEDRON}]}, 0.0),
    ({"union": [TAPERED, SMALL]}, 0.03),
    ({"difference": [PLATE, HOLE], "pose": {"position": [0.02, 0, 0.01]}}, 0.03),
    ({"union": [BALL, SHIFTED]}, 0.03),
)
def test_tree_is_met_where_its_parts_say(tree: dict[str, Any], top: float):
    assert 0.1 - ranges(made(boolean=tree), 0.0, 0.1, DOWN) == pytest.approx(top, abs=1e-9)


def test_poses_of_a_tree_are_composed():
    inner = {**BALL, "pose": {"position": [0.05, 0.0, 0.0]}}
    turned = [0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)]  # x becomes y
    pose = {"position": [0, 0, 0.1], "rotation": turned}
    tree = {"intersection": [inner, half_space(1.0, offset=1.0)], "pose": pose}
    low, high = made(boolean=tree).bounds()
    assert np.allclose((low + high) / 2, [0.0, 0.05, 0.1], rtol=0, atol=1e-4)


def test_faces_and_sections_are_met_where_their_words_say():
    shape = made(polyhedron=TETRAHEDRON)
    assert ranges(shape, 0.01, 0.1, DOWN) == pytest.approx(0.05, abs=1e-15)
    assert np.isposinf(ranges(shape, -0.01, 0.1, DOWN))
    assert not ranges(shape, 0.01, 0.01, DOWN) > 0.0
    plain, dented = (made(hyperquadric={"terms": TERMS, "dents": dents}) for dents in ([], [DENT]))
    assert ranges(plain, 0.1, 0.0) == pytest.approx(0.06, abs=1e-15)
    assert 0.065 < ranges(dented, 0.1, 0.0) < 0.075
    straight = [[0, 1], [0.1, 1]]
    section = {"radii": [0.03, 0.02, 0.025, 0.02]}
    shape = made(generalised_cylinder={"section": section, "sweep": straight})
    assert ranges(shape, 0.1, 0.05) == pytest.approx(0.07, abs=1e-14)
    assert ranges(shape, -0.1, 0.05, -SIDEWAYS) == pytest.approx(0.075, abs=1e-14)
    words = {"section": SECTION, "sweep": straight, "tilt": 30, "tilt_direction": 0}
    low, high = made(generalised_cylinder=words).bounds()
    assert high[2] - low[2] == pytest.approx(0.1 * math.cos(math.pi / 6))
    assert high[0] - low[0] == pytest.approx(0.06 + 0.05, rel=1e-3)


@cases(
    "words",
    {"hyperquadric": {"terms": TERMS}},
    {"generalised_cylinder": {"section": SECTION, "sweep": SWEEP}, "exact": True},
    pytest.param({"boolean": {"union": [BALL, SHIFTED]}}, marks=pytest.mark.slow),
)
def test_lattice_deforms_any_solid_with_a_function(words: dict[str, Any]):
    plain = made(**{key: word for key, word in words.items() if key != "exact"})
    shape = made(**words, lattice=[{"scale": 1.1}] * 4)
    extents = [np.ptp(one.bounds(), axis=0) for one in (plain, shape)]
    assert extents[1] == pytest.approx(extents[0] * [1.1, 1.1, 1.0], rel=0.01)
    assert 0.0 < ranges(shape, 0.2, 0.02) < ranges(plain, 0.2, 0.02)


def test_taper_comes_first_then_bend_then_lattice_whose_surface_exact_rays_meet():
    words = {"taper": [0.3, -0.1], "bend": 6.0, "bend_direction": 30.0}
    base = Superquadric(np.array(SIZE), np.array(EXPONENTS)).mesh(3).vertices
    bent = Bend(6.0, math.radians(30.0))(Taper(0.3, -0.1, 0.05)(base))
    assert np.allclose(solid(**words).mesh(3).vertices, bent, rtol=0, atol=1e-16)
    alone = solid(**words, lattice=[{}] * 4).mesh(3).vertices
    assert np.allclose(alone, bent, rtol=0, atol=1e-15)
    moved = solid(**words, lattice=VASE).mesh(3).vertices
    wide = solid(**words, lattice=[{"scale": 1.1}] * 4).mesh(3).vertices
    assert np.abs(moved - bent).max() > 1e-3
    # A lattice that widens every layer widens the bent solid about the middle of its box.
    stretch = np.linalg.lstsq(np.column_stack([bent[:, 0], np.ones(len(bent))]), wide[:, 0])[0][0]
    assert stretch == pytest.approx(1.1) and np.allclose(wide[:, 2], bent[:, 2], rtol=0, atol=1e-15)
    origins = np.array([[0.2, y, z] for y in (-0.01, 0.0, 0.01) for z in (-0.03, 0.0, 0.03)])
    exact, facets = (
        solid(lattice=[{}] * 4, exact=exact).cast(origins, SIDEWAYS, 1.0) for exact in (True, False)
    )
    wanted = solid().cast(origins, SIDEWAYS, 1.0)
    assert np.allclose(exact, wanted, rtol=0, atol=1e-14)
    assert 1e-9 < np.abs(facets - wanted).max() < 1e-5


def test_mesh_is_kept_as_it_is():
    mesh = Superquadric(np.array(SIZE), np.array(EXPONENTS)).mesh(2)
    kept = build_shape(ObjectSpec(mesh=encode_mesh(*mesh))).mesh(0)
    assert np.array_equal(kept.vertices, mesh.vertices) and np.array_equal(kept.faces, mesh.faces)
    with pytest.raises(ValueError, match=r"exact .* lattice: leave it out, a mesh is cast as it"):
        ObjectSpec(mesh=encode_mesh(*mesh), exact=True)
    with pytest.raises(ValueError, match="position and rotation must be finite"):
        PoseSpec(position=(math.nan, 0.0, 0.0))


def plain(**words: Any) -> dict[str, Any]:
    """The superquadric with more words of its own."""
    return {"superquadric": {"size": SIZE, "exponents": EXPONENTS, **words}}


def swept(sweep: Any = SWEEP, **section: Any) -> dict[str, Any]:
    return {"generalised_cylinder": {"section": section, "sweep": sweep}}


@cases(
    "words, sentence",
    ({}, "an object is exactly one of sphere, .* and mesh; got none of them"),
    ({**BALL, "hyperquadric": {"terms": TERMS}}, "got superquadric and hyperquadric"),
    ({"sphere": {"radius": 1.0}, **PLATE}, "got sphere and box"),
    (plain(size=[1, -1, 1]), "> 0"),
    (plain(exponents=[1, 3]), "<= 2"),
    (plain(bend=40.0), r"between -32.67 and 32.67 1/m, or this solid folds, got 40"),
    (plain(bend=30.0, taper=[0.5, 0.0]), "bend must lie between -21.78 and 21.78 1/m"),
    (plain(bend=39.3, bend_direction=90.0), "bend must lie between -39.2 and 39.2 1/m"),
    (plain(bend=math.nan), "finite curvature"),
    (plain(bend_direction=400.0), "<= 360"),
    (plain(taper=[1.0, 0.0]), "< 1"),
    ({**plain(), "exact": True}, "lattice: .* superquadric is exact anyway"),
    ({"polyhedron": TETRAHEDRON, "exact": True}, "out, a polyhedron is cast as it is"),
    ({"hyperquadric": {"terms": TERMS}, "exact": True}, "out, a hyperquadric is exact anyway"),
    ({**plain(), "lattice": FOLDED}, r"the lattice folds or flattens \d+.\d% of its box: bring"),
    ({**plain(), "lattice": [{}] * 3}, "length >= 4"),
    ({**plain(), "lattice": [{"shift": [math.nan, 0]}, {}, {}, {}]}, "shift must be finite"),
    ({"polyhedron": TETRAHEDRON, "lattice": VASE}, "a lattice deforms no polyhedron"),
    ({**PLATE, "lattice": VASE}, "a lattice deforms no box"),
    ({"mesh": {"vertices": "", "faces": ""}, "lattice": VASE}, "a lattice deforms no mesh"),
    ({**plain(), "pose": {"position": [math.nan, 0, 0]}}, ">= -1000.0"),
    ({**BALL, "pose": {"position": [0, 0, 2000]}}, "<= 1000.0"),
    ({**BALL, "pose": {"rotation": [0, 0, 0, 1e300]}}, "<= 10.0"),
    ({**BALL, "pose": {"rotation": [0, 0, 0, 2]}}, "quaternion of length 1"),
    ({"capsule": {"radius": 0.03, "height": 0.05}}, "at least twice its radius, 0.06 m"),
    ({"torus": {"radius": 0.02, "tube": 0.02}}, "must be less than its radius, 0.02 m"),
    ({"sphere": {"radius": 0.0}}, "Expected `float` > 0"),
    ({"hyperquadric": {"terms": TERMS[:2]}}, "length >= 3"),
    ({"hyperquadric": {"terms": [{**TERMS[0], "exponent": 0}] * 3}}, ">= 0.1"),
    (swept(), "a section is exactly one of"),
    (swept(**SECTION, radii=[1, 1, 1]), "got radii and size"),
    (swept([[0, -1], [1, 1]], **SECTION), ">= 0"),
    ({"polyhedron": {**TETRAHEDRON, "faces": [[0, 1, 2], *ROUND[1:]]}}, "both pass the edge"),
    ({"boolean": {"union": [BALL]}}, "length >= 2"),
    ({"boolean": {}}, "a part of a boolean is exactly one of .* got none of them"),
    ({"boolean": {"complement": BALL}}, "the complement that is the tree is unbounded"),
    ({"boolean": {"union": [BALL, half_space(1.0)]}}, r"half-space that is union\[1\]"),
    ({"boolean": {"difference": [BALL, SHELL]}}, "the tree leaves nothing"),
    ({"boolean": {"union": [SHIFTED, BALL, BALL]}}, r"union\[2\] is the same as union\[1\]"),
    ({"boolean": {"union": [{"union": ROW}, {"union": ROW[1:]}, BALL, HOLE]}}, "at most 64 parts"),
)
def test_object_that_cannot_be_is_refused_with_a_sentence(words: dict[str, Any], sentence: str):
    with pytest.raises(msgspec.ValidationError, match=sentence):
        msgspec.convert(words, ObjectSpec)
