"""Tests of the driver template. Run them with ``python -m pytest`` in this folder."""

from __future__ import annotations

import numpy as np
from palpate.nodes import collector, curvature, filter, reconstructor
from palpate.testing import drive, messages_on
from palpate.tools.templates.driver import SOURCE


def test_sensor_comes_first_and_frames_in_order() -> None:
    """The filter and later nodes wait for the sensor."""
    published = drive(SOURCE, params={"frames": 5})
    assert len(messages_on(published[:1], "/touch/info")) == 1
    assert [frame.touch for frame in messages_on(published, "/touch/raw")] == [0, 1, 2, 3, 4]


def test_patches_have_the_curvature_of_the_ball() -> None:
    """The ball has a radius of 20 mm; curvatures are within 2 %."""
    published = drive(SOURCE, params={"frames": 5})
    info = published[:1]
    images = drive(filter.NODE, published[:-2])
    patches = messages_on(drive(curvature.NODE, [*info, *images]), "/touch/patch")
    assert len(patches) == 5
    for patch in patches:
        assert patch.kind == "smooth"
        assert abs(patch.k1 - 50.0) < 1.0
        assert abs(patch.k2 - 50.0) < 1.0


def test_solid_of_the_frames_is_the_ball() -> None:
    """Within 0.1 mm, with the nodes of driver.yaml."""
    published = drive(SOURCE)
    images = drive(filter.NODE, published[:-2])
    patches = drive(curvature.NODE, [*published[:1], *images])
    *probes, world, goal = drive(collector.NODE, [*published[:1], *patches, *published[-2:]])
    published = drive(reconstructor.NODE, [world, *published[:1], *patches, *probes, goal])
    (model,) = messages_on(published, "/model/shape")
    assert np.abs(np.linalg.norm(model.vertices, axis=1) - 0.02).max() < 1e-4
