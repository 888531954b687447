"""The filter by itself: a frame in, compressions and touched taxels out."""

import numpy as np

from palpate.messages.types import TactileFrame
from palpate.nodes import filter
from palpate.nodes.specs.sensors import SensorSpec, calibration_of_info, info_of
from palpate.testing import drive, example, messages_on

INFO = info_of(SensorSpec(), noise=0.0)
x, y = np.meshgrid(*[(np.arange(16) - 7.5) * 1e-3] * 2)


def bump():
    """Compression [m] by a ball that is pressed in by 1 mm."""
    return np.maximum(1e-3 - (x**2 + y**2) / 0.04, 0.0)


def image_of(compression, **params):
    array = calibration_of_info(INFO).encode(compression)
    frame = example(TactileFrame, finger=1, outcome="hit", array=array, pose=np.eye(7)[6])
    published = drive(filter.NODE, [("/touch/info", INFO), ("/touch/raw", frame)], params)
    [image] = messages_on(published, "/touch/image")
    return image


def test_clean_frame_is_unchanged():
    image = image_of(bump())
    assert np.allclose(image.compression, bump(), atol=1e-12)
    assert np.array_equal(image.mask, bump() > 50e-6) and image.impulses == 0


def test_taxel_far_too_large_is_left_out():
    broken = bump()
    broken[3, 9] = 2.4e-3
    image = image_of(broken)
    assert image.impulses == 1 and not image.mask[3, 9]


def test_median_order_lowers_a_spike():
    spike = bump()
    spike[8, 8] += 0.3e-3
    assert image_of(spike, order="median").compression[8, 8] < bump()[8, 8] + 0.05e-3
