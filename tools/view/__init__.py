"""Runs to look at: what happened in robot time, drawn into images, films and the browser.

`timeline` is the one place that knows which messages are drawn; `rasteriser` draws without a
screen, `browser` in one. A picture never changes what a graph does. Rests on tools.bag and
tools.introspection.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.tools.view.beside import ViewProcess
    from palpate.tools.view.film import make_film
    from palpate.tools.view.live import view_run
    from palpate.tools.view.picture import draw_moment, finger_mesh, png_bytes, still
    from palpate.tools.view.rasteriser import FINER, Camera, Canvas, camera_on
    from palpate.tools.view.timeline import TRACED, TYPES_DRAWN, Moment, Timeline, Touch, curve_of
    from palpate.tools.view.timeline import read_timeline
else:
    __getattr__, __dir__ = lazy(__name__)
