"""The hole and cavity explorer: where fingers fall in."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.core import shapes
from palpate.core.explore import empty_map
from palpate.core.procedures.openings import openings, openings_in

from .conftest import NOISES, drive, turned


def cut(outer: shapes.Shape, inner: shapes.Shape) -> shapes.BooleanShape:
    return shapes.BooleanShape(shapes.difference(outer, inner))


OUTER = turned([[0.0, 1.0], [0.06, 1.0]], (0.04, 0.04))
THROUGH = turned([[-0.01, 1.0], [0.07, 1.0]], (0.015, 0.015))
CUP = turned([[0.015, 1.0], [0.07, 1.0]], (0.028, 0.028))
ACROSS = shapes.PosedSolid(
    turned([[-0.06, 1.0], [0.06, 1.0]], (0.012, 0.012)),
    np.array([0.0, 0, 0.033, 0, np.sqrt(0.5), 0, np.sqrt(0.5)]),
)
SOLIDS = {
    "solid": (OUTER, []),
    "tube": (cut(OUTER, THROUGH), ["hole"]),
    "cup": (cut(OUTER, CUP), ["cavity"]),
    "pierced": (cut(OUTER, ACROSS), ["hole"]),
}


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("name", SOLIDS)
def test_holes_and_cavities_are_told_apart(name, noise):
    solid, kinds = SOLIDS[name]
    found = drive(openings, solid, NOISES[noise]).findings
    assert found.status == "done"
    assert [one.kind for one in found.shape.openings] == kinds, found.reason


def test_a_cavity_has_its_place_axis_width_and_depth():
    found = drive(openings, SOLIDS["cup"][0]).findings.shape.openings[0]
    assert found.axis == pytest.approx([0, 0, 1.0], abs=0.05)
    assert np.abs(found.place[:2]).max() < 5e-3
    assert found.width == pytest.approx(0.056, abs=0.015)
    assert found.depth == pytest.approx(0.045, abs=0.006)


def test_a_hole_runs_along_its_axis():
    found = drive(openings, SOLIDS["pierced"][0]).findings.shape.openings[0]
    assert abs(found.axis[0]) > 0.95 and found.depth == pytest.approx(0.076, abs=0.01)


def test_a_pitch_that_leaves_gaps_is_refused():
    with pytest.raises(ValueError, match=r"pitch must be from 0.3 to 1, got 1.5"):
        drive(openings, OUTER, pitch=1.5)


def test_points_in_a_plane_have_no_openings():
    flat = np.column_stack([np.random.default_rng(0).uniform(-0.02, 0.02, (30, 2)), np.zeros(30)])
    assert openings_in(empty_map(0.1, 0.0), flat) == ()
