"""B-splines, closed curves and free-form deformation: see docs/shapes.md and docs/lattice.md."""

from palpate.core.splines import (
    Basis as Basis,
    Lattice as Lattice,
    LatticeLayer as LatticeLayer,
    PeriodicBasis as PeriodicBasis,
    box_lattice as box_lattice,
    clamped_basis as clamped_basis,
    coons_patch as coons_patch,
    coons_surface as coons_surface,
    fit_closed_curve as fit_closed_curve,
    fold_report as fold_report,
    hermite_patch as hermite_patch,
    insert_knots as insert_knots,
    invert_points as invert_points,
    layered_lattice as layered_lattice,
    pull_points as pull_points,
)
