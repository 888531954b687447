"""How error and cost grow with the work.

`growth` enlarges one number at a time and fits a power to what comes of it; `memory` feeds a graph
ten thousand touches. Sizes and objects may be added to their tables. It rests on bench.explore,
bench.rebuild and bench.bus.
"""
