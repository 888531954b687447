from __future__ import annotations

from palpate.launch.bench_rebuild_contours import NARROW, WIDE, starts, step_swing, strays


def test_contours_begun_anywhere_cost_little() -> None:
    assert 0.7 < starts((9, 24), 1) < 1.3


def test_points_that_stray_cost_little() -> None:
    assert 0.9 < strays((9, 24), 1) < 1.3


def test_a_step_keeps_its_radii() -> None:
    assert 0.0 <= step_swing(0) < 0.05 < NARROW / WIDE
