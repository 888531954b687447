"""How error and cost grow with the work, and what each part of palpate is worth.

`growth` enlarges one number at a time and fits a power to what comes of it; `ablation` explores
with one part taken out; `memory` feeds a graph ten thousand touches. Sizes, objects and parts may
be added to their tables. It rests on bench.explore, bench.rebuild and bench.bus.
"""
