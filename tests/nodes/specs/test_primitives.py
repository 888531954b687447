import math

import msgspec
import numpy as np
import pytest

from palpate.core.geometry import solidity
from palpate.nodes.specs.objects import ObjectSpec, build_shape

# The measures of each, its volume, m3, and its extents, m.
KNOWN = {
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
        {"radius": 0.04, "tube": 0.015}, 2.0 * math.pi**2 * 0.04 * 0.015**2, (0.11, 0.11, 0.03)
    ),
}  # fmt: skip


def spec_of(**given):
    return msgspec.convert(given, ObjectSpec)


@pytest.mark.parametrize("kind", KNOWN)
def test_a_primitive_has_its_volume_and_extents_about_the_origin(kind):
    given, volume, extents = KNOWN[kind]
    shape = build_shape(spec_of(**{kind: given}))
    mesh = shape.mesh(5)
    told = solidity(mesh.vertices, mesh.faces)
    assert told.watertight and told.volume == pytest.approx(volume, rel=2e-3)
    np.testing.assert_allclose(shape.bounds(), 0.5 * np.outer([-1, 1], extents), atol=1e-9)


@pytest.mark.parametrize("kind", KNOWN)
def test_rays_along_x_meet_the_side_where_it_is(kind):
    given, _, extents = KNOWN[kind]
    shape = build_shape(spec_of(**{kind: given}))
    heights = np.linspace(-0.1, 0.1, 7) * extents[2]
    origins = np.column_stack([np.full(7, -0.2), np.zeros(7), heights])
    met = 0.2 - shape.cast(origins, np.array([1.0, 0.0, 0.0]), 0.4)
    radius = {
        "sphere": np.sqrt(0.03**2 - heights**2),
        "box": np.full(7, 0.03),
        "cylinder": np.full(7, 0.03),
        "cone": 0.02 - 0.25 * heights,
        "capsule": np.full(7, 0.025),
        "torus": 0.04 + np.sqrt(0.015**2 - heights**2),
    }[kind]
    np.testing.assert_allclose(met, radius, atol=3e-6 if kind in ("capsule", "torus") else 1e-9)


@pytest.mark.parametrize("kind", ["capsule", "torus"])
def test_facets_lie_within_a_ten_thousandth_of_the_radius_off_the_surface(kind):
    given, _, _ = KNOWN[kind]
    mesh = build_shape(spec_of(**{kind: given})).mesh(0)
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    if kind == "torus":
        ring = np.hypot(middle[:, 0], middle[:, 1]) - given["radius"]
        off = np.hypot(ring, middle[:, 2]) - given["tube"]
    else:
        along = np.clip(middle[:, 2], -0.02, 0.02)
        off = np.hypot(np.hypot(middle[:, 0], middle[:, 1]), middle[:, 2] - along) - 0.025
    assert np.abs(off).max() < 1e-4 * given["radius"]


def test_primitives_are_parts_of_booleans_and_stand_where_they_are_put():
    hole = {"cylinder": {"radius": 0.01, "height": 0.1}}
    drilled = {"difference": [{"box": {"size": [0.06, 0.06, 0.04]}}, hole]}
    shape = build_shape(spec_of(boolean=drilled, pose={"position": [0.0, 0.0, 0.02]}))
    ray = shape.cast(np.array([[0.0, 0.0, 0.2]]), np.array([0.0, 0.0, -1.0]), 0.19)
    assert np.isinf(ray).all() or ray[0] >= 0.19
    beside = shape.cast(np.array([[0.02, 0.0, 0.2]]), np.array([0.0, 0.0, -1.0]), 0.3)
    np.testing.assert_allclose(beside, 0.16, atol=1e-9)


@pytest.mark.parametrize(("given", "words"), [
    ({"capsule": {"radius": 0.03, "height": 0.05}}, "must be at least twice its radius, 0.06 m"),
    ({"torus": {"radius": 0.02, "tube": 0.02}}, "it must be less than its radius, 0.02 m"),
    ({"sphere": {"radius": 0.0}}, "Expected `float` > 0"),
    ({"sphere": {"radius": 1.0}, "box": {"size": [1, 1, 1]}}, "got sphere and box"),
    ({"box": {"size": [0.1, 0.1, 0.1]}, "lattice": [{}] * 4}, "a lattice deforms no box"),
])  # fmt: skip
def test_measures_that_make_no_solid_are_refused(given, words):
    with pytest.raises((ValueError, msgspec.ValidationError), match=words):
        spec_of(**given)
