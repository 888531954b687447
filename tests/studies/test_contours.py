from __future__ import annotations

import sys
from types import ModuleType
from typing import ClassVar

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.geometry.meshes import solidity
from palpate.core.shapes.tessellations import icosphere
from tests.studies import rebuilt
from tests.studies.accuracy.methods import poisson_installed, poisson_surface
from tests.studies.contours import (
    CASES,
    OURS,
    TOUCHED,
    PeerCase,
    case_rows,
    errors_of,
    noisy_contours,
)
from tests.studies.peers import (
    Peer,
    loft,
    radial_functions,
    shell_and_core,
    smoothed_loft,
)
from tests.studies.rebuilt import REBUILT_SHAPES, MeshErrors, truth_of


@pytest.fixture(autouse=True, scope="module")
def coarse_truth():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rebuilt, "TRUE_ROWS", 121)
        patch.setattr(rebuilt, "TRUE_COLUMNS", 180)
        truth_of.cache_clear()
        yield
    truth_of.cache_clear()


ONE = {"vase": REBUILT_SHAPES["vase"]}
PEERS = [loft, smoothed_loft, radial_functions, shell_and_core]
SEED = 0


def contours_of(name: str, size: tuple[int, int], noise: float = 0.0) -> Floats:
    return noisy_contours(REBUILT_SHAPES[name], size, noise, np.random.default_rng(SEED))


def test_a_mesh_is_not_off_from_itself_and_a_moved_one_is():
    truth, mesh = truth_of("vase"), REBUILT_SHAPES["vase"].true_mesh()
    same = truth.errors_of(mesh)
    assert same.chamfer < 1e-9
    assert abs(same.volume) < 1e-12
    moved = truth.errors_of(mesh._replace(vertices=mesh.vertices + [0.3, 0.0, 0.0]))
    assert 0.1 < moved.chamfer < 0.3
    assert moved.hausdorff <= 0.3 + 1e-9


@pytest.mark.parametrize("build", PEERS, ids=[one.__name__ for one in PEERS])
def test_a_peer_makes_a_closed_mesh_near_the_object(build):
    mesh = build(contours_of("vase", (12, 32)))
    found = solidity(mesh.vertices, mesh.faces)
    assert (found.watertight, found.genus) == (True, 0)
    assert truth_of("vase").errors_of(mesh).chamfer < 1.5


def test_smoothing_helps_a_loft_among_noise():
    contours = contours_of("vase", (12, 81), 0.5)
    plain, smooth = (truth_of("vase").errors_of(build(contours)) for build in (loft, smoothed_loft))
    assert smooth.chamfer < 0.95 * plain.chamfer
    assert smooth.normal_deg < plain.normal_deg


def test_palpate_is_compared_on_the_same_contours_with_and_without_touched_ends():
    case = PeerCase((12, 32), 0.0, (Peer("loft", loft),), 0.85, 0.45, 3.0)
    found = errors_of(case, ONE, 1)
    assert set(found) == {OURS, TOUCHED, "loft"}
    assert found[OURS]["vase"].chamfer < found["loft"]["vase"].chamfer
    rows = list(case_rows(case, found))
    assert len({row.name for row in rows}) == len(rows)
    assert all(row.holds for row in rows)


def test_a_way_that_is_no_better_misses_its_demand():
    case = PeerCase((12, 32), 0.0, (Peer("loft", loft),), 0.85, 0.0, 3.0)
    errors = {"vase": MeshErrors(0.1, 0.2, 1.0, 4.0, -0.01)}
    rows = list(case_rows(case, {OURS: errors, "loft": errors}))
    missed = [row.name for row in rows if not row.holds]
    assert len(missed) == 2
    assert "mean over the loft's" in missed[0]
    assert "normals" in missed[1]


def test_the_demands_are_on_the_sizes_that_are_named():
    assert {case.size for case in CASES} == {(27, 81), (24, 41), (9, 24)}


class Meshes:
    """Stands in for the package's set of meshes: its surface is a ball of the points' size."""

    depths: ClassVar[list[int]] = []

    def add_mesh(self, cloud: tuple[np.ndarray, np.ndarray]) -> None:
        points, normals = cloud
        assert points.shape == normals.shape
        self.radius = float(np.linalg.norm(points, axis=1).max())

    def generate_surface_reconstruction_screened_poisson(self, depth: int, threads: int) -> None:
        assert threads == 1  # else its triangles differ from run to run
        self.depths.append(depth)

    def current_mesh(self) -> Meshes:
        return self

    def vertex_matrix(self) -> np.ndarray:
        return self.radius * icosphere(2)[0]

    def face_matrix(self) -> np.ndarray:
        return icosphere(2)[1]


@pytest.fixture
def package(monkeypatch):
    fake = ModuleType("pymeshlab")
    fake.MeshSet = Meshes
    fake.Mesh = lambda vertex_matrix, v_normals_matrix: (
        vertex_matrix,
        v_normals_matrix,
    )
    monkeypatch.setitem(sys.modules, "pymeshlab", fake)


@pytest.mark.usefixtures("package")
def test_points_and_normals_go_in_and_a_mesh_comes_out():
    points = 3.0 * icosphere(3)[0].reshape(-1, 2, 3)
    mesh = poisson_surface(points, points / 3.0)
    assert np.linalg.norm(mesh.vertices, axis=1) == pytest.approx(np.full(len(mesh.vertices), 3.0))
    assert mesh.faces.dtype == np.int32
    assert Meshes.depths == [8]


def test_without_the_package_it_is_reported_to_be_missing(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert not poisson_installed()
