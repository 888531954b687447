"""One touch.

Frames per second, and what each effect costs and does. It rests on
core.touch and on the simulator, filter and curvature nodes as plain calls.
"""

from typing import TYPE_CHECKING

from palpate.rooms import lazy

if TYPE_CHECKING:
    from palpate.bench.touch.frames import touch_goals as touch_goals
else:
    __getattr__, __dir__ = lazy(__name__)
