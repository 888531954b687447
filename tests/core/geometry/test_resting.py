"""On which sides a solid rests, and how it rolls onto them."""

import numpy as np
import pytest
import trimesh

from palpate.core.geometry import RestingSolid, centre_of_mass, rotation_between
from palpate.core.shapes import Superquadric
from tests.core.geometry.bodies import BOX, arrays, moved

SIZE = np.array([0.06, 0.04, 0.02])
BRICK = RestingSolid(*moved(BOX, 0.0, SIZE))


def test_box_rests_on_its_six_faces_the_largest_first():
    downs = {tuple(np.round(one.down).astype(int)) for one in BRICK.rests}
    assert downs == {tuple(sign * one) for one in np.eye(3, dtype=int) for sign in (1, -1)}
    heights = [one.height for one in BRICK.rests]
    assert heights[0] == pytest.approx(0.01) and heights == sorted(heights)
    assert BRICK.centre == pytest.approx(0.5 * SIZE)


@pytest.mark.parametrize("seed", range(20))
def test_solid_settles_lower_on_one_of_its_sides(seed):
    down = np.random.default_rng(seed).normal(size=3)
    down /= np.linalg.norm(down)
    settled = BRICK.settled(down)
    before = float(((BRICK.hull - BRICK.centre) @ down).max())  # balanced on a corner
    assert settled.height <= before + 1e-12
    assert any(settled.down == pytest.approx(one.down) for one in BRICK.rests)


@pytest.mark.parametrize(("share", "side"), [(0.9, [0, -1, 0]), (1.1, [0, 0, -1])])
def test_box_is_set_down_on_the_facet_that_is_most_nearly_level(share, side):
    lean = share * 0.25 * np.pi
    down = np.array([0.0, -np.cos(lean), -np.sin(lean)])
    assert BRICK.settled(down).down == pytest.approx(np.array(side, float))


def test_pin_does_not_stand_on_its_point_but_falls_over():
    """A slim cone set down on a small base that its centre of mass is not above."""
    cone = arrays(trimesh.creation.cone(0.01, 0.05, sections=24))
    tip = cone.vertices[:, 2:] > 0.04
    for lean in (0.06, 0.0):  # it leans: the centre of mass lies beside the base
        pin = RestingSolid(cone.vertices + np.where(tip, [lean, 0.0, 0.0], 0.0), cone.faces)
        down = pin.settled(np.array([0.0, 0.0, -1.0])).down
        assert down[2] > -0.9 if lean else down == pytest.approx([0.0, 0.0, -1.0])


def test_centre_of_mass_moves_with_the_solid_and_flat_meshes_are_refused():
    mesh = Superquadric(SIZE, np.array([0.5, 1.0])).mesh(4)
    shifted = mesh.vertices + [1.0, 2.0, 3.0]
    assert centre_of_mass(shifted[mesh.faces]) == pytest.approx([1.0, 2.0, 3.0], abs=1e-9)
    with pytest.raises(ValueError, match="enclose a volume"):
        RestingSolid(*moved(BOX, 0.0, [1.0, 1.0, 0.0]))


def test_smallest_rotation_takes_one_direction_to_another():
    rng = np.random.default_rng(0)
    for before in (*rng.normal(size=(5, 3)), [0.0, 0.0, 1.0]):
        for after in (*rng.normal(size=(5, 3)), [0.0, 0.0, -1.0], before):
            direction, target = (np.array(each) / np.linalg.norm(each) for each in (before, after))
            turn = rotation_between(direction, target)
            assert turn @ direction == pytest.approx(target, abs=1e-9)
            assert turn.T @ turn == pytest.approx(np.eye(3), abs=1e-9)
            assert np.linalg.det(turn) == pytest.approx(1.0)
            cosine = 0.5 * (np.trace(turn) - 1.0)
            assert cosine == pytest.approx(float(direction @ target), abs=1e-9)
