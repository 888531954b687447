"""Splines.

Bases and knots, closed curves through points, Coons patches, and free-form deformation by control
lattices.

Tunable are the choices of the closed curve (`curve_fits`: when to smooth, how many control points)
and the search for folds (`lattices`); bases, evaluation and inversion are exact up to tolerances.
It depends on numpy, scipy's sparse matrices and dense factorisations, and `palpate.core.geometry`
for the self-intersection of polygons.
"""

from palpate.core.splines.bases import (
    CUBIC as CUBIC,
    Basis as Basis,
    PeriodicBasis as PeriodicBasis,
    averaged_knots as averaged_knots,
    bending_along as bending_along,
    bending_around as bending_around,
    clamped_basis as clamped_basis,
    evaluate_grid as evaluate_grid,
    evaluate_scattered as evaluate_scattered,
    insert_knots as insert_knots,
    interpolate_grid as interpolate_grid,
    periodic_knots as periodic_knots,
    wound_basis as wound_basis,
)
from palpate.core.splines.closed_curves import (
    DEFAULT_CLOSED_CURVE as DEFAULT_CLOSED_CURVE,
    ClosedCurve as ClosedCurve,
    ClosedCurveSettings as ClosedCurveSettings,
    CurveFlags as CurveFlags,
    closed_curve_of as closed_curve_of,
    fit_closed_curve as fit_closed_curve,
    local_noise as local_noise,
)
from palpate.core.splines.coons import (
    Slopes as Slopes,
    coons_patch as coons_patch,
    coons_surface as coons_surface,
    hermite_patch as hermite_patch,
)
from palpate.core.splines.curve_fits import (
    DEFAULT_CURVE_FIT as DEFAULT_CURVE_FIT,
    ChordSettings as ChordSettings,
    ClosedPoints as ClosedPoints,
    CurveFit as CurveFit,
    CurveFitSettings as CurveFitSettings,
    Modes as Modes,
    are_even_chords as are_even_chords,
    choose_closed_fit as choose_closed_fit,
    closed_curve_points as closed_curve_points,
    closed_knots as closed_knots,
    curve_parameters as curve_parameters,
    demmler_reinsch as demmler_reinsch,
    fit_closed_least_squares as fit_closed_least_squares,
    gap_ratio as gap_ratio,
    interpolate_closed as interpolate_closed,
    order_closed_points as order_closed_points,
)
from palpate.core.splines.inversion import (
    Inversion as Inversion,
    affine_fit as affine_fit,
    invert_points as invert_points,
    is_folded as is_folded,
    least_residual as least_residual,
)
from palpate.core.splines.lattices import (
    FoldReport as FoldReport,
    Lattice as Lattice,
    LatticeLayer as LatticeLayer,
    box_lattice as box_lattice,
    fold_report as fold_report,
    folded_share as folded_share,
    layered_lattice as layered_lattice,
    pull_points as pull_points,
)
from palpate.core.splines.spline_volumes import (
    Bases as Bases,
    Parallelepiped as Parallelepiped,
    SplineVolume as SplineVolume,
    upright_parallelepiped as upright_parallelepiped,
)
