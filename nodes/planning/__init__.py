"""What messages say of models, for the nodes that decide when an exploration ends.

Used by the planner and the collector, and by the launcher's forecast. What is known while an object
is explored, and what follows from it, stands in `palpate.core.explore`.
"""
