"""The side surface: through contours that correspond (a loft), and as a radial spline.

The loft is smoothed by cross-validation, and tells how far it can be trusted between contours. The
radial spline is fitted to every touched taxel at once, with a shift of each touch where poses err;
its numbers of spans and coefficients and strengths of bending may be tuned: they were set together
on the shipped scenes. Both rest on `palpate.core.rebuild.contours` and on `palpate.core.splines`.
"""

from palpate.core.rebuild.side.equations import (
    AxisCurve as AxisCurve,
    fit_axis_curve as fit_axis_curve,
    looks_inward as looks_inward,
)
from palpate.core.rebuild.side.lofting import (
    ContourLoft as ContourLoft,
    Uncertainty as Uncertainty,
    fit_contour_loft as fit_contour_loft,
    noise_of as noise_of,
)
from palpate.core.rebuild.side.radial import (
    POSE_LEFT as POSE_LEFT,
    Coverage as Coverage,
    RadialFit as RadialFit,
    RadialSpline as RadialSpline,
    bridged as bridged,
    coverage_of as coverage_of,
    fit_draft as fit_draft,
    fit_radial_spline as fit_radial_spline,
    radial_fit as radial_fit,
    with_normals as with_normals,
)
from palpate.core.rebuild.side.shifts import (
    fit_shifted_spline as fit_shifted_spline,
)
from palpate.core.rebuild.side.surfaces import (
    ContourSurface as ContourSurface,
    SidePatch as SidePatch,
)
