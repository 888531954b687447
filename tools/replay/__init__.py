"""Recorded graphs run again: nodes compared message by message, and runs that go on.

What counts as a difference is in `comparison`. Rests on the pure handlers of palpate.nodes and on
palpate.messages.recording.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.tools.replay.rerun import past_differences, plan_resume, replay
else:
    __getattr__, __dir__ = lazy(__name__)
