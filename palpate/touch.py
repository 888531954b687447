"""Tactile sensing: pad, calibration, filters and curvature: see docs/touch.md."""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.touch import Calibration as Calibration
    from palpate.core.touch import CalibrationEstimate as CalibrationEstimate, Jet as Jet
    from palpate.core.touch import LocalCurvature as LocalCurvature, Pad as Pad, Patch as Patch
    from palpate.core.touch import TouchOutcome as TouchOutcome, begin_fusion as begin_fusion
    from palpate.core.touch import clean as clean, contact_mask as contact_mask
    from palpate.core.touch import estimate_calibration as estimate_calibration, fit_jet as fit_jet
    from palpate.core.touch import fit_patch as fit_patch, fit_robust_jet as fit_robust_jet
    from palpate.core.touch import frame_fault as frame_fault
    from palpate.core.touch import fuse as fuse, guarded_move as guarded_move
    from palpate.core.touch import principal_curvatures as principal_curvatures
    from palpate.core.touch import surface_patch as surface_patch
else:
    __getattr__, __dir__ = lazy(__name__)
