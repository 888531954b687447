"""What the planner node remembers.

And what closings of the hand and probes of the ends add to it. To be tuned: number of contacts
and grips, spacing of the search, nearness of an end, on top of `phases`. Rests on
`palpate.core.explore`, which holds every rule; used by the planner node alone.
"""
