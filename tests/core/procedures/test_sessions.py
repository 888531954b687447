"""Sessions of procedures, and the planes and cones that are fitted to touches."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from palpate.core import procedures
from palpate.core.arrays import Floats
from palpate.core.procedures.polyhedron import fit_plane
from palpate.core.touch import Pad

SETUP = procedures.TouchSetup(Pad(16, 16, 1e-3, 3e-3, 66.0, 0.8), 0.0, 0.0, 0.12)
RESULT = procedures.HandContacts(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.int32), 0.0)
UP = np.array([0.0, 0.0, 1.0])
ROUND = procedures.ConeFitSettings(n_harmonics=0)


def test_next_move_depends_on_results_alone():
    begun: list[int] = []

    def procedure() -> Iterator[Any]:
        begun.append(1)
        for number in range(3):  # in place of moves
            _ = yield number
        return procedures.Findings(status="done", reason="counted")

    session = procedures.Session(procedure)
    assert [session.after((RESULT,) * n) for n in range(3)] == [0, 1, 2]
    assert session.after((RESULT,) * 3).reason == "counted" and len(begun) == 1
    # Results that do not extend the last ones restart it.
    assert [session.after((RESULT,) * n) for n in (2, 1, 2, 2)] == [2, 1, 2, 2]
    assert len(begun) == 4


@pytest.mark.parametrize("name", procedures.PROCEDURE_NAMES)
def test_procedure_begins_by_name(name):
    assert procedures.begin_procedure(name, {}, SETUP).after(()) is not None


def patches(rng: np.random.Generator, offsets: Floats) -> list[Floats]:
    """Touches of the plane z = 0.02, each shifted along z by its offset."""
    flats = [rng.uniform(-6e-3, 6e-3, (80, 2)) + rng.uniform(-0.03, 0.03, 2) for _ in offsets]
    heights = [np.full(80, 0.02 + offset) for offset in offsets]
    return [np.column_stack(columns) for columns in zip(flats, heights, strict=True)]


def test_plane_fit_states_its_normal_error():
    rng, tilt, stated = np.random.default_rng(5), [], []
    for side in (1.0, -1.0):
        fit = fit_plane(patches(rng, np.zeros(5)), side * UP, 0.0, 1e-4, 1e-3)
        assert fit.plane.normal == pytest.approx(side * UP, abs=1e-12)
        assert fit.plane.offset == pytest.approx(0.02 * side) and fit.rms < 1e-15
    for _ in range(200):
        fit = fit_plane(patches(rng, rng.normal(0.0, 1e-4, 6)), UP, 1e-5, 1e-4, 1)
        tilt.append(math.acos(min(fit.plane.normal[2], 1.0)))
        stated.append(fit.normal_error)
    spreads = [np.sqrt(np.mean(np.square(angles))) for angles in (tilt, stated)]
    assert spreads[0] == pytest.approx(spreads[1], rel=0.2)


def test_cone_fit_corrects_approximate_axis():
    rng, touches = np.random.default_rng(1), []
    for height in np.linspace(0.0, 0.08, 12):
        azimuths, heights = rng.uniform(0, 2 * np.pi, 40), height + rng.uniform(-5e-3, 5e-3, 40)
        ring = (0.02 + 0.1 * heights) * np.array([np.cos(azimuths), np.sin(azimuths)])
        touches.append(np.column_stack([*ring, heights]))
    start = np.array([0.05, -0.03, 1.0]) / np.linalg.norm([0.05, -0.03, 1.0])
    for kind in ("revolution", "linear"):
        cone = procedures.fit_cone(touches, kind, np.array([1e-3, -2e-3, 0.0]), start, 1e-4)
        assert cone.rms < 1e-7
        assert kind == "linear" or np.linalg.norm(cone.axis[:2]) < 2e-5


def test_stated_axis_error_is_its_scatter():
    rng, leans, stated = np.random.default_rng(2), [], []
    for _ in range(40):
        touches = []
        for number in range(24):
            azimuth = number * 2.4 + rng.uniform(-0.2, 0.2, 40)
            heights = 0.08 * number / 23 + rng.uniform(-5e-3, 5e-3, 40)
            ring = 0.025 * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
            touches.append(np.column_stack([ring, heights]) + rng.normal(0.0, 1e-4, 3))
        cone = procedures.fit_cone(touches, "linear", np.zeros(3), UP, 1e-4, settings=ROUND)
        leans.append(np.linalg.norm(cone.axis[:2]))
        stated.append(cone.axis_error)
    assert np.sqrt(np.mean(np.square(leans))) == pytest.approx(np.mean(stated), rel=0.3)


@pytest.mark.parametrize(("touches", "words"), [
    ([np.zeros((2, 3))], "a plane needs 3 points, got 2"),
    ([np.outer(np.arange(9.0), [1.0, 0, 0])], "on a line"),
])  # fmt: skip
def test_too_few_points_or_touches_raise(touches, words):
    with pytest.raises(ValueError, match=words):
        fit_plane(touches, UP, 0.0, 1e-4, 1e-3)
    with pytest.raises(ValueError, match="4 touches, got 3"):
        procedures.fit_cone([np.zeros((5, 3))] * 3, "linear", np.zeros(3), UP, 1e-4)
