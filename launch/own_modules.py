"""Where a user's own modules are looked for: where Python looks, and where palpate is started."""

from __future__ import annotations

import sys
from pathlib import Path


def look_here(name: str) -> None:
    """Have the module of ``module:Class`` looked for in the current folder, too, after all others.

    Processes that are started later inherit it.
    """
    here = str(Path.cwd())
    if ":" in name and here not in sys.path:
        sys.path.append(here)
