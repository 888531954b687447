"""Side surface: a radial spline of all that was touched, or a loft of contours alone.

The radial spline is fitted to every touched taxel at once, with a shift of each touch where poses
err, and is the surface itself. Where only contours are known, or sections are not star-shaped, a
loft goes through them, smoothed by cross-validation. Both are a `Side`: a patch, and its
uncertainty. They rest on `palpate.core.rebuild.contours` and on `palpate.core.splines`.
"""

from palpate.core.rebuild.side.equations import (
    AxisCurve as AxisCurve,
    fit_axis_curve as fit_axis_curve,
    looks_inward as looks_inward,
)
from palpate.core.rebuild.side.lofting import (
    ContourLoft as ContourLoft,
    LoftSettings as LoftSettings,
    contour_noise as contour_noise,
    fit_contour_loft as fit_contour_loft,
)
from palpate.core.rebuild.side.radial import (
    DetailSettings as DetailSettings,
    RadialSettings as RadialSettings,
    RadialSpline as RadialSpline,
    fit_radial_spline as fit_radial_spline,
    fit_side_spline as fit_side_spline,
    with_gaps_bridged as with_gaps_bridged,
    with_normals as with_normals,
)
from palpate.core.rebuild.side.shifts import (
    ShiftSettings as ShiftSettings,
    fit_shifted_spline as fit_shifted_spline,
)
from palpate.core.rebuild.side.side import (
    DEFAULT_ERROR_BOUND as DEFAULT_ERROR_BOUND,
    Coverage as Coverage,
    ErrorBoundSettings as ErrorBoundSettings,
    RadialPatch as RadialPatch,
    RadialSide as RadialSide,
    Uncertainty as Uncertainty,
    coverage_of as coverage_of,
    radial_side as radial_side,
)
from palpate.core.rebuild.side.surfaces import (
    LoftPatch as LoftPatch,
)

Side = RadialSide | ContourLoft  # a patch, and its uncertainty
SidePatch = RadialPatch | LoftPatch  # from 0 at the lower end of a side to 1 at the upper one
