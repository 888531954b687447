import numpy as np

from palpate.core.poses import FACING_DOWN, pose_of
from palpate.core.touch.effects.arm import ArmBacklash

WIDTH = 0.2e-3


def followed(finger, make_touch, ways):
    """Where the pad starts if the arm goes to each of these places in turn, (n, 3)."""
    stage, found = ArmBacklash(width=WIDTH).prepare(finger), []
    state = stage.state
    for number, way in enumerate(ways):
        start = pose_of(way, FACING_DOWN)
        touch = make_touch(number, believed=start, actual=start)
        state = stage.apply(touch, state)
        assert np.array_equal(touch.believed, start)
        assert np.array_equal(touch.actual[3:], start[3:])
        assert np.array_equal(touch.actual[:3], state)
        found.append(touch.actual[:3])
    return np.array(found)


def test_to_and_fro_makes_a_loop_of_the_asked_width(make_finger, make_touch):
    forth = np.linspace(0.0, 1e-3, 101)
    there_and_back = np.concatenate([forth, forth[::-1], forth])
    ways = np.zeros((there_and_back.size, 3))
    ways[:, 1] = there_and_back
    found = followed(make_finger(), make_touch, ways)[:, 1]
    rising, falling, again = found[:101], found[101:202], found[202:]
    # From the middle of the play the pad waits for half of it, then follows half behind.
    assert np.allclose(rising, np.maximum(forth - WIDTH / 2, 0.0), atol=1e-18)
    # Turned back, it waits for all of it.
    assert np.allclose(falling, np.minimum(forth[::-1] + WIDTH / 2, rising[-1]), atol=1e-18)
    assert np.allclose(again, np.maximum(forth - WIDTH / 2, falling[-1]), atol=1e-18)
    # The area of the loop: width times the way on which the pad moves.
    loop = np.trapezoid(falling[::-1], forth) - np.trapezoid(again, forth)
    assert np.isclose(loop, WIDTH * (1e-3 - WIDTH), rtol=1e-2)


def test_each_axis_has_its_own_play(make_finger, make_touch):
    ways = np.array([[0.0, 0.0, 0.0], [1e-3, 0.0, -1e-3], [0.95e-3, 1e-3, -1e-3]])
    found = followed(make_finger(), make_touch, ways)
    assert np.allclose(found[1], [0.9e-3, 0.0, -0.9e-3], atol=1e-18)
    assert np.allclose(found[2], [0.9e-3, 0.9e-3, -0.9e-3], atol=1e-18)


def test_the_pad_is_never_farther_from_the_arm_than_half_the_width(make_finger, make_touch):
    ways = np.random.default_rng(3).normal(0.0, 0.3e-3, (300, 3))
    found = followed(make_finger(), make_touch, ways)
    assert np.abs(found - ways).max() <= WIDTH / 2 + 1e-18


def test_the_play_does_not_depend_on_the_speed(make_finger, make_touch):
    corners = np.array([0.0, 1e-3, 0.2e-3, 0.6e-3, -1e-3])
    ways = np.zeros((5, 3))
    ways[:, 0] = corners
    slow = np.zeros((401, 3))
    slow[:, 0] = np.interp(np.arange(401) / 100, np.arange(5), corners)
    fast = followed(make_finger(), make_touch, ways)
    assert np.allclose(followed(make_finger(), make_touch, slow)[::100], fast, atol=1e-15)
