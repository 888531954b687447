from __future__ import annotations

import math
import subprocess
import sys
from typing import Any

import msgspec
import numpy as np
import pytest

from palpate.core.shapes.boolean_solids import BooleanShape
from palpate.core.shapes.generalised_cylinders import GeneralisedCylinder
from palpate.core.shapes.hyperquadrics import Hyperquadric
from palpate.core.shapes.polyhedra import Polyhedron
from palpate.core.shapes.protocol import INSIDE, MISS, PosedShape, Shape
from palpate.core.shapes.triangle_meshes import DeformedShape
from palpate.nodes.specs.objects import ObjectSpec, build_shape

DOWN, SIDEWAYS = np.array([0.0, 0.0, -1.0]), np.array([-1.0, 0.0, 0.0])
BALL = {"superquadric": {"size": [0.03] * 3, "exponents": [1.0, 1.0]}}
TERMS = [{"plane": [25.0 * (i == k) for i in range(3)] + [0.0], "exponent": 4} for k in range(3)]
SHIFTED = {**BALL, "pose": {"position": [0.01, 0.0, 0.0]}}
SHELL = {"superquadric": {"size": [0.031] * 3, "exponents": [1.0, 1.0]}}
DENT = {"depth": 0.5, "terms": [{"plane": [40, 0, 0, -1.6], "exponent": 2}]}
SECTION = {"size": [0.03, 0.02]}
SWEEP = [[0.0, 1.0], [0.08, 0.5]]
DRILL = {"generalised_cylinder": {"section": {"size": [0.01, 0.01]}, "sweep": [[0, 1], [1, 1]]}}
SMALL = {"hyperquadric": {"terms": [{**t, "plane": [4 * v for v in t["plane"]]} for t in TERMS]}}
TETRAHEDRON = {
    "vertices": [[0, 0, 0], [0.06, 0, 0], [0, 0.06, 0], [0, 0, 0.06]],
    "faces": [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
}
ROW = [{**BALL, "pose": {"position": [0.01 * i, 0, 0]}} for i in range(32)]
LAYERS = [{"scale": 1.0}, {"scale": 1.1}, {"scale": 1.1}, {"scale": 1.0}]


def made(**words: Any) -> Shape:
    shape = build_shape(msgspec.convert(words, ObjectSpec))
    assert isinstance(shape, PosedShape)
    return shape._base


def ranges(shape: Shape, x: float, z: float, towards: np.ndarray = SIDEWAYS) -> float:
    return float(shape.cast(np.array([[x, 0.0, z]]), towards, 1.0)[0])


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        ({"hyperquadric": {"terms": TERMS}}, Hyperquadric),
        ({"hyperquadric": {"terms": TERMS, "dents": [DENT]}}, Hyperquadric),
        ({"generalised_cylinder": {"section": SECTION, "sweep": SWEEP}}, GeneralisedCylinder),
        ({"boolean": {"union": [BALL, SHIFTED]}}, BooleanShape),
        ({"polyhedron": TETRAHEDRON}, Polyhedron),
        ({"hyperquadric": {"terms": TERMS}, "lattice": LAYERS}, DeformedShape),
        (
            {
                "generalised_cylinder": {"section": SECTION, "sweep": SWEEP},
                "lattice": LAYERS,
                "exact": True,
            },
            DeformedShape,
        ),
        ({"boolean": {"union": [BALL, SHIFTED]}, "lattice": LAYERS}, DeformedShape),
    ],
)
def test_each_word_is_a_shape_that_can_be_touched_and_meshed(words: dict[str, Any], kind: type):
    shape = made(**words)
    assert type(shape) is kind
    low, high = shape.bounds()
    assert (high - low > 0.01).all()
    assert len(shape.mesh(2).faces) >= 4
    assert 0.0 < ranges(shape, 0.2, 0.02) < 0.2


def test_a_hyperquadric_tells_its_terms_and_dents():
    plain, dented = (made(hyperquadric={"terms": TERMS, "dents": dents}) for dents in ([], [DENT]))
    assert ranges(plain, 0.1, 0.0) == pytest.approx(0.06, abs=1e-15)
    assert 0.065 < ranges(dented, 0.1, 0.0) < 0.075


def test_a_section_of_radii_begins_at_x_and_goes_counter_clockwise():
    section = {"radii": [0.03, 0.02, 0.025, 0.02]}
    shape = made(generalised_cylinder={"section": section, "sweep": [[0, 1], [0.1, 1]]})
    assert ranges(shape, 0.1, 0.05) == pytest.approx(0.07, abs=1e-14)
    assert ranges(shape, -0.1, 0.05, -SIDEWAYS) == pytest.approx(0.075, abs=1e-14)


def test_a_tilt_is_in_degrees_and_leaves_the_sections_level():
    words = {"section": SECTION, "sweep": [[0, 1], [0.1, 1]], "tilt": 30, "tilt_direction": 0}
    low, high = made(generalised_cylinder=words).bounds()
    assert high[2] - low[2] == pytest.approx(0.1 * math.cos(math.pi / 6))
    assert high[0] - low[0] == pytest.approx(0.06 + 0.05, rel=1e-3)


def test_poses_of_a_tree_are_composed():
    inner = {**BALL, "pose": {"position": [0.05, 0.0, 0.0]}}
    turned = [0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)]  # x becomes y
    tree = {
        "intersection": [inner, {"half_space": {"normal": [0, 0, 1], "offset": 1}}],
        "pose": {"position": [0, 0, 0.1], "rotation": turned},
    }
    low, high = made(boolean=tree).bounds()
    assert np.allclose((low + high) / 2, [0.0, 0.05, 0.1], rtol=0, atol=1e-4)


