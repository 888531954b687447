"""Exploratory procedures of the literature, and one's own.

Allen's grasp by containment, planar surface explorer, surface contour follower and hole explorer,
and Fearing's three fingers on a cone. Each is a generator that yields moves and is sent their
results. A user adds one by naming such a function as ``module:function``. They use core touch,
shapes, explore, rebuild and cones.
"""

from palpate.core.procedures.fearing import (
    ConePoseFit as ConePoseFit,
)
from palpate.core.procedures.generalised_cones import (
    ConeFit as ConeFit,
    ConeFitSettings as ConeFitSettings,
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
    CommonSettings as CommonSettings,
    Contact as Contact,
    Exploration as Exploration,
    Findings as Findings,
    FingerMove as FingerMove,
    HandContacts as HandContacts,
    HandMove as HandMove,
    Move as Move,
    MoveResult as MoveResult,
    Procedure as Procedure,
    Session as Session,
    TouchSetup as TouchSetup,
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
