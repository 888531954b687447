"""Exploratory procedures of the literature, and one's own.

Allen's grasp by containment, planar surface explorer, surface contour follower and hole explorer,
and Fearing's three fingers on a cone, each a generator that yields moves and is sent what they met.
A user adds one by naming such a function as ``module:function``. They rest on core touch, shapes,
explore, rebuild and cones; deviations and steps may be tuned.
"""

from palpate.core.procedures.fearing import (
    ConePoseFit as ConePoseFit,
)
from palpate.core.procedures.generalised_cones import (
    ConeFit as ConeFit,
    cone_mesh as cone_mesh,
    fit_cone as fit_cone,
)
from palpate.core.procedures.openings import (
    FoundOpenings as FoundOpenings,
    Opening as Opening,
)
from palpate.core.procedures.planar import (
    BoundaryModel as BoundaryModel,
)
from palpate.core.procedures.protocol import (
    ANGLE_ERROR as ANGLE_ERROR,
    POINT_ERROR as POINT_ERROR,
    Contact as Contact,
    Exploration as Exploration,
    Findings as Findings,
    FingerMove as FingerMove,
    HandContacts as HandContacts,
    HandMove as HandMove,
    Met as Met,
    Move as Move,
    Procedure as Procedure,
    Session as Session,
    TouchSetting as TouchSetting,
    approach as approach,
    close as close,
    touch as touch,
    touch_pair as touch_pair,
)
from palpate.core.procedures.registry import (
    PROCEDURE_NAMES as PROCEDURE_NAMES,
    begin_procedure as begin_procedure,
    procedure_of as procedure_of,
)
