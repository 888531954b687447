"""Objects that are hard to slice or to enter, explored under noise: the stated bound is kept."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.geometry import solidity
from palpate.core.shapes import Mesh, grid_surface
from palpate.launch.files.mesh_file import write_mesh
from palpate.launch.run_directory import read_summary
from tests.graph.conftest import palpate

pytestmark = [pytest.mark.graph, pytest.mark.slow]
SURELY = 3.0  # Times the bound of 95 %: above it the error must never be
NOISE = [{"pose_error": {"sigma": 1e-4}}, {"gaussian_noise": {"sigma": 1e-5}}]


def star(places: Floats) -> Floats:
    """Five rays of half the radius."""
    away, turn = np.hypot(places[:, 0], places[:, 1]), np.arctan2(places[:, 1], places[:, 0])
    wanted = 32.0 * (1.0 + 0.25 * np.cos(5.0 * turn)) / 1.25
    return np.asarray(np.maximum(0.6 * (away - wanted), np.abs(places[:, 2] - 30.0) - 30.0))


def undercut_cone(places: Floats) -> Floats:
    """A cone that stands on a stem."""
    away, height = np.hypot(places[:, 0], places[:, 1]), places[:, 2]
    wanted = np.interp(height, [0.0, 24.0, 30.0, 80.0], [16.0, 16.0, 38.0, 10.0])
    return np.asarray(np.maximum(0.6 * (away - wanted), np.abs(height - 40.0) - 40.0))


def mesh_of(field: Callable[[Floats], Floats]) -> Mesh:
    """The mesh [m] of a field [mm] that is negative inside, on a grid of 2 mm."""
    low, high = np.array([-44.3, -44.3, -2.3]), np.array([44.3, 44.3, 84.3])
    shape = np.ceil((high - low) / 2.0).astype(int) + 1
    nodes = 2.0 * np.moveaxis(np.indices(shape), 0, -1).reshape(-1, 3) + low
    mesh = grid_surface(field(nodes).reshape(shape))
    places = 2.0 * mesh.vertices + low
    return Mesh(1e-3 * (places - [0.0, 0.0, places[:, 2].min()]), mesh.faces)


@pytest.mark.parametrize("field", [star, undercut_cone])
def test_error_of_hard_object_is_within_its_stated_bound(field, tmp_path):
    mesh = mesh_of(field)
    body = solidity(*mesh)
    assert body.watertight and body.genus == 0
    write_mesh(tmp_path / "object.ply", *mesh)
    solid = {"mesh": {"file": "object.ply", "unit": "m"}}
    summary = explored(
        tmp_path, solid, {"planner": "predicted", "tolerance": 5e-4, "feature": 3e-3}
    )
    assert summary["genus"] == 0 or not summary["reached"]


def test_bore_that_pads_bridge_counts_in_the_bound(tmp_path):
    block = {"box": {"size": [0.06, 0.05, 0.03]}}
    bored = {"boolean": {"difference": [block, {"cylinder": {"radius": 0.006, "height": 0.04}}]}}
    summary = explored(tmp_path, bored, {"planner": "touches", "tolerance": 2e-4})
    assert summary["genus"] == 1 or summary["rms_bound_95_m"] > 2e-4


def explored(folder: Path, solid: dict[str, Any], explore: dict[str, Any]) -> dict[str, Any]:
    """What a run says of itself, whose error must not lie far above its bound."""
    scene = {"object": solid, "effects": NOISE, "explore": explore, "seed": 3}
    (folder / "scene.yaml").write_text(json.dumps(scene))
    words = ("run", "scene.yaml", "--composed", "--no-record", "--quiet", "--touches", 150)
    done = palpate(*words, "--out", "run", folder=folder)
    assert done.code in (0, 1), done.err
    summary = read_summary(folder / "run")
    assert summary["watertight"] and summary["rms_bound_95_m"] is not None
    assert summary["rms_m"] < SURELY * summary["rms_bound_95_m"]
    return summary
