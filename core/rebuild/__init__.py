"""From contacts to a closed solid.

`reconstruct` takes contours, normals and contact points and answers a `Solid`, exact at every
place. What may be tuned are the named thresholds on top of each chapter (shares of a size,
standard deviations, counts); each method in `reconstruction` may be replaced alone. It rests on
the rooms below (contours, side, ends, surface, lattice, recovery) and on
`palpate.core.thesis`.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.rebuild.general import GeneralSolid as GeneralSolid
    from palpate.core.rebuild.general import rebuild_general as rebuild_general
    from palpate.core.rebuild.reconstruction import fit_coarse as fit_coarse
    from palpate.core.rebuild.reconstruction import reconstruct as reconstruct
    from palpate.core.rebuild.solid import Method as Method
    from palpate.core.rebuild.solid import Solid as Solid
else:
    __getattr__, __dir__ = lazy(__name__)
