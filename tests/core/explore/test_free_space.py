"""The map of what a finger has swept, and what its pad spanned."""

import numpy as np
import pytest

from palpate.core.explore import empty_map, spanned_places, swept_places
from palpate.core.explore.free_space import FREE, MAX_VOXELS, PRESSED, TOUCHED, UNKNOWN, VOXEL
from palpate.core.poses import pose_of
from palpate.core.touch import Pad

PAD = Pad(rows=16, cols=16, pitch=1e-3, thickness=6e-3, dome=0.0, saturation=0.5)
DOWN = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
START, END = (pose_of(np.array([0.0, 0.0, z]), DOWN) for z in (0.06, 0.04))


def test_a_map_reaches_as_far_as_the_finger():
    space = empty_map(0.05, 0.01)
    assert np.allclose(space.low, [-0.05, -0.05, 0.01])
    high = space.low + space.step * (np.array(space.states.shape) - 1)
    assert (high >= [0.05, 0.05, 0.06]).all()
    assert (space.states == UNKNOWN).all()


def test_a_map_of_far_reach_has_larger_voxels():
    near, far = empty_map(0.2, 0.0), empty_map(1.0, 0.0)
    assert near.step == VOXEL < far.step
    assert near.states.size < far.states.size < 1.05 * MAX_VOXELS
    assert (far.low + far.step * (np.array(far.states.shape) - 1) >= 1.0 - 1e-12).all()


def test_what_was_touched_once_is_never_freed():
    space = empty_map(0.05, 0.0)
    first, second = (space.numbers(np.array([place])) for place in ([0, 0, 0.02], [0, 0, 0.03]))
    marked = space.marked(np.concatenate([first, second]), first)
    assert marked.states.flat[first] == TOUCHED
    assert marked.states.flat[second] == FREE
    again = marked.marked(first, np.zeros(0, np.int64))
    assert again.states.flat[first] == TOUCHED
    assert np.allclose(again.free_places(), [[0.0, 0.0, 0.03]])


def test_places_beyond_the_map_have_no_voxel():
    space = empty_map(0.05, 0.0)
    assert not len(space.numbers(np.array([[0.0, 0.0, -0.01], [0.06, 0.0, 0.02]])))


@pytest.mark.parametrize("touched", [False, True])
def test_a_move_frees_the_way_of_its_face_but_not_what_it_met(touched):
    space = empty_map(0.05, 0.0)
    places = swept_places(PAD, START, END, space.step, touched=touched)
    assert np.abs(places[:, :2]).max() == pytest.approx(7.5e-3)
    assert places[:, 2].max() == pytest.approx(0.06)
    lowest = places[:, 2].min()
    if touched:
        assert lowest >= 0.04 + PRESSED + space.step
    else:
        assert lowest == pytest.approx(0.04, abs=space.step)


def test_a_move_of_no_length_frees_nothing():
    assert swept_places(PAD, END, END, 2.5e-3, touched=True).shape == (0, 3)


def test_what_lies_between_touched_taxels_is_spanned():
    touched = np.ones((16, 16), np.bool_)
    touched[5:9, 6:12] = False
    places = spanned_places(PAD, END, touched)
    assert len(places) == 4 * 6
    x, y = PAD.grid()
    assert np.allclose(np.sort(places[:, 0]), np.sort(x[~touched]))
    assert np.allclose(np.sort(places[:, 1]), np.sort(-y[~touched]))
    assert np.allclose(places[:, 2], 0.04)


def test_what_lies_beside_the_contact_is_not_spanned():
    x, y = PAD.grid()
    assert not len(spanned_places(PAD, END, np.hypot(x, y) < 4e-3))
    assert not len(spanned_places(PAD, END, np.zeros((16, 16), np.bool_)))
