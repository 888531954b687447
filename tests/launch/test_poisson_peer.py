from __future__ import annotations

import sys
from types import ModuleType
from typing import ClassVar

import numpy as np
import pytest

from palpate.core.shapes.icosphere import icosphere
from palpate.launch.poisson_peer import poisson, poisson_installed


class Meshes:
    """Stands in for the package's set of meshes: its surface is a ball of the points' size."""

    depths: ClassVar[list[int]] = []

    def add_mesh(self, cloud: tuple[np.ndarray, np.ndarray]) -> None:
        points, normals = cloud
        assert points.shape == normals.shape
        self.radius = float(np.linalg.norm(points, axis=1).max())

    def generate_surface_reconstruction_screened_poisson(self, depth: int) -> None:
        self.depths.append(depth)

    def current_mesh(self) -> Meshes:
        return self

    def vertex_matrix(self) -> np.ndarray:
        return self.radius * icosphere(2)[0]

    def face_matrix(self) -> np.ndarray:
        return icosphere(2)[1]


@pytest.fixture
def package(monkeypatch: pytest.MonkeyPatch) -> None:
    fake = ModuleType("pymeshlab")
    fake.MeshSet = Meshes  # type: ignore[attr-defined]
    fake.Mesh = lambda vertex_matrix, v_normals_matrix: (  # type: ignore[attr-defined]
        vertex_matrix,
        v_normals_matrix,
    )
    monkeypatch.setitem(sys.modules, "pymeshlab", fake)


@pytest.mark.usefixtures("package")
def test_points_and_normals_go_in_and_a_mesh_comes_out() -> None:
    points = 3.0 * icosphere(3)[0].reshape(-1, 2, 3)

    mesh = poisson(points, points / 3.0)

    assert np.linalg.norm(mesh.vertices, axis=1) == pytest.approx(np.full(len(mesh.vertices), 3.0))
    assert mesh.faces.dtype == np.int32
    assert Meshes.depths == [8]


def test_without_the_package_it_is_said_to_be_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)

    assert not poisson_installed()
