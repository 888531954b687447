"""Exploratory procedures of the literature, and one's own.

Allen's grasp by containment, planar surface explorer, surface contour follower and hole explorer,
and Fearing's three fingers on a cone, each a generator that yields moves and is sent what they met.
A user adds one by writing such a function and naming it ``module:function``. They rest on core
touch, shapes, explore, rebuild and cones; standard deviations and steps on top of each chapter may
be tuned.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.procedures.fearing import ConePoseFit as ConePoseFit
    from palpate.core.procedures.generalised_cones import ConeFit as ConeFit
    from palpate.core.procedures.generalised_cones import cone_mesh as cone_mesh
    from palpate.core.procedures.generalised_cones import fit_cone as fit_cone
    from palpate.core.procedures.openings import FoundOpenings as FoundOpenings
    from palpate.core.procedures.openings import Opening as Opening
    from palpate.core.procedures.planar import BoundaryModel as BoundaryModel
    from palpate.core.procedures.protocol import ANGLE_ERROR as ANGLE_ERROR
    from palpate.core.procedures.protocol import POINT_ERROR as POINT_ERROR
    from palpate.core.procedures.protocol import Contact as Contact
    from palpate.core.procedures.protocol import Exploration as Exploration
    from palpate.core.procedures.protocol import Findings as Findings
    from palpate.core.procedures.protocol import FingerMove as FingerMove
    from palpate.core.procedures.protocol import HandContacts as HandContacts
    from palpate.core.procedures.protocol import HandMove as HandMove
    from palpate.core.procedures.protocol import Met as Met
    from palpate.core.procedures.protocol import Move as Move
    from palpate.core.procedures.protocol import Procedure as Procedure
    from palpate.core.procedures.protocol import Session as Session
    from palpate.core.procedures.protocol import TouchSetting as TouchSetting
    from palpate.core.procedures.protocol import approach as approach
    from palpate.core.procedures.protocol import close as close
    from palpate.core.procedures.protocol import touch as touch
    from palpate.core.procedures.protocol import touch_pair as touch_pair
    from palpate.core.procedures.registry import PROCEDURE_NAMES as PROCEDURE_NAMES
    from palpate.core.procedures.registry import begin_procedure as begin_procedure
    from palpate.core.procedures.registry import procedure_of as procedure_of
else:
    __getattr__, __dir__ = lazy(__name__)
