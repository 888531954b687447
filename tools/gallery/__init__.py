"""The figures of Fung's thesis (1999), drawn anew by palpate's code, and some of palpate's own.

A chapter of the thesis is a chapter here; each figure is a function that returns a picture, and
`sheet` has the table of all. What may be changed are views, sizes and colours, in `style`; a figure
computes nothing itself that palpate can compute. Rests on palpate.core, palpate.launch and the
rasteriser of palpate.tools.view.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.tools.gallery.sheet import FIGURES, GalleryFigure, draw_png, find_figures
    from palpate.tools.gallery.sheet import write_gallery
else:
    __getattr__, __dir__ = lazy(__name__)
