"""Three fingers on cones: axis and apex from features, and refusals."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.core import shapes
from palpate.core.procedures.fearing import fearing

from .conftest import NOISES, drive, posed, prism, turned

# Solid, true axis from bottom to top, true apex, m.
ROUND = turned([[0.0, 1.0], [0.08, 0.4]])
CONES = {
    "round": (ROUND, [0, 0, 1.0], [0, 0, 0.4 / 3.0]),
    "elliptic": (turned([[0.0, 1.0], [0.08, 0.6]], (0.035, 0.025)), [0, 0, 1.0], [0, 0, 0.2]),
    "upside down": (turned([[0.0, 0.5], [0.08, 1.0]]), [0, 0, -1.0], [0, 0, -0.08]),
    "pyramid": (prism(4, 0.04, 0.06, 0.4), [0, 0, 1.0], [0, 0, 0.1]),
    "six-sided": (prism(6, 0.04, 0.07, 0.5), [0, 0, 1.0], [0, 0, 0.14]),
}


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("name", CONES)
def test_axis_and_apex_follow_from_what_three_fingers_touch(name, noise):
    solid, axis, apex = CONES[name]
    found = drive(fearing, solid, NOISES[noise], fingers=3).findings
    assert found.status == "done", found.reason
    assert found.mesh is None  # what the section is nobody knows
    leans = np.degrees(np.arccos(min(float(found.shape.orientation.axis @ axis), 1.0)))
    off = np.linalg.norm(found.shape.origin.point - apex)
    assert leans < (0.1 if noise == "exact" else 3.0 * found.figures["axis_error_deg"])
    assert off < (1e-4 if noise == "exact" else 4.0 * found.figures["apex_error_m"])


def test_a_cone_that_leans_is_found_in_a_few_touches():
    solid = posed(ROUND, 0.01, np.radians(15.0))
    found = drive(fearing, solid, fingers=3)
    assert found.findings.status == "done" and found.touches < 18
    axis = np.array([0.3, -1.0, 0.0]) / np.hypot(1.0, 0.3) * np.sin(np.radians(15.0))
    axis[2] = np.cos(np.radians(15.0))
    assert np.degrees(np.arccos(found.findings.shape.orientation.axis @ axis)) < 0.3


STONE = 1e-3 * np.array(
    [[r * np.cos(a), r * np.sin(a), z] for r, z in ((22, 0), (38, 45), (20, 80))
     for a in np.arange(6) * np.pi / 3]
)  # fmt: skip
REFUSED = {
    "amphora": (
        turned(
            [[0, 0.8], [0.02, 1], [0.045, 1.05], [0.07, 0.75], [0.085, 0.62], [0.1, 0.62]],
            smooth=True,
        ),
        "curved both ways",
    ),
    "stone of two cones": (
        shapes.Polyhedron(
            STONE,
            [
                [5, 4, 3, 2, 1, 0],
                [12, 13, 14, 15, 16, 17],
                *[
                    [6 * k + i, 6 * k + (i + 1) % 6, 6 * k + 6 + (i + 1) % 6, 6 * k + 6 + i]
                    for k in range(2)
                    for i in range(6)
                ],
            ],
        ),
        "no cone has",
    ),
    "cylinder": (turned([[0.0, 1.0], [0.09, 1.0]], (0.025, 0.025)), ""),
    "block": (prism(4, 0.04, 0.06), ""),
    "ball": (posed(shapes.Superquadric(np.full(3, 0.035), np.ones(2)), 0.035), "curved both ways"),
}


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_cone_is_refused_with_the_combination_and_the_reason(name, noise):
    solid, why = REFUSED[name]
    found = drive(fearing, solid, NOISES[noise], fingers=3).findings
    assert found.status == "unsuited" and found.shape is None
    assert why in found.reason
    assert any(word in found.reason for word in ("apex", "no cone", "feature of a cone"))


def test_two_fingers_are_too_few():
    found = drive(fearing, ROUND, fingers=2)
    assert found.findings.status == "unsuited" and found.touches == 0
