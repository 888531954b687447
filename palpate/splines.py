"""B-splines, closed curves and free-form deformation: see docs/shapes.md and docs/lattice.md."""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.splines import Basis as Basis, Lattice as Lattice
    from palpate.core.splines import LatticeLayer as LatticeLayer, PeriodicBasis as PeriodicBasis
    from palpate.core.splines import box_lattice as box_lattice, clamped_basis as clamped_basis
    from palpate.core.splines import coons_patch as coons_patch, coons_surface as coons_surface
    from palpate.core.splines import fit_closed_curve as fit_closed_curve
    from palpate.core.splines import fold_report as fold_report, hermite_patch as hermite_patch
    from palpate.core.splines import insert_knots as insert_knots
    from palpate.core.splines import invert_points as invert_points
    from palpate.core.splines import layered_lattice as layered_lattice, pull_points as pull_points
else:
    __getattr__, __dir__ = lazy(__name__)
