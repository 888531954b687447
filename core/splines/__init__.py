"""Splines.

Bases and knots, closed curves through points, Coons patches, and free-form deformation by control
lattices.

What may be tuned are the choices of the closed curve (`curve_fits`: when to smooth, how many
control points) and how long a fold is looked for (`lattices`); bases, evaluation and inversion are
exact, and their constants are tolerances of that. It rests on numpy, scipy's sparse matrices and
dense factorisations, and `palpate.core.geometry` for one question about polygons.
"""

from palpate.core.splines.bases import (
    CUBIC,
    Basis,
    PeriodicBasis,
    averaged_knots,
    clamped_basis,
    evaluate_grid,
    evaluate_scattered,
    insert_knots,
    interpolate_grid,
    periodic_knots,
    wound_basis,
)
from palpate.core.splines.closed_curves import (
    FLAT_SPREAD,
    LEAST_POINTS,
    ClosedCurve,
    ClosedPoints,
    CurveFlags,
    closed_curve_of,
    fit_closed_curve,
    local_noise,
    order_closed_points,
)
from palpate.core.splines.coons import Slopes, coons_patch, coons_surface, hermite_patch
from palpate.core.splines.curve_fits import (
    LEAST_SMOOTHING,
    UNEVEN_GAP_RATIO,
    CurveFit,
    Modes,
    are_even_chords,
    choose_closed_fit,
    closed_curve_points,
    closed_knots,
    curve_parameters,
    demmler_reinsch,
    fit_closed_least_squares,
    gap_ratio,
    interpolate_closed,
)
from palpate.core.splines.inversion import (
    Inversion,
    affine_fit,
    invert_points,
    is_folded,
    least_residual,
)
from palpate.core.splines.lattices import (
    FoldReport,
    Lattice,
    LatticeLayer,
    box_lattice,
    fold_report,
    folded_share,
    layered_lattice,
    pull_points,
)
from palpate.core.splines.spline_volumes import (
    Bases,
    Parallelepiped,
    SplineVolume,
    upright_parallelepiped,
)
