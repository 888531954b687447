"""What a person does with graphs, runs and recordings: one chapter or room a tool.

Each chapter is one tool that may be changed or left out by itself; nothing below knows of it.
Rests on palpate.launch; the command line in tools.cli calls it.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.tools.reconstruction import single_threaded
    from palpate.tools.scene_text import check_scene
else:
    __getattr__, __dir__ = lazy(__name__)
