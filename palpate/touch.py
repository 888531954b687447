"""Tactile sensing: pad, calibration, filters and curvature: see docs/touch.md."""

from palpate.core.touch import (
    Calibration as Calibration,
    CalibrationEstimate as CalibrationEstimate,
    Jet as Jet,
    LocalCurvature as LocalCurvature,
    Pad as Pad,
    Patch as Patch,
    TouchOutcome as TouchOutcome,
    begin_fusion as begin_fusion,
    clean as clean,
    contact_mask as contact_mask,
    estimate_calibration as estimate_calibration,
    fit_jet as fit_jet,
    fit_patch as fit_patch,
    fit_robust_jet as fit_robust_jet,
    frame_fault as frame_fault,
    fuse as fuse,
    guarded_move as guarded_move,
    principal_curvatures as principal_curvatures,
    surface_patch as surface_patch,
)
