"""Rebuilding from contours, measured: errors, how far the band can be trusted, and costs."""

from __future__ import annotations

from palpate.launch.bench_rebuild_band import band_rows
from palpate.launch.bench_rebuild_contours import contour_rows
from palpate.launch.bench_rebuild_felt import felt_rows
from palpate.launch.bench_rebuild_peers import peer_rows
from palpate.launch.bench_rebuild_thesis import thesis_rows
from palpate.launch.bench_rebuild_whole import whole_rows
from palpate.launch.bench_row import Group

GROUPS: tuple[Group, ...] = (
    *(peer_rows, contour_rows, felt_rows),
    *(whole_rows, band_rows, thesis_rows),
)
"""What ``palpate bench rebuild`` measures."""
