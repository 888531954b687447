"""The thesis's own formulas, kept for comparison: see docs/thesis.md."""

from palpate.core.thesis import (
    fit_bspline as fit_bspline,
    fit_closed_curve_thesis as fit_closed_curve_thesis,
    invert_thesis as invert_thesis,
    rebuild_thesis as rebuild_thesis,
    solve_control_points as solve_control_points,
)
