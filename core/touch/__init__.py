"""One touch of an elastic pad with an array of taxels.

Simulated from command to tactile frame, and read back as a surface patch with normal, curvatures
and their standard errors. What may be tuned are the named thresholds on top of each chapter, in
pitches or standard deviations, and the effects that a scene lists; formulas follow their
sources. It rests on core arrays, frames and geometry, and on the protocol of shapes.
"""

from palpate.core.touch.curvature import (
    LocalCurvature,
    Patch,
    PatchKind,
    begin_fusion,
    fit_patch,
    fuse,
    surface_patch,
)
from palpate.core.touch.faults import FAULTS, FrameFault, frame_fault, is_repeated
from palpate.core.touch.filters import (
    FilterOrder,
    adaptive_wiener,
    clean,
    median_filter,
    median_then_wiener,
    neighbourhoods,
    remove_impulses,
    wiener_then_median,
)
from palpate.core.touch.forms import (
    PrincipalCurvatures,
    ShapeOperator,
    graph_shape_operator,
    principal_curvatures,
)
from palpate.core.touch.jet import Jet, fit_jet, fit_robust_jet, monomials
from palpate.core.touch.pad import (
    CONTACT,
    HITS,
    SPRINGS,
    Calibration,
    FaceModel,
    Pad,
    Signal,
    TouchOutcome,
    contact_mask,
    guarded_move,
)
from palpate.core.touch.pipeline import (
    Effect,
    Fingertip,
    KeyedRandom,
    Phase,
    Pipeline,
    SimulatedTouch,
    Stage,
    StageStates,
    assemble,
)
from palpate.core.touch.surface_points import surface_points
from palpate.core.touch.taxel_calibration import (
    CalibrationEstimate,
    CalibrationTouches,
    estimate_calibration,
)
