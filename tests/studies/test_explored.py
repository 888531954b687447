from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.planners.trial import TUNED
from palpate.core.geometry.meshes import solidity
from palpate.core.geometry.nearest import nearest_points
from palpate.launch.scene import load_scene
from palpate.nodes.specs.objects import build_shape
from tests.studies import explored
from tests.studies.explorations import leaning
from tests.studies.explored import (
    EXPLORED_HEIGHT,
    EXPLORED_OBJECTS,
    ROUNDING,
    mesh_of_radius,
    rounded,
)
from tests.studies.harness import NOISY, Demand, write_scene
from tests.studies.rebuilt import REBUILT_SHAPES, SHAPE_HEIGHT, truth_of

QUICK = ("sphere", "groove", "rounded box")
SHAPES = [
    pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in REBUILT_SHAPES
]


@pytest.mark.parametrize("name", SHAPES)
def test_the_mesh_of_an_object_is_closed_and_its_contours_lie_on_it(name):
    shape, truth = REBUILT_SHAPES[name], truth_of(name)
    mesh = shape.true_mesh()
    found = solidity(mesh.vertices, mesh.faces)
    assert (found.watertight, found.genus, found.components) == (True, 0, 1)
    assert found.volume == truth.volume > 0.0
    assert mesh.vertices[:, 2].min() == pytest.approx(shape.low, abs=0.01)
    assert mesh.vertices[:, 2].max() == pytest.approx(shape.high, abs=0.01)
    assert shape.high - shape.low == pytest.approx(SHAPE_HEIGHT, rel=0.05)
    assert truth.floor < 0.01
    contours = shape.contours(np.linspace(shape.low + 0.5, shape.high - 0.5, 9), 24, 0.3)
    assert nearest_points(truth.surface.search, contours.reshape(-1, 3)).distances.max() < 0.05
    x, y = contours[..., 0], contours[..., 1]
    assert ((x * np.roll(y, -1, 1) - np.roll(x, -1, 1) * y).sum(axis=1) > 0.0).all()


DEMAND = Demand(tolerance=2e-4)
AROUND = np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False)


def straight(z: Floats, t: Floats) -> Floats:
    return 0.3 + 0.0 * z + 0.0 * t


@pytest.mark.parametrize("name", ["cone", "star"])
def test_a_mesh_of_a_radius_is_one_closed_solid_that_stands_on_the_floor(name):
    mesh = mesh_of_radius(EXPLORED_OBJECTS[name])
    found = solidity(mesh.vertices, mesh.faces)
    assert (found.watertight, found.genus, found.components) == (True, 0, 1)
    assert mesh.vertices[:, 2].min() == 0.0
    assert mesh.vertices[:, 2].max() == pytest.approx(EXPLORED_HEIGHT)


def test_a_mesh_has_the_volume_of_its_radius():
    mesh = mesh_of_radius(straight)
    volume = np.pi * (0.3 * EXPLORED_HEIGHT) ** 2 * EXPLORED_HEIGHT
    assert solidity(mesh.vertices, mesh.faces).volume == pytest.approx(volume, rel=2e-4)


def test_flat_ends_are_rounded_off_and_nothing_else():
    shape = rounded(straight)
    z = np.array([0.0, ROUNDING * (1.0 - np.sqrt(0.5)), ROUNDING, 0.5, 1.0])[:, None]
    found = shape(z, AROUND[None])
    drop = ROUNDING * (1.0 - np.sqrt(0.5))
    wanted = np.array([0.3 - ROUNDING, 0.3 - drop, 0.3, 0.3, 0.3 - ROUNDING])
    assert found == pytest.approx(np.repeat(wanted[:, None], 90, axis=1))


def test_an_end_that_comes_to_a_point_is_left_as_it_is():
    z = np.linspace(0.0, 1.0, 50)[:, None]
    assert (rounded(TUNED["pear"])(z, AROUND[None]) == TUNED["pear"](z, AROUND[None])).all()


@pytest.mark.parametrize(
    "name", [name for name, one in EXPLORED_OBJECTS.items() if not callable(one)]
)
def test_a_described_object_is_as_high_as_the_others(name, tmp_path):
    scene = load_scene(write_scene(tmp_path, EXPLORED_OBJECTS[name], (), DEMAND))
    assert scene.size[2] == pytest.approx(EXPLORED_HEIGHT, rel=0.06)
    assert build_shape(scene.spec.object).bounds()[0, 2] == pytest.approx(0.0, abs=2e-3)


def test_a_scene_says_what_stands_where_and_what_is_asked(tmp_path, monkeypatch):
    monkeypatch.setattr(explored, "RINGS", 60)
    monkeypatch.setattr(explored, "TURNS", 48)
    demand = Demand("uniform", 3e-4, {"count": 5})
    pose = leaning(25.0, 0.03, 0.07)
    path = write_scene(tmp_path, EXPLORED_OBJECTS["bottle"], NOISY, demand, 9, pose)
    scene = load_scene(path)
    assert scene.spec.seed == 9
    assert scene.spec.effects["pose_error"] == {"sigma": 1e-4}
    assert scene.spec.effects["gaussian_noise"] == {"sigma": 1e-5}
    asked = scene.spec.explore
    assert (asked["planner"], asked["tolerance"]) == ("uniform", 3e-4)
    assert asked["settings"] == {"count": 5}
    low, high = build_shape(scene.spec.object).bounds()
    top = 0.03 + np.sin(np.radians(25.0)) * EXPLORED_HEIGHT
    assert low[0] < 0.01 < top < high[0]
    assert high[2] == pytest.approx(0.07 + np.cos(np.radians(25.0)) * EXPLORED_HEIGHT, abs=0.008)


def test_a_described_object_is_moved_with_its_own_place(tmp_path):
    path = write_scene(
        tmp_path, EXPLORED_OBJECTS["sphere"], (), DEMAND, moved=leaning(90.0, 0.01, 0.07)
    )
    low, high = build_shape(load_scene(path).spec.object).bounds()
    assert 0.5 * (low + high) == pytest.approx([0.055, 0.0, 0.07])
