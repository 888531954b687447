"""One touch of an elastic pad with an array of taxels.

Simulated from command to tactile frame, and read back as a surface patch with normal, curvatures
and their standard errors. What may be tuned are the named thresholds on top of each chapter, in
pitches or standard deviations, and the effects that a scene lists; formulas follow their
sources. It rests on core arrays, frames and geometry, and on the protocol of shapes.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.touch.curvature import LocalCurvature as LocalCurvature
    from palpate.core.touch.curvature import Patch as Patch
    from palpate.core.touch.curvature import PatchKind as PatchKind
    from palpate.core.touch.curvature import begin_fusion as begin_fusion
    from palpate.core.touch.curvature import fit_patch as fit_patch
    from palpate.core.touch.curvature import fuse as fuse
    from palpate.core.touch.curvature import surface_patch as surface_patch
    from palpate.core.touch.filters import FilterOrder as FilterOrder
    from palpate.core.touch.filters import adaptive_wiener as adaptive_wiener
    from palpate.core.touch.filters import clean as clean
    from palpate.core.touch.filters import median_filter as median_filter
    from palpate.core.touch.filters import median_then_wiener as median_then_wiener
    from palpate.core.touch.filters import neighbourhoods as neighbourhoods
    from palpate.core.touch.filters import remove_impulses as remove_impulses
    from palpate.core.touch.filters import wiener_then_median as wiener_then_median
    from palpate.core.touch.forms import PrincipalCurvatures as PrincipalCurvatures
    from palpate.core.touch.forms import ShapeOperator as ShapeOperator
    from palpate.core.touch.forms import graph_shape_operator as graph_shape_operator
    from palpate.core.touch.forms import principal_curvatures as principal_curvatures
    from palpate.core.touch.jet import Jet as Jet
    from palpate.core.touch.jet import fit_jet as fit_jet
    from palpate.core.touch.jet import fit_robust_jet as fit_robust_jet
    from palpate.core.touch.jet import monomials as monomials
    from palpate.core.touch.pad import CONTACT as CONTACT
    from palpate.core.touch.pad import HITS as HITS
    from palpate.core.touch.pad import SPRINGS as SPRINGS
    from palpate.core.touch.pad import Calibration as Calibration
    from palpate.core.touch.pad import FaceModel as FaceModel
    from palpate.core.touch.pad import Pad as Pad
    from palpate.core.touch.pad import Signal as Signal
    from palpate.core.touch.pad import TouchOutcome as TouchOutcome
    from palpate.core.touch.pad import contact_mask as contact_mask
    from palpate.core.touch.pad import guarded_move as guarded_move
    from palpate.core.touch.pipeline import Effect as Effect
    from palpate.core.touch.pipeline import Fingertip as Fingertip
    from palpate.core.touch.pipeline import KeyedRandom as KeyedRandom
    from palpate.core.touch.pipeline import Phase as Phase
    from palpate.core.touch.pipeline import Pipeline as Pipeline
    from palpate.core.touch.pipeline import SimulatedTouch as SimulatedTouch
    from palpate.core.touch.pipeline import Stage as Stage
    from palpate.core.touch.pipeline import StageStates as StageStates
    from palpate.core.touch.pipeline import assemble as assemble
    from palpate.core.touch.taxel_calibration import CalibrationEstimate as CalibrationEstimate
    from palpate.core.touch.taxel_calibration import CalibrationTouches as CalibrationTouches
    from palpate.core.touch.taxel_calibration import estimate_calibration as estimate_calibration
else:
    __getattr__, __dir__ = lazy(__name__)
