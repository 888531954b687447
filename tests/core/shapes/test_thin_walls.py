"""What a pad meets on meshes that are thin, hollow or narrow."""

import numpy as np
import pytest
import trimesh

from palpate.core.shapes.triangle_meshes import HAS_EMBREE, TriangleShape
from palpate.core.touch.pad import Pad, guarded_move

PAD = Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.6)
DEPTH, REACH = 1.5e-3, 0.05
DOWN, ALONG_X = np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)])
AGAINST_X = ALONG_X * [1.0, -1.0, 1.0, 1.0]
UP = np.array([0.0, 0.0, 0.0, 1.0])
BACKENDS = [False, *([True] * HAS_EMBREE)]


def box(extents, middle=(0.0, 0.0, 0.0)):
    made = trimesh.creation.box(extents)
    made.apply_translation(middle)
    return made


def cylinder(radius, height, middle=(0.0, 0.0, 0.0)):
    made = trimesh.creation.cylinder(radius, height, sections=96)
    made.apply_translation(middle)
    return made


def cut(whole, *taken):
    return trimesh.boolean.difference([whole, *taken], engine="manifold")


@pytest.fixture(scope="module")
def drawn():
    ring = trimesh.creation.torus(0.018, 0.004, 32, 16)
    ring.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    ring.apply_translation([0.04, 0.0, 0.0])
    jug = trimesh.boolean.union([cylinder(0.04, 0.08), ring], engine="manifold")
    block = box([0.06, 0.06, 0.04])
    return {
        "open box": cut(box([0.06, 0.06, 0.04]), box([0.058, 0.058, 0.04], [0, 0, 0.001])),
        "cup upside down": cut(cylinder(0.03, 0.06), cylinder(0.029, 0.06, [0, 0, -0.001])),
        "slit": cut(block, box([0.004, 0.08, 0.04], [0, 0, 0.01])),
        "bore": cut(block, cylinder(0.004, 0.03, [0, 0, 0.02])),
        "mug": cut(jug, cylinder(0.037, 0.08, [0, 0, 0.003])),
    }


def pressed(mesh, place, turn, embree, depth=DEPTH):
    shape = TriangleShape(np.array(mesh.vertices), np.array(mesh.faces, np.int32), embree)
    return guarded_move(shape, PAD, np.array([*place, *turn]), REACH, depth)


@pytest.mark.parametrize("embree", BACKENDS)
def test_a_wall_thinner_than_the_indentation_feels_like_a_thick_one_from_the_side(drawn, embree):
    thick = pressed(box([0.06, 0.06, 0.04]), (-0.04, 0.0, 0.0), ALONG_X, embree)
    thin = pressed(drawn["open box"], (-0.04, 0.0, 0.0), ALONG_X, embree)
    assert thin.outcome == thick.outcome == "hit"
    assert thin.advance == pytest.approx(0.01 + DEPTH, abs=1e-9)
    np.testing.assert_allclose(thin.compression, thick.compression, atol=1e-9)
    within = pressed(drawn["open box"], (0.0, 0.0, 0.009), ALONG_X, embree)  # of the same box
    assert within.advance == pytest.approx(0.029 + DEPTH, abs=1e-9)
    np.testing.assert_allclose(within.compression, thick.compression, atol=1e-9)


@pytest.mark.parametrize("embree", BACKENDS)
def test_only_taxels_above_a_thin_rim_are_pressed(drawn, embree):
    done = pressed(drawn["open box"], (0.029, 0.0, 0.03), DOWN, embree)
    assert done.outcome == "hit"
    assert done.advance == pytest.approx(0.01 + DEPTH, abs=1e-9)
    columns = (done.compression > 0.0).all(axis=0)
    assert columns.sum() == 1
    assert np.flatnonzero(columns) == [8]  # x = 0.0295, in the middle of the wall
    assert (done.compression[:, ~columns] == 0.0).all()
    assert np.isneginf(done.indentation[:, 9:]).all()  # past the wall there is nothing
    np.testing.assert_allclose(done.indentation[:, 7], DEPTH - 0.039, atol=1e-9)  # the floor


@pytest.mark.parametrize("embree", BACKENDS)
def test_a_hollow_underside_is_felt_as_its_shell_and_not_through_it(drawn, embree):
    cup = drawn["cup upside down"]
    above = pressed(cup, (0.0, 0.0, 0.04), DOWN, embree)
    assert above.compression == pytest.approx(DEPTH, abs=1e-9)
    below = pressed(cup, (0.0, 0.0, 0.0), UP, embree)  # which no platform lets a finger do
    assert below.advance == pytest.approx(0.029 + DEPTH, abs=1e-9)
    aside = pressed(cup, (-0.04, 0.0, 0.0), ALONG_X, embree)
    solid = pressed(cylinder(0.03, 0.06), (-0.04, 0.0, 0.0), ALONG_X, embree)
    np.testing.assert_allclose(aside.compression, solid.compression, atol=1e-9)
    assert pressed(cup, (0.0295, 0.0, 0.0), ALONG_X, embree).outcome == "inside"


@pytest.mark.parametrize("embree", BACKENDS)
@pytest.mark.parametrize(("name", "missing"), [("slit", 4 * 16), ("bore", 4 * 13)])
def test_over_an_opening_narrower_than_the_pad_taxels_stay_free(drawn, name, missing, embree):
    done = pressed(drawn[name], (0.0, 0.0, 0.03), DOWN, embree)
    free = done.compression == 0.0
    assert int(free.sum()) == missing  # taxels whose middle lies over it
    assert done.compression[~free] == pytest.approx(DEPTH, abs=1e-9)
    depth = {"slit": 0.03, "bore": 0.015}[name]
    np.testing.assert_allclose(done.indentation[free], DEPTH - depth, atol=1e-9)
    assert pressed(drawn[name], (0.0, 0.0, 0.012), DOWN, embree).outcome == "inside"


@pytest.mark.parametrize("embree", BACKENDS)
def test_a_mug_is_touched_within_without_and_through_its_handle(drawn, embree):
    mug = drawn["mug"]
    within = pressed(mug, (0.0, 0.0, 0.0), AGAINST_X, embree)
    bent = np.sqrt(0.037**2 - (7.5e-3) ** 2)  # the wall is nearest at the pad's sides
    assert within.advance == pytest.approx(bent + DEPTH, abs=4e-5)  # as far as facets tell
    floor = pressed(mug, (0.0, 0.0, -0.02), DOWN, embree)
    assert floor.advance == pytest.approx(0.017 + DEPTH, abs=1e-9)
    handle = pressed(mug, (0.08, 0.0, 0.0), AGAINST_X, embree)
    assert handle.advance == pytest.approx(0.018 + DEPTH, abs=2e-4)
    past = (handle.indentation < -0.02).all(axis=1)
    assert past.sum() == 8  # rows beside the handle, 8 mm wide, that see the body behind it
    assert (handle.compression[~past].max(axis=0) > 0.0).all()
