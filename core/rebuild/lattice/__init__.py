"""A control lattice around an undeformed prism that becomes the side, and its refinement.

Free-form deformation: Fung, 1999, 4.4.

The sides that are tried and the strengths of what settles the inside may be tuned; the systems
follow their formulas. It rests on volumes of `palpate.core.splines`, on the side that it follows,
and on a recovered superquadric as prior.
"""

from palpate.core.rebuild.lattice.fit import (
    LatticeFit as LatticeFit,
    LatticeGrid as LatticeGrid,
    LatticeSide as LatticeSide,
    fit_lattice as fit_lattice,
    lattice_grid as lattice_grid,
    refine_lattice as refine_lattice,
)
