from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.core.explore.probing.end_observation import (
    ProbeCommand,
    ProbeResult,
    SideContour,
    turned_command,
    turned_over,
)
from palpate.core.explore.probing.rule import probe_along_axis
from palpate.core.poses import split_pose


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"radius": 0.0}, "radius must be positive and finite, got 0.0 m"),
        ({"width": -1.0}, "width must be positive"),
        ({"tolerance": float("nan")}, "tolerance must be positive"),
        ({"deviation": -1e-3}, "deviation must be 0 or more and finite, got -0.001 m"),
        ({"noise": float("inf")}, "noise must be 0 or more and finite"),
        ({"height": -0.04}, "height must be finite and differ from that of the other end"),
        ({"other": float("inf")}, "height must be finite and differ"),
    ],
)
def test_what_cannot_be_an_end_is_refused(observation, change, words) -> None:
    with pytest.raises(ValueError, match=words):
        replace(observation, **change)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("contour", "words"),
    [
        (
            SideContour(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros(2), np.zeros(2)),
            "at least 3, got 2",
        ),
        (
            SideContour(np.zeros((4, 3)), np.zeros((3, 3)), np.zeros(4), np.zeros(4)),
            "contour.normals must",
        ),
        (
            SideContour(np.zeros((4, 3)), np.zeros((4, 3)), np.zeros(4), np.zeros(3)),
            "contour.contact_high must",
        ),
        (
            SideContour(np.zeros((4, 3)), np.zeros((4, 3)), np.full(4, np.nan), np.zeros(4)),
            "contour.contact_low must be finite",
        ),
    ],
)
def test_a_contour_that_cannot_be_used_is_refused(observation, contour, words) -> None:
    with pytest.raises(ValueError, match=words):
        replace(observation, contour=contour)


def test_turned_over_twice_an_end_is_as_it_was(observation) -> None:
    rng = np.random.default_rng(3)
    points, normals = rng.standard_normal((2, 5, 3))
    contour = SideContour(points, normals, -np.arange(5.0), np.arange(5.0))
    probing = probe_along_axis(observation, np.array([1e-3, 2e-3]))
    made = ProbeResult(probing, "hit", rng.standard_normal(3), rng.standard_normal(3))
    observation = replace(observation, contour=contour, probes=(made,))
    again = turned_over(turned_over(observation))
    assert again.contour is not None and again.height == observation.height
    for before, after in zip(contour, again.contour, strict=True):
        np.testing.assert_array_equal(after, before)
    [other] = again.probes
    np.testing.assert_array_equal(other.point, made.point)
    np.testing.assert_allclose(
        split_pose(other.probing.pose)[1], split_pose(probing.pose)[1], atol=1e-15
    )


def test_a_touch_from_above_becomes_one_from_below(observation) -> None:
    probing: ProbeCommand = turned_command(probe_along_axis(observation, np.array([1e-3, 2e-3])))
    position, axes = split_pose(probing.pose)
    np.testing.assert_allclose(position[:2], [1e-3, -2e-3])
    assert position[2] < -0.04
    np.testing.assert_allclose(axes[:, 2], [0.0, 0.0, 1.0], atol=1e-15)
    np.testing.assert_allclose(probing.target, [1e-3, -2e-3, -0.04])
