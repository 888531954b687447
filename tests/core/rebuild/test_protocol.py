"""The interface of all solids, `palpate.Solid`, whatever they were rebuilt from."""

import sys
from dataclasses import fields
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
import trimesh

import palpate
from palpate.launch.files.source_map import InputError
from tests.core.rebuild.general.test_general import RADIUS as RING, TUBE, torus_distance
from tests.core.rebuild.objects import circle

RADIUS, HEIGHT = 0.03, 0.06


@pytest.fixture(scope="module")
def ball():
    normals = np.random.default_rng(0).normal(size=(300, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return palpate.rebuild_general(RADIUS * normals, 2.0 * normals, cell=5e-3)


@pytest.fixture(scope="module")
def cylinder():
    ends = np.array([[0.0, 0.0, -0.5 * HEIGHT], [0.0, 0.0, 0.5 * HEIGHT]])
    rings, heights = [RADIUS * circle(24)] * 3, (-0.02, 0, 0.02)
    return palpate.reconstruct(rings, tops=ends, heights=heights, method="skin")


@pytest.fixture(scope="module")
def torus():
    mesh = trimesh.creation.torus(RING, TUBE, major_sections=192, minor_sections=96)
    return palpate.MeshSolid(mesh.vertices, mesh.faces)


def cylinder_distance(points):
    beside = np.hypot(points[:, 0], points[:, 1]) - RADIUS
    beyond = np.abs(points[:, 2]) - 0.5 * HEIGHT
    outside = np.hypot(np.maximum(beside, 0.0), np.maximum(beyond, 0.0))
    return outside + np.minimum(np.maximum(beside, beyond), 0.0)


AREA, WIDE = np.pi * RADIUS**2, 2.0 * np.pi * RADIUS  # of a section of ball and cylinder
SHAPES = {
    "ball": (lambda x: np.linalg.norm(x, axis=1) - RADIUS, AREA * RADIUS / 0.75, 4 * AREA, 0, 5e-5),
    "torus": (torus_distance, 2 * np.pi**2 * RING * TUBE**2, 4 * np.pi**2 * RING * TUBE, 1, 2e-5),
    "cylinder": (cylinder_distance, AREA * HEIGHT, WIDE * HEIGHT + 2.0 * AREA, 0, 1e-5),
}


@pytest.fixture(params=sorted(SHAPES))
def shape(request):
    """A solid of each class, with its true distance, volume, area, genus, and a tolerance."""
    return (request.getfixturevalue(request.param), *SHAPES[request.param])


def test_measures_and_distances_are_true(shape):
    solid, expected, volume, area, genus, tolerance = shape
    assert isinstance(solid, palpate.Solid)
    assert solid.volume == pytest.approx(volume, rel=2e-3)
    assert solid.area == pytest.approx(area, rel=2e-3)
    assert solid.genus == genus
    assert solid.check() == (True, True, genus, 0, 0)
    points = np.random.default_rng(1).uniform(-0.06, 0.06, (150, 3))
    assert solid.signed_distance(points) == pytest.approx(expected(points), abs=tolerance)
    assert np.array_equal(solid.distance(points), np.abs(solid.signed_distance(points)))
    assert solid.signed_distance(np.zeros((0, 3))).shape == (0,)
    # Normals point along the gradient of the distance.
    points = np.random.default_rng(2).uniform(-0.06, 0.06, (500, 3))
    step = 1e-7 * np.eye(3)
    slopes = [(expected(points + one) - expected(points - one)) / 2e-7 for one in step]
    on_face = ~((np.hypot(*points[:, :2].T) > RADIUS) & (np.abs(points[:, 2]) > 0.5 * HEIGHT))
    off = np.linalg.norm(solid.normal(points) - np.column_stack(slopes), axis=1)
    assert np.quantile(off[on_face], 0.98) < 0.03  # elsewhere the closest point is a crease
    for ask in (solid.distance, solid.signed_distance, solid.normal):
        for wrong in ([[np.nan, 0.0, 0.0]], [0.0, 0.0, 0.0], [[0.0, 0.0]], "abc"):
            with pytest.raises(ValueError, match=r"points must"):
                ask(wrong)


def test_measures_agree_with_trimesh(shape):
    solid, measures = shape[0], shape[0].measures()
    mesh = solid.to_trimesh()
    assert isinstance(mesh, trimesh.Trimesh) and mesh.is_watertight
    assert measures.volume_m3 == pytest.approx(mesh.volume, rel=2e-3)
    assert measures.centroid_m == pytest.approx(mesh.center_mass, abs=1e-5)
    least = 2e-3 * mesh.moment_inertia.max()
    assert measures.inertia_m5 == pytest.approx(mesh.moment_inertia, abs=least)
    assert measures.extents_m == pytest.approx(np.ptp(solid.bounds, axis=0))
    assert np.array_equal(solid.bounds, mesh.bounds)
    exact = solid.final_mesh.measures()
    assert exact.volume_m3 == pytest.approx(mesh.volume, rel=1e-9)
    assert exact.inertia_m5 == pytest.approx(mesh.moment_inertia, abs=1e-9 * least)


def test_saved_and_exported_solids_are_loaded_again(shape, tmp_path):
    solid = shape[0]
    palpate.save(solid, tmp_path / "solid.npz")
    again = palpate.load(tmp_path / "solid.npz")
    assert type(again) is type(solid)
    assert np.array_equal(again.mesh().vertices, solid.mesh().vertices)
    for suffix in (".ply", ".stl", ".obj", ".glb"):
        solid.export(tmp_path / f"solid{suffix}")
        again = palpate.load(tmp_path / f"solid{suffix}")
        assert isinstance(again, palpate.Solid)
        assert again.volume == pytest.approx(solid.to_trimesh().volume, rel=1e-5)
        assert again.bounds == pytest.approx(solid.bounds, abs=1e-8)
    for name, words in (
        ("a.foo", r"a\.foo: must end in one of \.ply, \.stl"),
        ("none/a.stl", r"a\.stl: cannot be written: there is no folder"),
    ):
        with pytest.raises(InputError, match=words):
            solid.export(tmp_path / name)
    assert len([*tmp_path.iterdir()]) == 5


def test_check_names_faults_of_meshes():
    coarse = trimesh.creation.torus(RING, TUBE, major_sections=48, minor_sections=24)
    torus = palpate.MeshSolid(coarse.vertices, coarse.faces)
    faces = torus.faces.copy()
    open_solid = palpate.MeshSolid(torus.vertices, faces[1:])
    assert open_solid.check()[:3] == (False, False, None) and open_solid.genus is None
    faces[0] = faces[0, ::-1]
    assert palpate.MeshSolid(torus.vertices, faces).check()[:3] == (True, False, None)
    inside_out = palpate.MeshSolid(torus.vertices, torus.faces[:, ::-1])
    assert inside_out.check()[:3] == (True, False, 1)
    shifted = np.concatenate([torus.faces, torus.faces + len(torus.vertices)])
    double = np.concatenate([torus.vertices, torus.vertices + [0.02, 0.0, 0.003]])
    assert palpate.MeshSolid(double, shifted).check().self_crossings > 0
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0, 0]])
    fan = [[0, 2, 4], [4, 2, 1], [0, 4, 3], [4, 1, 3], [0, 3, 2], [1, 2, 3], [0, 4, 1]]
    assert palpate.MeshSolid(flat, fan).check().degenerate_faces == 1


