from __future__ import annotations

import numpy as np
import pytest

from palpate.bench.rebuild import thesis as thesis_examples
from palpate.bench.rebuild.thesis import (
    EXAMPLE_HEIGHT,
    EXAMPLE_NOISE,
    EXAMPLES,
    FIRST,
    NOISY_VARIANTS,
    SECOND,
    VARIANTS,
    example_truth,
    loop_ratio,
    spline_loft,
    thesis_rows,
    with_noise,
)
from palpate.core.geometry.meshes import solidity


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Truths and lofts coarse enough to be compared in no time."""
    sizes = {"TRUE": (121, 180), "FLOOR": (91, 131), "MESH": (61, 80)}
    for name, (rows, columns) in sizes.items():
        monkeypatch.setattr(thesis_examples, f"{name}_ROWS", rows)
        monkeypatch.setattr(thesis_examples, f"{name}_COLUMNS", columns)


def test_the_examples_have_as_many_contours_and_points_as_the_thesiss() -> None:
    assert [example.contours().shape for example in EXAMPLES] == [(27, 81, 3), (24, 41, 3)]
    for example in EXAMPLES:
        contours = example.contours()
        assert np.allclose(contours[:, 0], contours[:, -1], rtol=0, atol=1e-12)
        assert np.ptp(contours[:, 0, 2]) == EXAMPLE_HEIGHT
        assert solidity(*example.mesh(40, 60)).watertight
    assert np.ptp(np.diff(FIRST.heights)) < 1e-12
    assert np.ptp(np.diff(SECOND.heights)) > 0.1


@pytest.mark.usefixtures("coarse")
def test_what_the_page_says_of_the_ways_holds() -> None:
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
def test_a_row_for_each_way_says_what_it_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    ways = (VARIANTS[0], VARIANTS[2]._replace(most=1e-6))
    monkeypatch.setattr(thesis_examples, "VARIANTS", ways)
    monkeypatch.setattr(thesis_examples, "NOISY_VARIANTS", (NOISY_VARIANTS[0],))
    monkeypatch.setattr(thesis_examples, "loop_ratio", lambda looped: float(looped))
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


def test_noise_keeps_contours_closed_and_level() -> None:
    contours = FIRST.contours()
    noisy = with_noise(contours)
    assert np.array_equal(noisy[:, 0], noisy[:, -1])
    assert np.array_equal(noisy[..., 2], contours[..., 2])
    spread = (noisy - contours)[:, :-1, :2].std()
    assert spread == pytest.approx(EXAMPLE_NOISE * EXAMPLE_HEIGHT, rel=0.05)


def test_a_loft_passes_the_contours() -> None:
    contours = FIRST.contours()
    mesh = spline_loft(contours)
    assert solidity(*mesh).watertight
    ends = mesh.vertices[1:241], mesh.vertices[-241:-1]
    assert np.allclose(ends[0][::3], contours[0, :-1], rtol=0, atol=1e-12)
    assert np.allclose(ends[1][::3], contours[-1, :-1], rtol=0, atol=1e-12)


def test_the_loop_over_points_is_timed() -> None:
    assert loop_ratio(2) > 0.0
