from __future__ import annotations

import sys
from types import ModuleType
from typing import ClassVar

import numpy as np
import pytest

from palpate.bench import objects
from palpate.bench.objects import REBUILT_SHAPES
from palpate.bench.rebuild import comparison
from palpate.bench.rebuild.comparison import (
    CASES,
    EXAMPLE_HEIGHT,
    EXAMPLE_NOISE,
    EXAMPLES,
    FIRST,
    NOISY_VARIANTS,
    OURS,
    SECOND,
    TOUCHED,
    VARIANTS,
    PeerCase,
    case_rows,
    errors_of,
    example_truth,
    loop_ratio,
    noisy_contours,
    ratio_of,
    shuffled,
    spline_loft,
    thesis_rows,
    with_noise,
    with_outliers,
)
from palpate.bench.rebuild.peers import (
    MeshErrors,
    Peer,
    loft,
    poisson_installed,
    poisson_surface,
    radial_functions,
    shell_and_core,
    smoothed_loft,
    truth_of,
)
from palpate.core.arrays import Floats
from palpate.core.geometry.meshes import solidity
from palpate.core.shapes.tessellations import icosphere


@pytest.fixture(autouse=True, scope="module")
def coarse_truth():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(objects, "TRUE_ROWS", 121)
        patch.setattr(objects, "TRUE_COLUMNS", 180)
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
    errors = {"vase": MeshErrors(0.1, 1.0, 4.0, -0.01)}
    rows = list(case_rows(case, {OURS: errors, "loft": errors}))
    missed = [row.name for row in rows if not row.holds]
    assert len(missed) == 2
    assert "mean over the loft's" in missed[0]
    assert "normals" in missed[1]


def test_the_demands_are_on_the_sizes_that_are_named():
    assert {case.size for case in CASES} == {(27, 81), (24, 41), (9, 24)}


def test_disorder_keeps_the_object_and_changes_everything_else():
    contours = contours_of("vase", (12, 40))
    mixed = shuffled(REBUILT_SHAPES["vase"], contours, np.random.default_rng(1))
    heights = [float(one[:, 2].mean()) for one in mixed]
    assert sorted(heights) == pytest.approx(contours[:, 0, 2], abs=0.3)
    assert heights != sorted(heights)
    assert len({len(one) for one in mixed}) > 3
    off = (
        np.array(with_outliers(REBUILT_SHAPES["vase"], contours, np.random.default_rng(1)))
        - contours
    )
    moved = np.linalg.norm(off, axis=-1)
    assert 0.005 < (moved > 0.0).mean() < 0.04
    assert moved[moved > 0.0] == pytest.approx(3.0)
    assert np.abs(off[..., 2]).max() == 0.0


def test_disorder_costs_nothing_on_one_object():
    assert ratio_of(shuffled, ONE) < 1.2


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


@pytest.fixture
def coarse(monkeypatch):
    """Truths and lofts coarse enough to be compared in no time."""
    sizes = {"TRUE": (121, 180), "FLOOR": (91, 131), "MESH": (61, 80)}
    for name, (rows, columns) in sizes.items():
        monkeypatch.setattr(comparison, f"{name}_ROWS", rows)
        monkeypatch.setattr(comparison, f"{name}_COLUMNS", columns)


def test_the_examples_have_as_many_contours_and_points_as_the_thesiss():
    assert [example.contours().shape for example in EXAMPLES] == [(27, 81, 3), (24, 41, 3)]
    for example in EXAMPLES:
        contours = example.contours()
        assert np.allclose(contours[:, 0], contours[:, -1], rtol=0, atol=1e-12)
        assert np.ptp(contours[:, 0, 2]) == EXAMPLE_HEIGHT
        assert solidity(*example.mesh(40, 60)).watertight
    assert np.ptp(np.diff(FIRST.heights)) < 1e-12
    assert np.ptp(np.diff(SECOND.heights)) > 0.1


@pytest.mark.usefixtures("coarse")
def test_what_the_page_says_of_the_ways_holds():
    truth, contours = example_truth(SECOND), SECOND.contours()
    errors = {
        way.name: truth.errors_of(way.build(contours)) for way in VARIANTS if "4.3" not in way.name
    }
    assert errors["spline loft"].chamfer < 0.1 * errors["corrected"].chamfer
    assert errors["7 x 7 layers"].chamfer < 0.7 * errors["corrected"].chamfer
    assert errors["corrected"].chamfer < 0.8 * errors["program"].chamfer
    assert errors["corrected"].chamfer <= 0.0045
    assert errors["program"].chamfer <= 0.005
    assert errors["ellipsoid"].volume < -0.1
    assert errors["program"].hausdorff > errors["program"].chamfer


@pytest.mark.usefixtures("coarse")
def test_a_row_for_each_way_says_what_it_missed(monkeypatch):
    ways = (VARIANTS[0], VARIANTS[2]._replace(most=1e-6))
    monkeypatch.setattr(comparison, "VARIANTS", ways)
    monkeypatch.setattr(comparison, "NOISY_VARIANTS", (NOISY_VARIANTS[0],))
    monkeypatch.setattr(comparison, "loop_ratio", lambda looped: float(looped))
    rows = list(thesis_rows(True))
    assert [row.name.split(";")[0] for row in rows] == [
        "example 1: floor",
        "example 1: spline loft",
        "example 1: corrected",
        "example 2: floor",
        "example 2: spline loft",
        "example 2: corrected",
        "example 1, noise: spline loft",
        "contours to mesh, against a loop",
    ]
    held = [row.holds for row in rows]
    assert held == [True, True, False, True, True, False, True, False]  # 40 loops a ratio of 40


def test_noise_keeps_contours_closed_and_level():
    contours = FIRST.contours()
    noisy = with_noise(contours)
    assert np.array_equal(noisy[:, 0], noisy[:, -1])
    assert np.array_equal(noisy[..., 2], contours[..., 2])
    spread = (noisy - contours)[:, :-1, :2].std()
    assert spread == pytest.approx(EXAMPLE_NOISE * EXAMPLE_HEIGHT, rel=0.05)


def test_a_loft_passes_the_contours():
    contours = FIRST.contours()
    mesh = spline_loft(contours)
    assert solidity(*mesh).watertight
    ends = mesh.vertices[1:241], mesh.vertices[-241:-1]
    assert np.allclose(ends[0][::3], contours[0, :-1], rtol=0, atol=1e-12)
    assert np.allclose(ends[1][::3], contours[-1, :-1], rtol=0, atol=1e-12)


def test_the_loop_over_points_is_timed():
    assert loop_ratio(2) > 0.0
