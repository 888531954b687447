import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.poses import FACING_DOWN, pose_of, split_pose
from palpate.core.touch.effects.echoes import Aperture
from palpate.core.touch.pad import Pad
from palpate.core.touch.pipeline import cast_single_rays

READINGS = ("mean", "max")


class Ground:
    """A surface of this height under each place of the world, seen from above."""

    def __init__(self, height):
        self.height = height

    def cast(self, origins, direction, reach):
        """Ranges of rays that look straight down."""
        assert np.allclose(direction, [0.0, 0.0, -1.0])
        x, y, z = origins.T
        ranges = z - self.height(x, y)
        return np.where(ranges <= reach, ranges, np.inf)

    def bounds(self):
        raise NotImplementedError

    def mesh(self, level):
        raise NotImplementedError


def measured(finger, touch, **given):
    Aperture(**given).prepare(finger).apply(touch, None)
    return touch


def over(finger, make_touch, ground, **more):
    """A touch of a ground from 3 mm above its zero."""
    start = pose_of(np.array([0.0, 0.0, 3e-3]), FACING_DOWN)
    touch = make_touch(believed=start, actual=start, **more)
    touch.shape = ground
    return touch


def slowly(finger, touch, width, rays, largest):
    """What the elements report at the end of a move, ray by ray."""
    pad = finger.pad
    position, axes = split_pose(touch.actual)
    found = np.zeros((pad.rows, pad.cols))
    for i in range(pad.rows):
        for j in range(pad.cols):
            seen = []
            for k in range(rays * rays):
                x = (j - (pad.cols - 1) / 2 + ((k % rays + 0.5) / rays - 0.5) * width) * pad.pitch
                y = (i - (pad.rows - 1) / 2 + ((k // rays + 0.5) / rays - 0.5) * width) * pad.pitch
                depth = pad.thickness + 0.5 * pad.dome * (x * x + y * y)
                origin = position + axes @ np.array([x, y, -depth])
                (range_,) = touch.shape.cast(origin[None], axes[:, 2], 0.05)
                seen.append(max(pad.thickness - range_, 0.0))
            found[i, j] = max(seen) if largest else sum(seen) / len(seen)
    return found


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("dome", [0.0, 1 / 0.015])
def test_elements_report_what_their_rays_see(reading, dome, make_finger, make_touch):
    finger = make_finger(dome=dome)
    start = pose_of(np.array([1.3e-3, -0.4e-3, 0.033]), FACING_DOWN)
    touch = make_touch(believed=start, actual=start)
    measured(finger, touch, width=0.9, rays=4, reading=reading)
    assert touch.outcome == "hit"
    expected = slowly(finger, touch, 0.9, 4, reading == "max")
    assert np.allclose(touch.compression, expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("depth", [0.05e-3, 1e-3, 2.2e-3])
@pytest.mark.parametrize("dome", [0.0, 1 / 0.015])
def test_deepest_element_reports_asked_depth(reading, depth, dome, make_finger, make_touch):
    touch = measured(make_finger(dome=dome), make_touch(depth=depth), reading=reading)
    assert touch.outcome == "hit"
    assert touch.compression.max() == pytest.approx(depth, abs=1e-15)
    assert np.allclose(touch.pressure, 2e8 * touch.compression, rtol=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_the_way_to_a_mean_is_right_on_rough_ground(seed, make_finger, make_touch):
    heights = np.random.default_rng(seed).uniform(-2e-3, 0.0, (64, 64))
    heights[::7] = -np.inf  # nothing there

    def rough(x, y):
        cells = [np.floor(part / 0.27e-3).astype(int) + 32 for part in (x, y)]
        found: Floats = heights[cells[1], cells[0]]
        return found

    finger = make_finger()
    touch = measured(finger, over(finger, make_touch, Ground(rough), depth=0.3e-3))
    assert touch.outcome == "hit"
    assert touch.compression.max() == pytest.approx(0.3e-3, abs=1e-15)
    assert np.isfinite(touch.compression).all()


def test_the_mean_of_a_plane_is_its_height_in_the_middle(make_finger, make_touch):
    finger, slope = make_finger(), 0.05
    touch = measured(finger, over(finger, make_touch, Ground(lambda x, y: slope * x), depth=2e-3))
    one_ray = over(finger, make_touch, Ground(lambda x, y: slope * x), depth=2e-3)
    cast_single_rays(finger, one_ray)
    pressed = one_ray.compression > slope * 0.4e-3  # all of the element is pressed
    assert pressed.sum() > 200
    assert np.allclose(touch.compression[pressed], one_ray.compression[pressed], atol=1e-15)


def test_the_largest_of_a_plane_is_that_of_the_outermost_ray(make_finger, make_touch):
    finger, slope = make_finger(), 0.05
    ground = Ground(lambda x, y: slope * x)
    touch = measured(finger, over(finger, make_touch, ground, depth=2e-3), reading="max")
    x, _ = finger.pad.grid()
    assert touch.compression.max() == pytest.approx(2e-3)
    outermost = 0.8e-3 / 3  # three rays of an element of 0.8 pitch
    surface = slope * (x + outermost)
    expected = touch.advance - 3e-3 + surface
    assert np.allclose(touch.compression, np.maximum(expected, 0.0), atol=1e-15)


def ridge(x, y):
    """A ridge of 1 mm between two columns of taxels, too narrow for a ray at their middles."""
    return np.where(np.abs(x - 0.3e-3) < 0.1e-3, 0.0, -1e-3)


def test_a_ridge_between_the_taxels_is_seen(make_finger, make_touch):
    finger, depth = make_finger(), 0.2e-3
    blind = over(finger, make_touch, Ground(ridge), depth=depth)
    cast_single_rays(finger, blind)
    assert np.ptp(blind.compression) < 1e-15  # it saw the ground and no ridge
    largest = measured(finger, over(finger, make_touch, Ground(ridge), depth=depth), reading="max")
    assert (largest.compression.max(axis=0) > 0.0).sum() == 1
    mean = measured(finger, over(finger, make_touch, Ground(ridge), depth=depth))
    # One ray of three sees the ridge: it is pressed three times as deep, to 0.6 mm.
    assert mean.advance == pytest.approx(3e-3 + 3 * depth)
    assert mean.compression.max() == pytest.approx(depth)


def needle(x, y):
    """A needle of 5 mm under one ray of one element."""
    return np.where(np.hypot(x - 0.5e-3, y - 0.5e-3) < 0.1e-3, 0.0, -5e-3)


def test_a_needle_bottoms_the_pad_before_its_element_reports_depth(make_finger, make_touch):
    finger = make_finger()
    touch = measured(finger, over(finger, make_touch, Ground(needle), depth=1e-3))
    assert touch.outcome == "bottomed"
    assert touch.advance == pytest.approx(3e-3 + 0.8 * 3e-3)
    assert touch.compression.max() == pytest.approx(0.8 * 3e-3 / 9)


@pytest.mark.parametrize("reading", READINGS)
def test_indentation_is_what_is_reported_or_the_way_to_the_nearest_ray(
    reading, make_finger, make_touch
):
    touch = measured(make_finger(), make_touch(), reading=reading)
    touched = touch.compression > 0.0
    assert touched.any() and not touched.all()
    assert np.array_equal(touch.indentation[touched], touch.compression[touched])
    assert (touch.indentation[~touched] <= 0.0).all()
    # On a ball the nearest ray of an element is that on its side towards the middle.
    x, y = np.abs(Pad(16, 16, 1e-3, 3e-3, 0.0, 0.8).grid())
    inner = (x - 0.8e-3 / 3) ** 2 + (y - 0.8e-3 / 3) ** 2
    gap = 3e-3 + 0.03 - np.sqrt(0.03**2 - inner)
    assert np.allclose(touch.indentation[~touched], (touch.advance - gap)[~touched], atol=1e-12)


@pytest.mark.parametrize("reading", READINGS)
def test_outcomes_are_those_of_single_rays_on_smooth_ground(reading, make_finger, make_touch):
    finger = make_finger()
    inside = pose_of(np.array([0.0, 0.0, 0.0299]), FACING_DOWN)
    for given in ({"reach": 2.9e-3}, {"reach": 3.1e-3}, {"depth": 2.9e-3}, {"actual": inside}):
        one, many = make_touch(**given), make_touch(**given)
        cast_single_rays(finger, one)
        measured(finger, many, reading=reading)
        assert many.outcome == one.outcome
        assert many.advance == pytest.approx(one.advance, abs=30e-6)
        assert many.loading == pytest.approx(one.loading, rel=0.01)


def test_a_small_element_sees_what_a_ray_does(make_finger, make_touch):
    finger, small, ray = make_finger(), make_touch(), make_touch()
    measured(finger, small, width=0.05, rays=2)
    cast_single_rays(finger, ray)
    # A quarter of 0.05 mm off the middle, on slopes of up to 0.3.
    assert np.allclose(small.compression, ray.compression, rtol=0.0, atol=1e-6)
    assert np.allclose(small.actual, ray.actual, rtol=0.0, atol=1e-6)


def test_another_reading_is_refused():
    with pytest.raises(ValueError, match="reading is 'median'; expected mean or max"):
        Aperture(reading="median")
