"""A solid of any genus from whatever was touched.

`rebuild_general` answers a `GeneralSolid`: topology from a coarse solution, then an implicit
spline over a narrow band of cells, whose control values are a lattice. Weights and sizes of
cells stand on top of `solid` and `topology`. It rests on core geometry and the contact points of
`palpate.core.rebuild.contours`.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.rebuild.general.prediction import FEW_FOLDS as FEW_FOLDS
    from palpate.core.rebuild.general.prediction import FOLDS as FOLDS
    from palpate.core.rebuild.general.prediction import touch_distances as touch_distances
    from palpate.core.rebuild.general.prediction import touch_squares as touch_squares
    from palpate.core.rebuild.general.rebuilding import fitting_cell as fitting_cell
    from palpate.core.rebuild.general.rebuilding import is_flat as is_flat
    from palpate.core.rebuild.general.rebuilding import rebuild_general as rebuild_general
    from palpate.core.rebuild.general.solid import FINE as FINE
    from palpate.core.rebuild.general.solid import GeneralSolid as GeneralSolid
else:
    __getattr__, __dir__ = lazy(__name__)
