"""Splines.

Bases and knots, closed curves through points, Coons patches, and free-form deformation by control
lattices.

What may be tuned are the choices of the closed curve (`curve_fits`: when to smooth, how many
control points) and how long a fold is looked for (`lattices`); bases, evaluation and inversion are
exact, and their constants are tolerances of that. It rests on numpy, scipy's sparse matrices and
dense factorisations, and `palpate.core.geometry` for one question about polygons.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.splines.bases import CUBIC, Basis, PeriodicBasis, averaged_knots
    from palpate.core.splines.bases import clamped_basis, evaluate_grid, evaluate_scattered
    from palpate.core.splines.bases import insert_knots, interpolate_grid, periodic_knots
    from palpate.core.splines.bases import wound_basis
    from palpate.core.splines.closed_curves import FLAT_SPREAD, LEAST_POINTS, ClosedCurve
    from palpate.core.splines.closed_curves import ClosedPoints, CurveFlags, closed_curve_of
    from palpate.core.splines.closed_curves import fit_closed_curve, local_noise
    from palpate.core.splines.closed_curves import order_closed_points
    from palpate.core.splines.coons import Slopes, coons_patch, coons_surface, hermite_patch
    from palpate.core.splines.curve_fits import LEAST_SMOOTHING, are_even_chords
    from palpate.core.splines.curve_fits import UNEVEN_GAP_RATIO, CurveFit, Modes, choose_closed_fit
    from palpate.core.splines.curve_fits import closed_curve_points, closed_knots, curve_parameters
    from palpate.core.splines.curve_fits import demmler_reinsch, fit_closed_least_squares, gap_ratio
    from palpate.core.splines.curve_fits import interpolate_closed
    from palpate.core.splines.inversion import Inversion, affine_fit, invert_points, is_folded
    from palpate.core.splines.inversion import least_residual
    from palpate.core.splines.lattices import FoldReport, Lattice, LatticeLayer, box_lattice
    from palpate.core.splines.lattices import fold_report, folded_share, layered_lattice
    from palpate.core.splines.lattices import pull_points
    from palpate.core.splines.spline_volumes import Bases, Parallelepiped, SplineVolume
    from palpate.core.splines.spline_volumes import upright_parallelepiped
else:
    __getattr__, __dir__ = lazy(__name__)
