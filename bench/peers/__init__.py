"""A Gaussian process that explores by greatest variance.

With the same finger and the same noise as palpate: what it is compared with. Its `Tuning` was
chosen on two objects that do not count; a kernel or a way to choose may be added. It rests on
the harness of bench.explore for scenes and ways; palpate itself needs none of it.
"""
