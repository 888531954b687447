"""The wiring of a graph as SVG: boxes and wires, their layers, lanes and places.

Sizes may be changed in `sizes`; all of it is to give way to Mermaid, DOT and a small layered
layout. Rests on launch.graph.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.rooms import lazy

if TYPE_CHECKING:
    from palpate.tools.graph_drawing.svg import write_picture as write_picture
else:
    __getattr__, __dir__ = lazy(__name__)
