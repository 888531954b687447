"""Benches: palpate's speed and accuracy, printed as rows of a table beside what is demanded.

Nothing that palpate computes depends on this room, which depends on all others.
"""
