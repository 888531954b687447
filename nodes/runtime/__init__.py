"""What a node is, and how one runs.

In a process of its own, composed with others, or under test, always by the same steps. To be
tuned: heartbeat, poll and flush times on top of `loop` and `sources`; handlers are handed over
in one order whatever the way of running, and that is not to be touched. Rests on
`palpate.messages`; the only part of `palpate.nodes` that reads a clock.
"""
