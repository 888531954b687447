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
    from palpate.core.splines.bases import CUBIC as CUBIC
    from palpate.core.splines.bases import Basis as Basis
    from palpate.core.splines.bases import PeriodicBasis as PeriodicBasis
    from palpate.core.splines.bases import averaged_knots as averaged_knots
    from palpate.core.splines.bases import clamped_basis as clamped_basis
    from palpate.core.splines.bases import evaluate_grid as evaluate_grid
    from palpate.core.splines.bases import evaluate_scattered as evaluate_scattered
    from palpate.core.splines.bases import insert_knots as insert_knots
    from palpate.core.splines.bases import interpolate_grid as interpolate_grid
    from palpate.core.splines.bases import periodic_knots as periodic_knots
    from palpate.core.splines.bases import wound_basis as wound_basis
    from palpate.core.splines.closed_curves import FLAT_SPREAD as FLAT_SPREAD
    from palpate.core.splines.closed_curves import LEAST_POINTS as LEAST_POINTS
    from palpate.core.splines.closed_curves import ClosedCurve as ClosedCurve
    from palpate.core.splines.closed_curves import ClosedPoints as ClosedPoints
    from palpate.core.splines.closed_curves import CurveFlags as CurveFlags
    from palpate.core.splines.closed_curves import closed_curve_of as closed_curve_of
    from palpate.core.splines.closed_curves import fit_closed_curve as fit_closed_curve
    from palpate.core.splines.closed_curves import local_noise as local_noise
    from palpate.core.splines.closed_curves import order_closed_points as order_closed_points
    from palpate.core.splines.coons import Slopes as Slopes
    from palpate.core.splines.coons import coons_patch as coons_patch
    from palpate.core.splines.coons import coons_surface as coons_surface
    from palpate.core.splines.coons import hermite_patch as hermite_patch
    from palpate.core.splines.curve_fits import EVEN_GAP as EVEN_GAP
    from palpate.core.splines.curve_fits import EVEN_MIDDLE as EVEN_MIDDLE
    from palpate.core.splines.curve_fits import LEAST_SMOOTHING as LEAST_SMOOTHING
    from palpate.core.splines.curve_fits import UNEVEN_GAP_RATIO as UNEVEN_GAP_RATIO
    from palpate.core.splines.curve_fits import CurveFit as CurveFit
    from palpate.core.splines.curve_fits import Modes as Modes
    from palpate.core.splines.curve_fits import choose_closed_fit as choose_closed_fit
    from palpate.core.splines.curve_fits import closed_curve_points as closed_curve_points
    from palpate.core.splines.curve_fits import closed_knots as closed_knots
    from palpate.core.splines.curve_fits import curve_parameters as curve_parameters
    from palpate.core.splines.curve_fits import demmler_reinsch as demmler_reinsch
    from palpate.core.splines.curve_fits import fit_closed_least_squares as fit_closed_least_squares
    from palpate.core.splines.curve_fits import gap_ratio as gap_ratio
    from palpate.core.splines.curve_fits import interpolate_closed as interpolate_closed
    from palpate.core.splines.inversion import Inversion as Inversion
    from palpate.core.splines.inversion import affine_fit as affine_fit
    from palpate.core.splines.inversion import invert_points as invert_points
    from palpate.core.splines.inversion import is_folded as is_folded
    from palpate.core.splines.inversion import least_residual as least_residual
    from palpate.core.splines.lattices import FoldReport as FoldReport
    from palpate.core.splines.lattices import Lattice as Lattice
    from palpate.core.splines.lattices import LatticeLayer as LatticeLayer
    from palpate.core.splines.lattices import box_lattice as box_lattice
    from palpate.core.splines.lattices import fold_report as fold_report
    from palpate.core.splines.lattices import folded_share as folded_share
    from palpate.core.splines.lattices import layered_lattice as layered_lattice
    from palpate.core.splines.lattices import pull_points as pull_points
    from palpate.core.splines.spline_volumes import Bases as Bases
    from palpate.core.splines.spline_volumes import Parallelepiped as Parallelepiped
    from palpate.core.splines.spline_volumes import SplineVolume as SplineVolume
    from palpate.core.splines.spline_volumes import upright_parallelepiped as upright_parallelepiped
else:
    __getattr__, __dir__ = lazy(__name__)
