"""Ctrl-C and its kin: noted at any moment, acted on by the launcher alone."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupts:
    """Within its ``with`` block, a request to end is only noted, however often it comes.

    Raises
    ------
    RuntimeError
        On entry, if this is not the main thread: only there can signals be heard.
    """

    def __init__(self) -> None:
        self.came: str | None = None
        """Name of the first signal that came."""
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Interrupts:
        if threading.current_thread() is not threading.main_thread():
            raise RuntimeError("a graph can only be launched from the main thread of a process")
        for number in _SIGNALS:
            before = signal.getsignal(number)
            # Under nohup a closed terminal is no reason to end.
            if number is signal.SIGHUP and before is signal.SIG_IGN:
                continue
            self._before[number] = before
            signal.signal(number, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        for number, before in self._before.items():
            signal.signal(number, signal.SIG_DFL if before is None else before)

    def _note(self, number: int, _: FrameType | None) -> None:
        self.came = self.came or signal.Signals(number).name


@contextmanager
def signals_as_ctrl_c() -> Iterator[None]:
    """Have a request to end, whichever it is, interrupt this thread as Ctrl-C does.

    Elsewhere than in the main thread nothing is changed: signals are not heard there.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)


@contextmanager
def until_ctrl_c() -> Iterator[Callable[[], bool]]:
    """Have the first Ctrl-C only noted, so that a loop ends where it can; the second one raises.

    Yields
    ------
    function
        Whether it came. Elsewhere than in the main thread it never does.
    """
    came: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return

    def note(number: int, _: FrameType | None) -> None:
        came.append(number)
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, note)
    try:
        yield lambda: bool(came)
    finally:
        signal.signal(signal.SIGINT, before)
