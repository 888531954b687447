"""The mathematics of shapes and splines, measured: exactness, recoveries, and what they cost."""

from __future__ import annotations

from palpate.launch.bench_row import Group
from palpate.launch.bench_shapes_curves import curve_rows
from palpate.launch.bench_shapes_models import model_rows
from palpate.launch.bench_shapes_recovery import recovery_rows
from palpate.launch.bench_shapes_splines import spline_rows

GROUPS: tuple[Group, ...] = (recovery_rows, spline_rows, curve_rows, model_rows)
"""What ``palpate bench shapes`` measures."""
