"""Exploratory procedures, and what one of your own is made of: see docs/procedures.md."""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.procedures import PROCEDURE_NAMES as PROCEDURE_NAMES
    from palpate.core.procedures import BoundaryModel as BoundaryModel, ConeFit as ConeFit
    from palpate.core.procedures import ConePoseFit as ConePoseFit, Contact as Contact
    from palpate.core.procedures import Exploration as Exploration, Findings as Findings
    from palpate.core.procedures import FingerMove as FingerMove, FoundOpenings as FoundOpenings
    from palpate.core.procedures import HandContacts as HandContacts, HandMove as HandMove
    from palpate.core.procedures import Opening as Opening, TouchSetting as TouchSetting
    from palpate.core.procedures import approach as approach, begin_procedure as begin_procedure
    from palpate.core.procedures import close as close, cone_mesh as cone_mesh
    from palpate.core.procedures import fit_cone as fit_cone, touch as touch
    from palpate.core.procedures import touch_pair as touch_pair
else:
    __getattr__, __dir__ = lazy(__name__)
