"""Fung's own way from contours to a solid (1999, chapter 4 and appendix).

A method to compare others with; its numbers are those of the thesis and its program. It is a
superquadric in a control lattice: the shell is made of the contours' control polygons, the core of
what fits inside, as corrected or as printed. It uses core splines, shapes, geometry and rebuild,
which loads it by an entry point as "thesis".
"""

from palpate.core.thesis.control_system import (
    ControlSolution as ControlSolution,
    solve_control_points as solve_control_points,
)
from palpate.core.thesis.layers import (
    fit_closed_curve_thesis as fit_closed_curve_thesis,
    invert_thesis as invert_thesis,
)
from palpate.core.thesis.rebuilding import (
    ThesisSolid as ThesisSolid,
    interpolated_parameters as interpolated_parameters,
    match_contour as match_contour,
    ray_azimuths as ray_azimuths,
    rebuild_thesis as rebuild_thesis,
)
from palpate.core.thesis.tactile_surface import (
    fit_bspline as fit_bspline,
)
