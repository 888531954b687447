"""What users measure.

What palpate's speed and accuracy are, printed as rows of a table beside what is
demanded of them. A demand, a number of trials or an object may be changed, and the figures in
docs/ are then printed anew; nothing that palpate computes depends on this room, for nothing
below imports it. It rests on all other rooms.
"""
