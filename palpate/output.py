"""What writes and shows solids: core names these two here, and neither writes nor draws itself."""

from palpate.tools.exporting import export_solid as export_solid
from palpate.tools.showing import show_solid as show_solid
