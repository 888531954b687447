"""What the reconstructor node has received, and the solids and messages that it makes of it.

`fitting` says what belongs to a set and makes or continues its solids, `candidates` chooses between
them by how they predicted, and writes the message. To be tuned: how surely a general
solid must predict better, and after how many touches it is fitted anew. Rests on
`palpate.core.rebuild`; used by the reconstructor node, and by those who rebuild from files.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.nodes.rebuilding.candidates import QUALITIES, Candidates, Quality, coarse_model
    from palpate.nodes.rebuilding.candidates import is_final, shape_model
    from palpate.nodes.rebuilding.fitting import TOUCHED_OUTCOMES, Goal, State, common_frame
    from palpate.nodes.rebuilding.fitting import fitted_solids, is_coarse, is_complete, is_upright
    from palpate.nodes.rebuilding.fitting import known_space, published_solid, rebuild_set
    from palpate.nodes.rebuilding.fitting import spanned_by, touched_ends
else:
    __getattr__, __dir__ = lazy(__name__)
