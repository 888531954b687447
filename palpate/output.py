"""What writes and shows solids: core names these two here, and neither writes nor draws itself."""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.tools.exporting import export_solid as export_solid
    from palpate.tools.showing import show_solid as show_solid
else:
    __getattr__, __dir__ = lazy(__name__)
