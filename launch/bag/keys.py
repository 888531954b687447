"""The keyboard of somebody who plays a recording: space pauses and resumes, an arrow steps."""

from __future__ import annotations

import os
import re
import select
import sys
import termios
import tty
from contextlib import suppress
from typing import Any

SPACE, RIGHT = b" ", b"\x1b[C"
_KEY = re.compile(rb"\x1b\[[A-D]|[^\x1b]", re.DOTALL)


class Keys:
    """Reads single keys while its ``with`` block lasts; does nothing where there is no terminal."""

    def __init__(self) -> None:
        self._before: list[Any] | None = None

    def __enter__(self) -> Keys:
        with suppress(termios.error, OSError, ValueError):
            file = sys.stdin.fileno()
            # Who runs in the background would be stopped for touching the terminal.
            if sys.stdin.isatty() and os.tcgetpgrp(file) == os.getpgrp():
                self._before = termios.tcgetattr(sys.stdin)
                tty.setcbreak(sys.stdin)
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    def pressed(self) -> list[bytes]:
        """Return the keys that have been pressed since it was asked last."""
        keys: list[bytes] = []
        while self._before is not None and select.select([sys.stdin], [], [], 0.0)[0]:
            data = os.read(sys.stdin.fileno(), 64)
            if not data:
                break
            keys += _KEY.findall(data)
        return keys
