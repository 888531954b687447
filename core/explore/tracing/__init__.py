"""Tracing the contour of a slice, touch by touch.

Procedures that search an arc, follow it, probe gaps and reacquire it. Their settings stand beside
them, in `TracingSettings`; most lengths are in widths of the pad. A tracer calls `next_command` and
`after_touch`. It rests on `palpate.core.touch` alone.
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
    TracingSettings as TracingSettings,
    after_touch as after_touch,
    next_command as next_command,
)
