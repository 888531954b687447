"""Recorded graphs run again: nodes compared message by message, and resumed runs.

What counts as a difference is in `comparison`. Rests on the pure handlers of palpate.nodes and on
palpate.messages.recording.
"""
