"""The messages of a recording in the order in which they were sent.

The recorder may have heard two publishers in another order. Of all messages only the times are
held, and of those that it heard too early the messages themselves, until their turn comes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from palpate.messages.recording.reader import Kept, Recording


def in_order_of_sending(recording: Recording) -> Iterator[Kept]:
    """Messages by the time at which they were sent; those of one time as they were heard.

    Processes of one machine share the clock, so no effect comes before its cause.

    Parameters
    ----------
    recording : Recording
        What to read; it is read twice.

    Raises
    ------
    ValueError
        If it cannot be read, or loses messages while it is read.
    """
    sent = np.fromiter((kept.sent_ns for kept in recording.messages()), np.uint64)
    turns = iter(np.argsort(sent, kind="stable").tolist())
    early: dict[int, Kept] = {}
    turn = next(turns, None)
    for place, kept in enumerate(recording.messages()):
        early[place] = kept
        while turn in early:
            yield early.pop(turn)
            turn = next(turns, None)
        if turn is None:
            return
    if turn is not None:
        raise ValueError(f"recording {recording.path} became shorter while it was read")
