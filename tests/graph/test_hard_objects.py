"""Objects that slices do badly on, explored with noise: what is promised of them is kept."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.core.geometry import solidity
from tests.graph.hard_objects import HARD_OBJECTS, mesh_of
from tests.studies.harness import NOISY, Demand, Explored, explore_scene, write_scene

TOLERANCE = 5e-4  # m
MOST = {"planner.most_touches": 400}
SURELY = 3.0  # Times the bound of 95 %: above it the error must never be
HOLLOW = ("bore", "slit")  # Narrower than the pad: no touch tells how deep
ASKED_HOLE = 1e-2  # m: by default no hole is asked for that is as small as these
SLICED = ("mug", "two towers", "bore", "slit", "thin walls", "undercut cone", "brick 3")


def explored(name: str, planner: str, folder: Path) -> Explored:
    field, half, _ = HARD_OBJECTS[name]
    feature = ASKED_HOLE if name in HOLLOW else None
    demand = Demand(planner=planner, tolerance=TOLERANCE, feature=feature)
    return explore_scene(write_scene(folder, mesh_of(field, half), NOISY, demand), 1, MOST)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("name", "planner"),
    [(name, "touches") for name in HARD_OBJECTS] + [(name, "predicted") for name in SLICED],
)
def test_a_hard_object_is_never_further_off_than_is_said(name: str, planner: str, tmp_path: Path):
    found = explored(name, planner, tmp_path)
    assert found.score is not None and found.score.watertight
    assert found.done.rms_bound_95 is not None
    assert found.score.rms < SURELY * found.done.rms_bound_95
    assert found.score.genus == HARD_OBJECTS[name][2] or not found.done.reached
    if name in HOLLOW:
        assert not found.done.reached
        assert found.done.findings["unentered_hole"] > 0.0
        assert len(found.models[-1].openings)


@pytest.mark.parametrize("name", [name for name in HARD_OBJECTS if "brick" not in name])
def test_hard_objects_are_solids_of_their_genus(name: str):
    field, half, genus = HARD_OBJECTS[name]
    body = solidity(*mesh_of(field, half))
    assert body.watertight and body.genus == genus
