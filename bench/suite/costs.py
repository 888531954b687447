"""What single calls cost: casts, filters, jets, deformation, inversion, recovery, one solid.

Measured with pytest-benchmark: ``./go test bench/suite/costs.py``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from palpate.bench.shapes import BOTH, OUTLIERS, RIGID, RecoveryKind, draw_trial
from palpate.core import Floats, pad_rotation, pose_of, split_pose
from palpate.core.geometry import compare_surfaces, prepare_surface
from palpate.core.rebuild import reconstruct
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.recovery import Warps, distances_alone, normal_distances, recover
from palpate.core.rebuild.surface import SurfaceMesh
from palpate.core.shapes import (
    Bend,
    DeformedShape,
    DeformedSuperquadric,
    Shape,
    Superquadric,
    TriangleShape,
)
from palpate.core.splines import (
    LatticeLayer,
    box_lattice,
    clamped_basis,
    fold_report,
    invert_points,
    layered_lattice,
)
from palpate.core.touch import (
    Pad,
    adaptive_wiener,
    fit_jet,
    fit_patch,
    fit_robust_jet,
    guarded_move,
    jet_design,
    median_filter,
    median_then_wiener,
    remove_impulses,
)

DOMED_PAD = Pad(rows=16, cols=16, pitch=0.001, thickness=0.003, dome=1 / 0.015, saturation=0.8)
START = pose_of(np.array([0.1, 0.0, 0.01]), pad_rotation(0.0, 0.2))
BALL = Superquadric(np.full(3, 0.04), np.ones(2))
SOLID = Superquadric(np.array([0.04, 0.03, 0.05]), np.array([0.4, 0.7]))
TAPERED = DeformedSuperquadric(SOLID, np.array([0.3, 0.3]))
BENT_SOLID = DeformedSuperquadric(SOLID, np.array([0.3, 0.1]), Bend(5.0, 0.5))
LATTICE = layered_lattice(
    SOLID.bounds(), [LatticeLayer(0.8), LatticeLayer(1.2, 0.2), LatticeLayer(), LatticeLayer(0.9)]
)
CAST_SHAPES: dict[str, Shape] = {
    "ball": BALL,
    "superquadric": SOLID,
    "tapered": TAPERED,
    "tapered and bent": BENT_SOLID,
    "lattice, facets": DeformedShape(SOLID, LATTICE),
    "lattice, exact": DeformedShape(SOLID, LATTICE, exact=True),
    "mesh of 20k faces": TriangleShape(*SOLID.mesh(5)),
    "mesh of 80k faces": TriangleShape(*SOLID.mesh(6)),
    "mesh of 5k faces, z-buffer": TriangleShape(*SOLID.mesh(4), embree=False),
    "mesh of 20k faces, z-buffer": TriangleShape(*SOLID.mesh(5), embree=False),
}
PAD = Pad(rows=16, cols=16, pitch=0.001, thickness=0.003, dome=0.0, saturation=0.8)
X, Y = PAD.grid()
NOISE = 10e-6
RNG = np.random.default_rng(0)
HEIGHT = 0.5 * (X**2 + Y**2) / 0.04 + NOISE * RNG.normal(size=X.shape)
IMAGE = 2.2e-3 - HEIGHT
IMPULSE_IMAGE = np.where(RNG.random(X.shape) < 0.08, 2.4e-3, IMAGE)
EDGE_HEIGHT = 0.5 * np.abs(X + 0.2 * Y) + NOISE * RNG.normal(size=X.shape)
ALL = np.ones((16, 16), bool)
PART = np.hypot(X, Y) < 6e-3
ACROSS = np.array([0.0, 1.0, 0.0])
POINTS = np.random.default_rng(0).random((10_000, 3))
PLAIN_LATTICE = box_lattice(np.zeros(3), np.ones(3), (7, 7, 9))
CONTROL_NOISE = 0.02 * np.random.default_rng(1).normal(size=PLAIN_LATTICE.control.shape)
BENT_LATTICE = PLAIN_LATTICE.with_control(PLAIN_LATTICE.control + CONTROL_NOISE)
KINDS = {"rigid": RIGID, "outliers": OUTLIERS, "tapered and bent": BOTH}
RADIUS = 0.04


@pytest.mark.parametrize("name", CAST_SHAPES)
def bench_cast(benchmark: Any, name: str) -> None:
    """256 rays."""
    _, axes = split_pose(START)
    origins = DOMED_PAD.transducers() @ axes.T + START[:3]
    assert np.isfinite(benchmark(CAST_SHAPES[name].cast, origins, axes[:, 2], 0.104)).any()


@pytest.mark.parametrize("name", CAST_SHAPES)
def bench_press(benchmark: Any, name: str) -> None:
    assert benchmark(guarded_move, CAST_SHAPES[name], DOMED_PAD, START, 0.1, 0.001).outcome == "hit"


def bench_filters(benchmark: Any) -> None:
    image = guarded_move(BALL, DOMED_PAD, START, 0.1, 0.001).compression
    benchmark(median_then_wiener, image, 1e-10)


def bench_curvature(benchmark: Any) -> None:
    compression = guarded_move(BALL, DOMED_PAD, START, 0.1, 0.001).compression
    touched = compression > 5e-5
    surface = np.where(touched, -(compression + DOMED_PAD.sag()), 0.0)
    across = np.array([0.0, 1.0, 0.0])
    assert benchmark(fit_patch, DOMED_PAD, surface, touched, across, 0.0).kind == "smooth"


def bench_robust_clean_of_a_clean_frame(benchmark: Any) -> None:
    assert not benchmark(remove_impulses, PAD, IMAGE, 5e-5, NOISE).impulses.any()


def bench_robust_clean_of_a_frame_with_impulses(benchmark: Any) -> None:
    assert benchmark(remove_impulses, PAD, IMPULSE_IMAGE, 5e-5, NOISE).impulses.any()


def bench_wiener(benchmark: Any) -> None:
    benchmark(adaptive_wiener, IMAGE, NOISE**2)


def bench_median(benchmark: Any) -> None:
    benchmark(median_filter, IMAGE)


def bench_jet_of_a_full_pad(benchmark: Any) -> None:
    assert benchmark(fit_jet, PAD, HEIGHT, ALL).derivatives.shape == (5,)


def bench_jet_of_a_contact_not_met_before(benchmark: Any) -> None:
    def fresh() -> None:
        jet_design.cache_clear()
        fit_jet(PAD, HEIGHT, PART)

    benchmark(fresh)


def bench_robust_jet(benchmark: Any) -> None:
    assert benchmark(fit_robust_jet, PAD, HEIGHT, ALL, NOISE) is not None


def bench_patch_of_a_full_pad(benchmark: Any) -> None:
    assert benchmark(fit_patch, PAD, HEIGHT, ALL, ACROSS, NOISE).kind == "smooth"


def bench_patch_of_a_contact_not_met_before(benchmark: Any) -> None:
    def fresh() -> str:
        jet_design.cache_clear()
        return fit_patch(PAD, HEIGHT, PART, ACROSS, NOISE).kind

    assert benchmark(fresh) == "smooth"


def bench_patch_of_an_edge(benchmark: Any) -> None:
    assert benchmark(fit_patch, PAD, EDGE_HEIGHT, ALL, ACROSS, NOISE).kind == "edge"


def bench_basis(benchmark: Any) -> None:
    assert benchmark(clamped_basis(27).nonzero, POINTS[:, 0], 1).values.shape == (2, 10_000, 4)


@pytest.mark.parametrize("count", [200, 10_000])
def bench_deform(benchmark: Any, count: int) -> None:
    assert len(benchmark(BENT_LATTICE.deform, POINTS[:count])) == count


@pytest.mark.parametrize("count", [200, 10_000])
def bench_deform_with_jacobian(benchmark: Any, count: int) -> None:
    assert len(benchmark(BENT_LATTICE.deform_with_jacobian, POINTS[:count])[1]) == count


@pytest.mark.parametrize("method", ["auto", "thesis"])
def bench_invert(benchmark: Any, method: Any) -> None:
    moved = BENT_LATTICE.deform(POINTS)
    assert benchmark(invert_points, BENT_LATTICE.volume, moved, method=method).converged.all()


def bench_folds(benchmark: Any) -> None:
    assert benchmark(fold_report, BENT_LATTICE).verdict == "sound"


@pytest.mark.parametrize("name", KINDS)
def bench_recovery(benchmark: Any, name: str) -> None:
    kind: RecoveryKind = KINDS[name]
    points = draw_trial(kind, np.random.default_rng(0)).points
    options = {"taper": kind.taper, "bend": kind.bend, "outliers": kind.outliers > 0.0}
    assert benchmark(recover, points, **options).fitted


def bench_distances(benchmark: Any) -> None:
    assert np.isfinite(benchmark(distances_alone, *solids())).all()


def bench_distances_and_jacobian(benchmark: Any) -> None:
    assert np.isfinite(benchmark(normal_distances, *solids())[1]).all()


def solids() -> tuple[Floats, Floats, Floats, Warps]:
    """Six solids with all 15 parameters, and 60 points."""
    rng, warps = np.random.default_rng(0), Warps(taper=True, bend=True)
    parameters = rng.uniform(-0.3, 0.3, (6, warps.total))
    parameters[:, 3:5] = rng.uniform(0.3, 1.7, (6, 2))
    return parameters, rng.normal(size=(60, 3)), np.broadcast_to(np.eye(3), (6, 3, 3)), warps


def bench_rebuild(benchmark: Any) -> None:
    assert len(benchmark(rebuilt).faces) > 10_000


def bench_compare(benchmark: Any) -> None:
    solid = rebuilt()
    truth = prepare_surface(*Superquadric(np.full(3, RADIUS), np.ones(2)).mesh(6))
    shifted = solid.vertices - [0.0, 0.0, RADIUS]
    found = benchmark(lambda: compare_surfaces(truth, prepare_surface(shifted, solid.faces)))
    # The facets stand off by the tolerance.
    assert found.chamfer < 2e-4 * RADIUS


def rebuilt() -> SurfaceMesh:
    """The ball, as a mesh."""
    contours, felt, tops = ball()
    return reconstruct(contours, patches=felt, tops=tops, method="skin").mesh(2e-5)


def ball() -> tuple[list[Floats], ContactPoints, Floats]:
    """Nine contours of a ball, what the pad feels around them, and touches of both ends."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(20_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    centre = np.array([0.0, 0.0, RADIUS])
    contours = []
    for height in np.linspace(0.06, 1.94, 9) * RADIUS:
        rise = height / RADIUS - 1.0
        turn = 2 * np.pi * np.arange(150) / 150
        level = np.sqrt(1.0 - rise**2)
        rim = np.column_stack([level * np.cos(turn), level * np.sin(turn), np.full(150, rise)])
        contours.append(centre + RADIUS * rim)
    touch = np.repeat(np.arange(200, dtype=np.int32), 100)
    felt = ContactPoints(centre + RADIUS * normals, normals, touch)
    return contours, felt, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0 * RADIUS]])
