"""Tracing the contour of a slice, touch by touch.

Procedures that search an arc, follow it, probe gaps and reacquire it. Lengths stand on top of
each chapter, in widths of the pad, and may be tuned. It rests on `palpate.core.touch` alone; a
tracer calls `next_command` and `after_touch`.
"""

from palpate.core.explore.tracing.contour_path import (
    TOUCH_DEPTH as TOUCH_DEPTH,
    Gap as Gap,
    SliceArc as SliceArc,
    SliceSpec as SliceSpec,
    TouchCommand as TouchCommand,
    arc_in_slice as arc_in_slice,
    deepest_point as deepest_point,
)
from palpate.core.explore.tracing.contour_trace import (
    Trace as Trace,
    TraceGoal as TraceGoal,
    TraceStatus as TraceStatus,
    after_touch as after_touch,
    next_command as next_command,
)
