"""Tracing the contour of a slice, touch by touch.

Procedures that search an arc, follow it, probe gaps and reacquire it. Lengths stand on top of
each chapter, in widths of the pad, and may be tuned. It rests on `palpate.core.touch` alone; a
tracer calls `next_command` and `after_touch`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.rooms import lazy

if TYPE_CHECKING:
    from palpate.core.explore.tracing.commands import TOUCH_DEPTH as TOUCH_DEPTH
    from palpate.core.explore.tracing.commands import SliceSpec as SliceSpec
    from palpate.core.explore.tracing.commands import TouchCommand as TouchCommand
    from palpate.core.explore.tracing.contour_path import Gap as Gap
    from palpate.core.explore.tracing.contour_trace import Trace as Trace
    from palpate.core.explore.tracing.contour_trace import TraceGoal as TraceGoal
    from palpate.core.explore.tracing.contour_trace import TraceStatus as TraceStatus
    from palpate.core.explore.tracing.contour_trace import after_touch as after_touch
    from palpate.core.explore.tracing.contour_trace import next_command as next_command
    from palpate.core.explore.tracing.slice_arc import SliceArc as SliceArc
    from palpate.core.explore.tracing.slice_arc import arc_in_slice as arc_in_slice
    from palpate.core.explore.tracing.slice_arc import deepest_point as deepest_point
else:
    __getattr__, __dir__ = lazy(__name__)
