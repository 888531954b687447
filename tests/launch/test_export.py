from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import trimesh

import palpate
from palpate.core.archive import equal_trees
from palpate.core.archive_bytes import pack
from palpate.launch.export import export_model, mesh_sha256
from palpate.launch.located import InputError
from palpate.messages.codec import decode, encode
from palpate.messages.types import ShapeModel


def test_the_meshes_keep_volume_and_unit(tetrahedron: ShapeModel, tmp_path: Path) -> None:
    names = export_model(tetrahedron, tmp_path)

    assert sorted(names) == sorted(path.name for path in tmp_path.iterdir())
    volume = 0.01 * 0.02 * 0.03 / 6.0
    for name, scale in (("mesh.ply", 1.0), ("mesh.stl", 1000.0), ("mesh.glb", 1.0)):
        mesh = trimesh.load(tmp_path / name, force="mesh")
        assert mesh.is_watertight
        np.testing.assert_allclose(mesh.volume, volume * scale**3, rtol=1e-5)


def test_gltf_stands_upright_with_y_up(tetrahedron: ShapeModel, tmp_path: Path) -> None:
    export_model(tetrahedron, tmp_path)

    low, high = trimesh.load(tmp_path / "mesh.glb", force="mesh").bounds
    np.testing.assert_allclose(low, [0, 0, -0.02], atol=1e-9)
    np.testing.assert_allclose(high, [0.01, 0.03, 0], atol=1e-9)


def test_the_arrays_can_be_read_without_pickle(tetrahedron: ShapeModel, tmp_path: Path) -> None:
    export_model(tetrahedron, tmp_path)

    with np.load(tmp_path / "model.npz", allow_pickle=False) as found:
        arrays = dict(found)
    np.testing.assert_array_equal(arrays["vertices"], tetrahedron.vertices)
    np.testing.assert_array_equal(arrays["faces"], tetrahedron.faces)
    assert arrays["contours"].tolist() == [0, 1]
    assert arrays["probes"].tolist() == []
    assert arrays["dropped_why"].tolist() == ["too short"]
    health = dict(zip(arrays["health_names"], arrays["health_values"], strict=True))
    assert health == {"condition": 3.5, "fallbacks": 0.0}
    assert bool(arrays["final"]) is True
    names = {field.name for field in dataclasses.fields(ShapeModel)} - {"health", "archive"}
    assert names | {"health_names", "health_values"} == set(arrays)


def test_the_solid_itself_lies_beside_the_arrays(tetrahedron: ShapeModel, tmp_path: Path) -> None:
    turn = 2 * np.pi * np.arange(24) / 24
    rings = [np.column_stack([np.cos(turn), np.sin(turn), 0 * turn + z]) for z in range(5)]
    solid = palpate.reconstruct(rings, method="skin")
    sent = decode(ShapeModel, encode(dataclasses.replace(tetrahedron, archive=pack(solid))))
    export_model(sent, tmp_path)

    assert equal_trees(palpate.load(tmp_path / "model.npz"), solid)
    with np.load(tmp_path / "model.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["vertices"], tetrahedron.vertices)


def test_a_model_without_the_solid_itself_is_not_loaded(
    tetrahedron: ShapeModel, tmp_path: Path
) -> None:
    export_model(tetrahedron, tmp_path)

    with pytest.raises(InputError, match="holds no solid"):
        palpate.load(tmp_path / "model.npz")


def test_a_model_without_a_surface_leaves_no_mesh(tetrahedron: ShapeModel, tmp_path: Path) -> None:
    empty = dataclasses.replace(
        tetrahedron, vertices=np.zeros((0, 3)), faces=np.zeros((0, 3), np.int32)
    )

    assert export_model(empty, tmp_path) == ("model.npz",)
    assert [path.name for path in tmp_path.iterdir()] == ["model.npz"]


def test_the_fingerprint_sees_every_bit_of_the_surface(tetrahedron: ShapeModel) -> None:
    moved = tetrahedron.vertices.copy()
    moved[0, 0] = np.nextafter(moved[0, 0], 1.0)
    turned = tetrahedron.faces[::-1].copy()

    prints = {
        mesh_sha256(model)
        for model in (
            tetrahedron,
            dataclasses.replace(tetrahedron, vertices=moved),
            dataclasses.replace(tetrahedron, faces=turned),
        )
    }
    assert len(prints) == 3
    assert mesh_sha256(dataclasses.replace(tetrahedron, number=9)) in prints
