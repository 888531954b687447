from __future__ import annotations

import math
import subprocess
import sys
from typing import Any

import msgspec
import numpy as np
import pytest

from palpate.core.poses import rotation_matrix
from palpate.core.shapes.deformed_superquadrics import DeformedSuperquadric
from palpate.core.shapes.global_deformations import Bend, Taper
from palpate.core.shapes.protocol import PosedShape, Shape
from palpate.core.shapes.superquadrics import Superquadric
from palpate.core.shapes.triangle_meshes import DeformedShape, TriangleShape
from palpate.nodes.specs.objects import ObjectSpec, PoseSpec, build_shape, encode_mesh

SIZE, EXPONENTS = [0.03, 0.025, 0.05], [0.4, 0.8]
VASE = [{"scale": 0.8}, {"scale": 1.2, "turn": 10.0}, {"shift": [0.001, 0.0]}, {"scale": 1.1}]
INWARDS = np.array([-1.0, 0.0, 0.0])


def spec(**words: Any) -> ObjectSpec:
    """An object as a scene has it: words of the superquadric, and of the object."""
    ours = {key: words.pop(key) for key in ("lattice", "exact", "pose") if key in words}
    solid = {"size": SIZE, "exponents": EXPONENTS, **words}
    return msgspec.convert({"superquadric": solid, **ours}, ObjectSpec)


def solid_of(shape: Shape) -> Shape:
    assert isinstance(shape, PosedShape)
    return shape._base


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        ({}, Superquadric),
        ({"taper": [0.2, 0.2]}, DeformedSuperquadric),
        ({"bend": 3.0}, DeformedSuperquadric),
        ({"bend": 0.0, "bend_direction": 90.0}, Superquadric),
        ({"lattice": VASE}, DeformedShape),
        ({"lattice": VASE, "taper": [0.2, 0.2], "bend": 3.0}, DeformedShape),
    ],
)
def test_only_what_a_lattice_deforms_becomes_facets(words: dict[str, Any], kind: type):
    assert type(solid_of(build_shape(spec(**words)))) is kind


def test_taper_comes_first_then_the_bend_then_the_lattice():
    words = {"taper": [0.3, -0.1], "bend": 6.0, "bend_direction": 30.0}
    base = Superquadric(np.array(SIZE), np.array(EXPONENTS)).mesh(3).vertices
    bent = Bend(6.0, math.radians(30.0))(Taper(0.3, -0.1, 0.05)(base))
    assert np.allclose(build_shape(spec(**words)).mesh(3).vertices, bent, rtol=0, atol=1e-16)
    shape = solid_of(build_shape(spec(**words, lattice=VASE)))
    assert isinstance(shape, DeformedShape)
    moved = shape._deformation.deform(bent)
    assert np.allclose(shape.mesh(3).vertices, moved, rtol=0, atol=1e-16)
    assert np.abs(moved - bent).max() > 1e-3


def test_a_lattice_left_alone_changes_nothing_of_a_bent_solid():
    words = {"taper": [0.3, -0.1], "bend": 8.0, "bend_direction": -45.0}
    plain, latticed = build_shape(spec(**words)), build_shape(spec(**words, lattice=[{}] * 4))
    first, second = plain.mesh(4).vertices, latticed.mesh(4).vertices
    assert np.allclose(first, second, rtol=0, atol=1e-15)


def test_exact_takes_rays_to_the_surface_that_the_lattice_deforms():
    origins = np.array([[0.2, y, z] for y in (-0.01, 0.0, 0.01) for z in (-0.03, 0.0, 0.03)])
    exact, facets = (
        build_shape(spec(lattice=[{}] * 4, exact=exact)).cast(origins, INWARDS, 1.0)
        for exact in (True, False)
    )
    wanted = build_shape(spec()).cast(origins, INWARDS, 1.0)
    assert np.allclose(exact, wanted, rtol=0, atol=1e-14)
    assert 1e-9 < np.abs(facets - wanted).max() < 1e-5


def test_the_bend_direction_is_an_azimuth_in_degrees():
    for degrees, towards in ((0.0, [1, 0]), (90.0, [0, 1]), (-180.0, [-1, 0])):
        bent = build_shape(spec(bend=5.0, bend_direction=degrees)).mesh(3).vertices
        moved = bent - build_shape(spec()).mesh(3).vertices
        ends = np.abs(bent[:, 2]) > 0.04
        assert np.allclose(moved[ends, :2].mean(axis=0), 0.005 * np.array(towards), atol=0.002)