@pytest.mark.parametrize(
    ("tree", "middle"),
    [
        ({"difference": [BALL, {"half_space": {"normal": [0, 0, 1]}}]}, 0.07),
        ({"intersection": [BALL, {"half_space": {"normal": [0, 0, 2], "offset": 0.01}}]}, 0.09),
        (
            {"difference": [BALL, {"half_space": {"normal": [0, 0, -1]},
                                   "pose": {"position": [0, 0, 0.02]}}]},
            0.08,
        ),
        ({"intersection": [BALL, {"complement": {"half_space": {"normal": [0, 0, -1]}}}]}, 0.1),
        ({"difference": [BALL, {"union": [DRILL, SMALL]}]}, 0.11),
        ({"union": [{"superquadric": {**BALL["superquadric"], "taper": [0.5, 0.2]}}, SMALL]}, 0.07),
        ({"difference": [BALL, {"polyhedron": TETRAHEDRON}]}, 0.1),
    ],
)  # fmt: skip
def test_trees_combine_what_they_tell(tree: dict[str, Any], middle: float):
    shape = made(boolean=tree)
    found = ranges(shape, 0.0, 0.1, DOWN)
    assert found == pytest.approx(middle, abs=1e-14)


def test_a_polyhedron_is_cast_as_it_is():
    shape = made(polyhedron=TETRAHEDRON)
    assert ranges(shape, 0.01, 0.1, DOWN) == pytest.approx(0.05, abs=1e-15)
    assert ranges(shape, 0.01, 0.01, DOWN) in (INSIDE, pytest.approx(0.0))
    assert ranges(shape, -0.01, 0.1, DOWN) == MISS


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ({**BALL, "hyperquadric": {"terms": TERMS}}, "got superquadric and hyperquadric"),
        ({"hyperquadric": {"terms": TERMS[:2]}}, "length >= 3"),
        ({"hyperquadric": {"terms": [TERMS[0]] * 3}}, "planes must face in three independent"),
        ({"hyperquadric": {"terms": [{**TERMS[0], "exponent": 0}] * 3}}, ">= 0.1"),
        ({"generalised_cylinder": {"section": {}, "sweep": SWEEP}}, "a section is exactly one of"),
        (
            {"generalised_cylinder": {"section": {**SECTION, "radii": [1, 1, 1]}, "sweep": SWEEP}},
            "got radii and size",
        ),
        ({"generalised_cylinder": {"section": SECTION, "sweep": SWEEP[::-1]}}, "heights must incr"),
        ({"generalised_cylinder": {"section": SECTION, "sweep": [[0, -1], [1, 1]]}}, ">= 0"),
        (
            {"polyhedron": {**TETRAHEDRON, "faces": [[0, 1, 2], [0, 1, 3], [0, 3, 2], [1, 2, 3]]}},
            r"both walk the edge",
        ),
        ({"boolean": {"union": [BALL]}}, "length >= 2"),
        ({"boolean": {}}, "a part of a boolean is exactly one of .* got none of them"),
        ({"boolean": {"complement": BALL}}, "the complement that is the tree is unbounded"),
        (
            {"boolean": {"union": [BALL, {"half_space": {"normal": [0, 0, 1]}}]}},
            r"half-space that is union\[1\]",
        ),
        ({"boolean": {"difference": [BALL, SHELL]}}, "the tree leaves nothing"),
        (
            {"boolean": {"union": [SHIFTED, BALL, BALL]}},
            r"union\[2\] is the same as union\[1\], in",
        ),
        ({"boolean": {"half_space": {"normal": [0, 0, 0]}}}, "normal must have a length"),
        (
            {"boolean": {"union": [{"union": ROW}, {"complement": {"union": ROW}}, BALL]}},
            "at most 64 parts in all",
        ),
        ({**BALL, "pose": {"position": [0, 0, 2000]}}, "<= 1000.0"),
        ({**BALL, "pose": {"rotation": [0, 0, 0, 1e300]}}, "<= 10.0"),
        ({"polyhedron": TETRAHEDRON, "lattice": LAYERS}, "a lattice deforms no polyhedron"),
        ({"polyhedron": TETRAHEDRON, "exact": True}, "leave it out, a polyhedron is cast as it is"),
        (
            {"hyperquadric": {"terms": TERMS}, "exact": True},
            "leave it out, a hyperquadric is exact anyway",
        ),
    ],
)
def test_what_cannot_be_is_refused_with_a_sentence(words: dict[str, Any], sentence: str):
    with pytest.raises(msgspec.ValidationError, match=sentence):
        msgspec.convert(words, ObjectSpec)


def test_a_simulator_of_a_superquadric_imports_no_other_model():
    script = (
        "import sys\n"
        "from palpate.nodes.specs import ObjectSpec, SuperquadricSpec, build_shape\n"
        "ball = SuperquadricSpec(size=(0.03, 0.03, 0.03), exponents=(1.0, 1.0))\n"
        "build_shape(ObjectSpec(superquadric=ball)).mesh(2)\n"
        "names = ('hyperquadric', 'generalised_cylinder', 'boolean', 'polyhedron', 'spans')\n"
        "print([n for n in names if 'palpate.core.shapes.' + n in sys.modules])\n"
        "print([n for n in ('manifold3d', 'scipy', 'trimesh') if n in sys.modules])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=True
    )
    assert done.stdout.split("\n")[:2] == ["[]", "[]"]
