"""``palpate bench real``: every mesh of a folder explored with noise, measured and drawn.

Runs are kept in a file and not made again. It rests on the exploration in this process of
`palpate.bench.explore` and on the files of `palpate.bench.results`.
"""

from palpate.bench.real.exploring import real_rows as real_rows