def test_a_posed_object_is_cast_where_it_stands():
    turn = [0.0, math.sin(0.3), 0.0, math.cos(0.3)]
    there = build_shape(
        spec(taper=[0.2, 0.2], pose={"position": [0.1, 0.2, 0.3], "rotation": turn})
    )
    here = build_shape(spec(taper=[0.2, 0.2]))
    axes = rotation_matrix(np.array(turn))
    origins = np.array([[0.2, 0.0, 0.01], [0.2, 0.01, -0.02]])
    found = there.cast(origins @ axes.T + [0.1, 0.2, 0.3], axes @ INWARDS, 1.0)
    assert np.allclose(found, here.cast(origins, INWARDS, 1.0), rtol=0, atol=1e-14)


def test_a_mesh_is_cast_as_it_is():
    mesh = Superquadric(np.array(SIZE), np.array(EXPONENTS)).mesh(2)
    shape = solid_of(build_shape(ObjectSpec(mesh=encode_mesh(*mesh))))
    assert isinstance(shape, TriangleShape)
    assert np.array_equal(shape.mesh(0).vertices, mesh.vertices)
    assert np.array_equal(shape.mesh(0).faces, mesh.faces)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            {"bend": 40.0},
            r"bend must lie between -32.67 and 32.67 1/m, or this solid folds, got 40",
        ),
        ({"bend": -40.0}, "bend must lie between -32.67 and 32.67 1/m"),
        ({"bend": 30.0, "taper": [0.5, 0.0]}, "bend must lie between -21.78 and 21.78 1/m"),
        ({"bend": 39.3, "bend_direction": 90.0}, "bend must lie between -39.2 and 39.2 1/m"),
        ({"bend": math.nan}, "finite curvature"),
        ({"bend": math.inf}, "finite curvature"),
        ({"bend_direction": 400.0}, "<= 360"),
        ({"taper": [1.0, 0.0]}, "< 1"),
        ({"exact": True}, "exact is for an object with a lattice: .* superquadric is exact anyway"),
        ({"taper": [0.1, 0.1], "exact": True}, "exact is for an object with a lattice"),
        (
            {"lattice": [{}, {"turn": 170}, {"turn": -170}, {}]},
            r"the lattice folds or flattens \d+.\d% of its box: bring the layers' scale, shift",
        ),
        ({"lattice": [{}] * 3}, "length >= 4"),
        ({"lattice": [{"shift": [math.nan, 0.0]}, {}, {}, {}]}, "shift must be finite"),
        ({"pose": {"position": [math.nan, 0, 0]}}, ">= -1000.0"),
    ],
)
def test_what_cannot_be_is_refused_with_a_sentence(words: dict[str, Any], sentence: str):
    with pytest.raises(msgspec.ValidationError, match=sentence):
        spec(**words)


def test_exact_is_refused_for_a_mesh():
    vertices, faces = Superquadric(np.array(SIZE), np.array(EXPONENTS)).mesh(1)
    with pytest.raises(
        ValueError, match=r"exact .* lattice: leave it out, a mesh is cast as it is"
    ):
        ObjectSpec(mesh=encode_mesh(vertices, faces), exact=True)


@pytest.mark.parametrize("bend", [0.0, 4.0])
def test_a_tapered_or_bent_superquadric_needs_numpy_alone(bend: float):
    script = (
        "import sys\n"
        "from palpate.nodes.specs import ObjectSpec, SuperquadricSpec\n"
        "from palpate.nodes.simulator import Params, start\n"
        "egg = SuperquadricSpec(size=(0.03, 0.03, 0.04), exponents=(1.0, 1.0),\n"
        f"    taper=(-0.2, -0.2), bend={bend})\n"
        "start(Params(object=ObjectSpec(superquadric=egg)))\n"
        "print([m for m in ('numpy.random', 'scipy', 'trimesh', 'embreex') if m in sys.modules])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=True
    )
    assert done.stdout.strip() == "[]"


def test_a_pose_that_a_program_gives_must_be_finite():
    with pytest.raises(ValueError, match="position and rotation must be finite"):
        PoseSpec(position=(math.nan, 0.0, 0.0))
