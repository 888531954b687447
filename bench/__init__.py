"""What users measure.

What palpate's speed and effects are, printed as rows of a table beside what is demanded of them.
Nothing that palpate computes depends on this room, which rests on all others.
"""
