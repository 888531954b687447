"""Exploratory procedures of the literature, and one's own.

Allen's grasp by containment, planar surface explorer, surface contour follower and hole explorer,
and Fearing's three fingers on a cone, each a generator that yields moves and is sent what they met.
A user adds one by naming such a function as ``module:function``. They rest on core touch, shapes,
explore, rebuild and cones; deviations and steps may be tuned.
"""

from palpate.core.procedures.fearing import ConePoseFit
from palpate.core.procedures.generalised_cones import ConeFit, cone_mesh, fit_cone
from palpate.core.procedures.openings import FoundOpenings, Opening
from palpate.core.procedures.planar import BoundaryModel
from palpate.core.procedures.protocol import (
    ANGLE_ERROR,
    POINT_ERROR,
    Contact,
    Exploration,
    Findings,
    FingerMove,
    HandContacts,
    HandMove,
    Met,
    Move,
    Procedure,
    Session,
    TouchSetting,
    approach,
    close,
    touch,
    touch_pair,
)
from palpate.core.procedures.registry import PROCEDURE_NAMES, begin_procedure, procedure_of
