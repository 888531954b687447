"""Tests of the filter template. Run them with ``python -m pytest`` in this folder.

Frames show the imprint of a ball, 1 mm deep, in an array of 16 x 16 taxels at 1 mm.
"""

from __future__ import annotations

import numpy as np
from palpate.core.arrays import Floats
from palpate.core.touch import Pad, clean
from palpate.messages.types import SensorInfo, TactileFrame, TactileImage
from palpate.nodes.filter import NODE, Params
from palpate.nodes.specs.sensors import (
    SensorSpec,
    calibration_of_info,
    info_of,
    pad_of_info,
)
from palpate.testing import drive, example, messages_on

INFO: SensorInfo = info_of(SensorSpec(), noise=0.0)
AXIS = (np.arange(INFO.cols) - (INFO.cols - 1) / 2) * INFO.pitch
IMPRINT: Floats = np.maximum(1e-3 - (AXIS[:, None] ** 2 + AXIS**2) / 0.04, 0.0)


def frame(compression: Floats, touch: int = 0) -> tuple[str, TactileFrame]:
    """Frame of a touch; unused fields are 0."""
    array = calibration_of_info(INFO).encode(compression)
    return "/touch/raw", example(TactileFrame, touch=touch, outcome="hit", array=array)


def images(*frames: tuple[str, TactileFrame]) -> list[TactileImage]:
    """Images that the filter publishes for frames."""
    published = drive(NODE, [("/touch/info", INFO), *frames])
    return messages_on(published, "/touch/image")


def test_a_frame_without_noise_is_not_changed() -> None:
    """Without noise and impulses there is nothing to clean."""
    [image] = images(frame(IMPRINT))
    assert np.allclose(image.compression, IMPRINT, rtol=0.0, atol=1e-12)
    assert np.array_equal(image.mask, np.greater(IMPRINT, Params().contact))


def test_an_impulse_is_removed_and_its_neighbours_stay() -> None:
    """The taxel with the impulse is put on the surface, within a tenth of the pitch."""
    struck = IMPRINT.copy()
    struck[6, 7] += 1e-3
    [image] = images(frame(struck))
    assert np.abs(image.compression - IMPRINT).max() < 0.1 * INFO.pitch


def test_noise_of_a_frame_is_no_larger_than_before() -> None:
    """The steps add no noise."""
    pad: Pad = pad_of_info(INFO)
    noise = 1e-5 * np.random.default_rng(1).standard_normal(IMPRINT.shape)
    cleaned = clean(pad, IMPRINT + noise, 1e-5, Params().contact, Params().order)
    touched = cleaned.touched
    assert np.std((cleaned.compression - IMPRINT)[touched]) <= np.std(noise[touched]) * 1.01


def test_a_frame_that_comes_twice_is_published_once() -> None:
    """A network link may deliver a frame twice."""
    assert len(images(frame(IMPRINT), frame(IMPRINT), frame(IMPRINT, touch=1))) == 2