def test_final_mesh_replaces_own_mesh(ball, torus):
    other = ball.with_final_mesh(torus.vertices, torus.faces)
    assert (other.genus, ball.genus) == (1, 0)
    assert other.volume == pytest.approx(torus.volume)
    assert np.array_equal(other.mesh().faces, ball.mesh().faces)


def test_solid_is_shown_in_window_without_viser(ball, monkeypatch):
    import matplotlib as mpl

    mpl.use("Agg")
    monkeypatch.setitem(sys.modules, "viser", None)
    monkeypatch.setattr("matplotlib.pyplot.show", lambda: None)
    figure = ball.show()
    assert figure.axes[0].get_title() == repr(ball)
    figure.canvas.draw()
    assert np.asarray(figure.canvas.buffer_rgba())[..., :3].std() > 1.0


def test_solid_is_shown_by_viser_on_loopback_alone(ball, monkeypatch, capsys):
    server = MagicMock(**{"return_value.get_port.return_value": 8080})
    monkeypatch.setitem(sys.modules, "viser", SimpleNamespace(ViserServer=server))
    shown = ball.show().scene.add_mesh_simple.call_args.args
    assert server.call_args.kwargs["host"] == "127.0.0.1"
    assert (shown[0], len(shown[1])) == ("/solid", len(ball.mesh().vertices))
    assert capsys.readouterr().out == f"{ball!r} is shown at http://127.0.0.1:8080\n"


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("cylinder", "<LatticeSolid 0.06 x 0.06 x 0.06, skin of 3 contours>"),
        ("ball", "<GeneralSolid 0.06 x 0.06 x 0.06 m, of 300 touches>"),
        ("torus", "<MeshSolid 0.078 x 0.078 x 0.022 m, of 36864 triangles>"),
    ],
)
def test_repr_of_solid_and_records_is_short(name, line, request):
    solid = request.getfixturevalue(name)
    assert repr(solid) == line
    records = [getattr(solid, record.name) for record in fields(solid)]
    records += [solid.mesh(), solid.check(), solid.measures(), solid.closest([[0, 0, 0]])]
    for record in records:
        if not isinstance(record, np.ndarray):
            assert len(repr(record)) < 1000 and repr(record).count("\n") < 9, type(record)
