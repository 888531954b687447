from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.bench.explore import gp_explorer as peer
from palpate.bench.explore import gp_surface
from palpate.bench.explore.gp_explorer import Explorer, GuardedFinger, Tuning, farthest_points
from palpate.bench.explore.harness import NOISES, Demand, write_scene
from palpate.bench.objects.touched import EXPLORED_OBJECTS
from palpate.bench.table import WIDTH
from palpate.core.geometry.distances import compare_surfaces, prepare_surface
from palpate.launch.scene import load_scene
from palpate.nodes.specs.objects import build_shape

NAME = "ellipsoid"


def explorer_of(folder: Path, noise: str = "exact") -> Explorer:
    scene = write_scene(folder, EXPLORED_OBJECTS[NAME], NOISES[noise], Demand())
    box = build_shape(load_scene(scene).spec.object).bounds()
    return Explorer(GuardedFinger(scene), box, 0.0, Tuning())


def test_fifteen_touches_find_an_ellipsoid(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gp_surface, "CELL", 5e-3)
    monkeypatch.setattr(gp_surface, "LEVEL", 5)
    explorer = explorer_of(tmp_path)
    state = explorer.until(lambda state: state.touches >= 15)
    assert state.touches < 20
    assert 0.05 * state.touches < state.way < 0.2 * state.touches
    shape = build_shape(load_scene(tmp_path / "scene.yaml").spec.object)
    error = compare_surfaces(prepare_surface(*shape.mesh(4)), prepare_surface(*explorer.mesh())).rms
    assert error < 0.01 * 0.09


def test_the_same_finger_with_the_same_noise_explores_alike(tmp_path: Path) -> None:
    ways = [
        explorer_of(tmp_path, "noise").until(lambda state: state.touches >= 4).way for _ in range(2)
    ]
    assert ways[0] == ways[1]


def test_a_touch_beside_the_object_tells_that_nothing_is_there(tmp_path: Path) -> None:
    scene = write_scene(tmp_path, EXPLORED_OBJECTS[NAME], NOISES["exact"], Demand())
    finger = GuardedFinger(scene)
    touched = finger.touch(np.array([0.1, 0.0, 0.045]), np.array([1.0, 0.0, 0.0]), 0.02, 0.01)
    assert touched.outcome == "miss"
    assert len(touched.contact.points) == 0
    assert touched.way == pytest.approx(0.06)
    seen = explorer_of(tmp_path)._seen(touched)
    assert seen.places == pytest.approx(np.array([[0.09, 0.0, 0.045]]))
    assert seen.values[0] > 0.0


def test_chosen_points_lie_far_from_one_another() -> None:
    x, y = np.meshgrid(np.arange(9.0), np.arange(9.0))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(81)])
    chosen = points[farthest_points(points, 5), :2].tolist()
    assert chosen[0] == [4.0, 4.0]
    assert sorted(chosen[1:]) == [[0.0, 0.0], [0.0, 8.0], [8.0, 0.0], [8.0, 8.0]]
    assert farthest_points(points[:3], 5) == [1, 0, 2]


def test_tuned_objects_are_not_among_those_that_count() -> None:
    assert not set(peer.TUNED_ON) & {*peer.COMPARED, *peer.QUICK}
    assert {*peer.TUNED_ON, *peer.COMPARED, *peer.QUICK} <= set(EXPLORED_OBJECTS)


def test_palpate_must_be_twice_as_good_on_the_same_way(monkeypatch: pytest.MonkeyPatch) -> None:
    class Ours:
        percent, travel, touches = 0.1, 6.0, 200

    for error, holds in ((0.19, False), (0.21, True)):
        found = dict.fromkeys(peer.TUNINGS, peer.GpErrors(error, 0.05, 60))
        pair = Ours(), found
        monkeypatch.setattr(peer, "compare_on", lambda name, noise, pair=pair: pair)
        rows = list(peer.gp_comparison(peer.QUICK))
        assert max(len(row.name) for row in rows) < WIDTH
        demanded = [row for row in rows if row.target]
        assert [row.holds for row in demanded] == [holds, holds]
        assert demanded[0].value == f"{10.0 * error:.2f} x"
        assert len([row for row in rows if "over ours" in row.name]) == 8
