"""Writing and showing solids, for core, which does neither itself."""

from palpate.tools.exporting import export_solid as export_solid
from palpate.tools.showing import show_solid as show_solid
