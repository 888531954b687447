from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.explore.path import Gap
from palpate.core.frames import pose_of
from palpate.core.touch.pad import Pad, press
from palpate.launch.bench_tracing import DOMED, FLAT
from palpate.launch.tracing_objects import OBJECTS, Traced, dented, notched, wedged
from palpate.launch.tracing_reach import hidden


def mouth(target: Traced, half_width: float) -> Gap:
    """A gap as wide as the hollow opposite the first touch."""
    angle = half_width / 0.028
    ends = [
        0.028 * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        for azimuth in (math.pi - angle, math.pi + angle)
    ]
    return Gap(ends[0], ends[1], "bridged")


@pytest.mark.parametrize("pad", [FLAT, DOMED], ids=["flat", "domed"])
def test_nothing_of_a_convex_object_is_hidden(pad: Pad) -> None:
    assert hidden(OBJECTS["cylinder"], pad, 0.0, mouth(OBJECTS["cylinder"], 0.004)) == 0.0


def test_a_slot_that_is_deeper_than_it_is_wide_is_hidden_but_for_its_rims() -> None:
    target = notched(0.020, 0.002)
    chord = hidden(target, DOMED, 0.0, mouth(target, 0.003))
    assert 0.003 < chord < 0.0045


def test_a_dent_shallower_than_the_deepest_press_is_not_hidden() -> None:
    target = dented(0.0022, 0.004)
    assert hidden(target, FLAT, 0.0, mouth(target, 0.005)) == 0.0


def test_a_blunt_wedge_that_an_edge_of_the_pad_enters_is_not_hidden() -> None:
    target = wedged(0.004, 0.006)
    assert hidden(target, FLAT, 0.0, mouth(target, 0.0065)) == 0.0


def test_what_is_said_to_be_within_reach_is_felt_by_a_press_at_some_place() -> None:
    target = wedged(0.004, 0.006)
    bottom = np.array([-0.024, 0.0, 0.0])
    nearest = math.inf
    for turn in np.radians([-40.0, -30.0, 30.0, 40.0]):
        # The pad's edge comes first: it stands half a pad beside the bottom, to either side.
        z = -np.array([-math.cos(turn), -math.sin(turn), 0.0])
        y = np.array([0.0, 0.0, -1.0])
        axes = np.column_stack([np.cross(y, z), y, z])
        for side in (-7.5e-3, 7.5e-3):
            start = bottom - 0.03 * z + side * axes[:, 0] + 0.5e-3 * y
            end = press(target.shape, FLAT, pose_of(start, axes), 0.05, 2.4e-3)
            x, _ = FLAT.grid()
            felt = end.compression[8, 0 if side > 0 else 15]
            if felt > 0.0:
                place = end.pose[:3] + axes @ [x[0, 0] * math.copysign(1, side), 0.0, -felt]
                nearest = min(nearest, float(np.linalg.norm(place[:2] - bottom[:2])))
    assert nearest < 0.1e-3
