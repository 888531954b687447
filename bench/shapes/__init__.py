"""The mathematics of shapes and splines.

Superquadrics recovered from points, casts at all models, point inversion, closed curves. Demands
and numbers of trials may be changed. It rests on core.shapes, core.splines and core.rebuild
alone, no node takes part.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.rooms import lazy

if TYPE_CHECKING:
    from palpate.bench.shapes.splines import CLOSED_CURVES as CLOSED_CURVES
    from palpate.bench.shapes.splines import CURVE_CONTROLS as CURVE_CONTROLS
    from palpate.bench.shapes.splines import CURVE_POINTS as CURVE_POINTS
else:
    __getattr__, __dir__ = lazy(__name__)
