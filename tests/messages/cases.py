"""Tables of cases, a line each; and addresses of a run."""

from pathlib import Path
from typing import Any

import pytest

from palpate.messages.bus import Addresses


def cases(names: str, *rows: Any, ids: Any = None) -> pytest.MarkDecorator:
    """Has a test run once for each row of values."""
    return pytest.mark.parametrize(names, rows, ids=ids)


def addresses(folder: Path, *names: str) -> Addresses:
    """Of a run of nodes within this machine, all files in a folder."""

    def each(kind: str, scheme: str = "") -> dict[str, str]:
        return {name: f"{scheme}{folder / kind}_{name}" for name in names}

    files = {kind: each(kind) for kind in ("journals", "times", "pasts")}
    sockets = {kind: each(kind, "ipc://") for kind in ("endpoints", "taps")}
    control = f"ipc://{folder / 'control'}"
    return Addresses(run=7, epoch=0, depth=1000, control=control, tools="", **files, **sockets)
