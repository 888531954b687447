from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.measure.solidity import solidity
from palpate.launch.bench_rebuild_peers import (
    CASES,
    OURS,
    TOUCHED,
    Case,
    case_rows,
    errors_of,
    felt_contours,
)
from palpate.launch.bench_rebuild_whole import ratio_of, shuffled, strayed
from palpate.launch.mesh_truth import Errors
from palpate.launch.rebuild_peers import (
    Peer,
    loft,
    radial_functions,
    shell_and_core,
    smoothed_loft,
)
from palpate.launch.rebuild_shapes import SHAPES, truth_of

ONE = {"vase": SHAPES["vase"]}
PEERS = [loft, smoothed_loft, radial_functions, shell_and_core]
SEED = 0


def contours_of(name: str, size: tuple[int, int], noise: float = 0.0) -> Floats:
    return felt_contours(SHAPES[name], size, noise, np.random.default_rng(SEED))


@pytest.mark.parametrize("build", PEERS, ids=[one.__name__ for one in PEERS])
def test_a_peer_makes_a_closed_mesh_near_the_object(build: Peer) -> None:
    mesh = build(contours_of("vase", (12, 32)))  # type: ignore[operator]
    found = solidity(mesh.vertices, mesh.faces)
    assert (found.watertight, found.genus) == (True, 0)
    assert truth_of("vase").errors_of(mesh).chamfer < 1.5


def test_smoothing_helps_a_loft_among_noise() -> None:
    contours = contours_of("vase", (12, 81), 0.5)
    plain, smooth = (truth_of("vase").errors_of(build(contours)) for build in (loft, smoothed_loft))
    assert smooth.chamfer < 0.95 * plain.chamfer
    assert smooth.normal_deg < plain.normal_deg


def test_palpate_is_compared_on_the_same_contours_with_and_without_touched_ends() -> None:
    case = Case((12, 32), 0.0, (Peer("loft", loft),), 0.85, 0.45, 3.0)
    found = errors_of(case, ONE, 1)
    assert set(found) == {OURS, TOUCHED, "loft"}
    assert found[OURS]["vase"].chamfer < found["loft"]["vase"].chamfer
    rows = list(case_rows(case, found))
    assert len({row.name for row in rows}) == len(rows)
    assert all(row.holds for row in rows)


def test_a_way_that_is_no_better_misses_its_demand() -> None:
    case = Case((12, 32), 0.0, (Peer("loft", loft),), 0.85, 0.0, 3.0)
    errors = {"vase": Errors(0.1, 1.0, 4.0, -0.01)}
    rows = list(case_rows(case, {OURS: errors, "loft": errors}))
    missed = [row.name for row in rows if not row.holds]
    assert len(missed) == 2
    assert "mean over the loft's" in missed[0]
    assert "normals" in missed[1]


def test_the_demands_are_on_the_sizes_that_are_named() -> None:
    assert {case.size for case in CASES} == {(27, 81), (24, 41), (9, 24)}


def test_disorder_keeps_the_object_and_changes_everything_else() -> None:
    contours = contours_of("vase", (12, 40))
    mixed = shuffled(SHAPES["vase"], contours, np.random.default_rng(1))
    heights = [float(one[:, 2].mean()) for one in mixed]
    assert sorted(heights) == pytest.approx(contours[:, 0, 2], abs=0.3)
    assert heights != sorted(heights)
    assert len({len(one) for one in mixed}) > 3
    off = np.array(strayed(SHAPES["vase"], contours, np.random.default_rng(1))) - contours
    moved = np.linalg.norm(off, axis=-1)
    assert 0.005 < (moved > 0.0).mean() < 0.04
    assert moved[moved > 0.0] == pytest.approx(3.0)
    assert np.abs(off[..., 2]).max() == 0.0


def test_disorder_costs_nothing_on_one_object() -> None:
    assert ratio_of(shuffled, ONE) < 1.2
