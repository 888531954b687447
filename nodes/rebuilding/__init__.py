"""What the reconstructor node has received, and the solids and messages that it makes of it.

`evidence` says what belongs to a set, `fitting` makes or continues its solids, `candidates` chooses
between them by how they predicted, `model` writes the message. To be tuned: how surely a general
solid must predict better, and after how many touches it is fitted anew. Rests on
`palpate.core.rebuild`; used by the reconstructor node, and by those who rebuild from files.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.nodes.rebuilding.candidates import QUALITIES as QUALITIES
    from palpate.nodes.rebuilding.candidates import Candidates as Candidates
    from palpate.nodes.rebuilding.candidates import Quality as Quality
    from palpate.nodes.rebuilding.evidence import TOUCHED_OUTCOMES as TOUCHED_OUTCOMES
    from palpate.nodes.rebuilding.evidence import Goal as Goal
    from palpate.nodes.rebuilding.evidence import State as State
    from palpate.nodes.rebuilding.evidence import common_frame as common_frame
    from palpate.nodes.rebuilding.evidence import is_coarse as is_coarse
    from palpate.nodes.rebuilding.evidence import is_complete as is_complete
    from palpate.nodes.rebuilding.evidence import is_upright as is_upright
    from palpate.nodes.rebuilding.evidence import known_space as known_space
    from palpate.nodes.rebuilding.evidence import spanned_by as spanned_by
    from palpate.nodes.rebuilding.evidence import touched_ends as touched_ends
    from palpate.nodes.rebuilding.fitting import fitted_solids as fitted_solids
    from palpate.nodes.rebuilding.fitting import predicted_squares as predicted_squares
    from palpate.nodes.rebuilding.fitting import rebuild_set as rebuild_set
    from palpate.nodes.rebuilding.model import coarse_model as coarse_model
    from palpate.nodes.rebuilding.model import shape_model as shape_model
else:
    __getattr__, __dir__ = lazy(__name__)
