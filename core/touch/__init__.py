"""One touch of an elastic pad with an array of taxels.

Simulated from command to tactile frame, and read back as a surface patch with normal, curvatures
and their standard errors. Tunable are the settings classes of each module, in pitches or standard
deviations, and the effects that a scene lists; formulas follow their sources. It depends on core
arrays, frames and geometry, and on the protocol of shapes.
"""

from palpate.core.touch.curvature import (
    Estimator as Estimator,
    Patch as Patch,
    PatchKind as PatchKind,
    fit_patch as fit_patch,
    surface_patch as surface_patch,
)
from palpate.core.touch.faults import (
    FAULTS as FAULTS,
    FrameFault as FrameFault,
    frame_fault as frame_fault,
    is_repeated as is_repeated,
)
from palpate.core.touch.filters import (
    FilterOrder as FilterOrder,
    adaptive_wiener as adaptive_wiener,
    clean as clean,
    median_filter as median_filter,
    median_then_wiener as median_then_wiener,
    neighbourhoods as neighbourhoods,
    remove_impulses as remove_impulses,
    wiener_then_median as wiener_then_median,
)
from palpate.core.touch.forms import (
    PrincipalCurvatures as PrincipalCurvatures,
    ShapeOperator as ShapeOperator,
    curvature_along as curvature_along,
    graph_shape_operator as graph_shape_operator,
    principal_curvatures as principal_curvatures,
)
from palpate.core.touch.fusion import (
    FusedCurvature as FusedCurvature,
    FusionSettings as FusionSettings,
    LocalCurvature as LocalCurvature,
    begin_fusion as begin_fusion,
    corrected_jet as corrected_jet,
    curvature_error as curvature_error,
    fuse as fuse,
)
from palpate.core.touch.jet import (
    Jet as Jet,
    JetFit as JetFit,
    fit_jet as fit_jet,
    fit_robust_jet as fit_robust_jet,
    monomials as monomials,
    taylor_coefficients as taylor_coefficients,
)
from palpate.core.touch.pad import (
    DEFAULT_CONTACT as DEFAULT_CONTACT,
    HITS as HITS,
    SPRINGS as SPRINGS,
    Calibration as Calibration,
    ContactSettings as ContactSettings,
    FaceModel as FaceModel,
    Pad as Pad,
    Signal as Signal,
    TouchOutcome as TouchOutcome,
    contact_mask as contact_mask,
    guarded_move as guarded_move,
)
from palpate.core.touch.pipeline import (
    Effect as Effect,
    Fingertip as Fingertip,
    KeyedRandom as KeyedRandom,
    Phase as Phase,
    Pipeline as Pipeline,
    SimulatedTouch as SimulatedTouch,
    Stage as Stage,
    StageStates as StageStates,
    assemble as assemble,
)
from palpate.core.touch.points import (
    surface_points as surface_points,
)
from palpate.core.touch.taxel_calibration import (
    CalibrationEstimate as CalibrationEstimate,
    CalibrationTouches as CalibrationTouches,
    estimate_calibration as estimate_calibration,
)
from palpate.core.touch.turning import (
    set_down as set_down,
    turning_distances as turning_distances,
)
