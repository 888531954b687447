"""What every solid can do: distances, trimesh, a look, and a line about itself."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

import palpate

RADIUS = 0.03


@pytest.fixture(scope="module")
def normals():
    found = np.random.default_rng(0).normal(size=(300, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def ball(normals):
    return palpate.rebuild_general(RADIUS * normals, 2.0 * normals)


@pytest.fixture(scope="module")
def cylinder():
    turn = 2.0 * np.pi * np.arange(24) / 24
    ring = RADIUS * np.column_stack([np.cos(turn), np.sin(turn)])
    levels = (-0.02, 0.0, 0.02)
    ends = np.array([[0.0, 0.0, -0.03], [0.0, 0.0, 0.03]])
    return palpate.reconstruct([ring] * 3, tops=ends, heights=levels)


def test_scattered_points_with_normals_are_a_solid(ball):
    places = np.array([[0.0, 0.0, 0.0], [2.0 * RADIUS, 0.0, 0.0], [0.0, 0.0, 0.02]])
    expected = np.linalg.norm(places, axis=1) - RADIUS
    assert ball.distance(places) == pytest.approx(expected, abs=1e-4)
    with pytest.raises(ValueError, match="points and normals"):
        palpate.rebuild_general(places)


def test_distances_are_negative_inside(cylinder):
    assert cylinder.distance([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0]]) == pytest.approx(
        [-RADIUS, 0.02], abs=1e-5
    )
    with pytest.raises(ValueError, match="points"):
        cylinder.distance([[np.nan, 0.0, 0.0]])


def test_a_solid_is_one_line(ball, cylinder):
    assert repr(cylinder) == "<Solid 0.06 x 0.06 x 0.06, lattice of 3 contours>"
    assert repr(ball).startswith("<GeneralSolid 0.0") and "300 touches" in repr(ball)
    assert "\n" not in repr(ball) + repr(cylinder)


def test_it_becomes_a_trimesh(ball, cylinder):
    for solid, volume in (
        (ball, 4.0 / 3.0 * np.pi * RADIUS**3),
        (cylinder, np.pi * RADIUS**2 * 0.06),
    ):
        mesh = solid.to_trimesh()
        assert isinstance(mesh, trimesh.Trimesh) and mesh.is_watertight
        assert mesh.volume == pytest.approx(volume, rel=0.01)


def test_it_is_shown_in_a_window_where_there_is_no_viser(ball, monkeypatch):
    import matplotlib as mpl

    mpl.use("Agg")
    monkeypatch.setitem(sys.modules, "viser", None)
    monkeypatch.setattr("matplotlib.pyplot.show", lambda: None)
    figure = ball.show()
    assert figure.axes[0].get_title() == repr(ball)
    figure.canvas.draw()
    assert np.asarray(figure.canvas.buffer_rgba())[..., :3].std() > 1.0


def test_it_is_shown_on_loopback_alone_where_there_is(ball, monkeypatch):
    shown = []

    def serve(host):
        add = lambda name, vertices, faces, color: shown.append((name, len(vertices)))  # noqa: E731
        return SimpleNamespace(host=host, scene=SimpleNamespace(add_mesh_simple=add))

    monkeypatch.setitem(sys.modules, "viser", SimpleNamespace(ViserServer=serve))
    assert ball.show().host == "127.0.0.1"
    assert shown == [("/solid", len(ball.mesh().vertices))]


def test_a_general_solid_is_kept_in_a_file(ball, tmp_path):
    palpate.save(ball, tmp_path / "ball.npz")
    again = palpate.load(tmp_path / "ball.npz")
    assert np.array_equal(again.mesh().vertices, ball.mesh().vertices)
