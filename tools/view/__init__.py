"""Runs to look at: what happened in robot time, drawn into images, films and the browser.

`timeline` is the one place that knows which messages are drawn; `rasteriser` draws without a
screen. Rests on tools.bag and tools.introspection; a picture never changes what a graph does.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.tools.surfaces import TruthSurface, scale_top, viridis
    from palpate.tools.view.rasteriser import Camera, Canvas, Pixels
    from palpate.tools.view.timeline import Timeline, read_timeline
else:
    __getattr__, __dir__ = lazy(__name__)
