"""A control lattice that deforms a prism into the side of an object, and its refinement.

Free-form deformation: Fung, 1999, 4.4. Sizes that are tried and the weights of what determines the
inside are fields of settings classes. The package uses volumes of `palpate.core.splines`, the side
that is followed, and a recovered superquadric as prior.
"""

from palpate.core.rebuild.lattice.fit import (
    LatticeFit as LatticeFit,
    LatticeGrid as LatticeGrid,
    LatticeSide as LatticeSide,
    fit_lattice as fit_lattice,
    lattice_grid as lattice_grid,
)
from palpate.core.rebuild.lattice.refinement import (
    refine_lattice as refine_lattice,
)
