"""Exploratory procedures, and parts of your own procedures: see docs/procedures.md."""

from palpate.core.procedures import (
    PROCEDURE_NAMES as PROCEDURE_NAMES,
    BoundaryModel as BoundaryModel,
    ConeFit as ConeFit,
    ConePoseFit as ConePoseFit,
    Contact as Contact,
    Exploration as Exploration,
    Findings as Findings,
    FingerMove as FingerMove,
    FoundOpenings as FoundOpenings,
    HandContacts as HandContacts,
    HandMove as HandMove,
    Opening as Opening,
    TouchSetting as TouchSetting,
    approach as approach,
    begin_procedure as begin_procedure,
    close as close,
    cone_mesh as cone_mesh,
    fit_cone as fit_cone,
    touch as touch,
    touch_pair as touch_pair,
)
