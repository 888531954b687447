"""Tracing the contour of a slice, touch by touch.

Procedures that search an arc, follow it, probe gaps and reacquire it. Lengths stand on top of
each chapter, in widths of the pad, and may be tuned. It rests on `palpate.core.touch` alone; a
tracer calls `next_command` and `after_touch`.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.explore.tracing.contour_path import TOUCH_DEPTH as TOUCH_DEPTH
    from palpate.core.explore.tracing.contour_path import Gap as Gap
    from palpate.core.explore.tracing.contour_path import SliceArc as SliceArc
    from palpate.core.explore.tracing.contour_path import SliceSpec as SliceSpec
    from palpate.core.explore.tracing.contour_path import TouchCommand as TouchCommand
    from palpate.core.explore.tracing.contour_path import arc_in_slice as arc_in_slice
    from palpate.core.explore.tracing.contour_path import deepest_point as deepest_point
    from palpate.core.explore.tracing.contour_trace import Trace as Trace
    from palpate.core.explore.tracing.contour_trace import TraceGoal as TraceGoal
    from palpate.core.explore.tracing.contour_trace import TraceStatus as TraceStatus
    from palpate.core.explore.tracing.contour_trace import after_touch as after_touch
    from palpate.core.explore.tracing.contour_trace import next_command as next_command
else:
    __getattr__, __dir__ = lazy(__name__)
