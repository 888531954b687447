"""Tracing the contour of a slice, touch by touch.

Procedures that search an arc, follow it, probe gaps and reacquire it. Lengths stand on top of
each chapter, in widths of the pad, and may be tuned. It rests on `palpate.core.touch` alone; a
tracer calls `next_command` and `after_touch`.
"""

from palpate.core.explore.tracing.contour_path import (
    TOUCH_DEPTH,
    Gap,
    SliceArc,
    SliceSpec,
    TouchCommand,
    arc_in_slice,
    deepest_point,
)
from palpate.core.explore.tracing.contour_trace import (
    Trace,
    TraceGoal,
    TraceStatus,
    after_touch,
    next_command,
)
