"""What accuracy costs: every method on every object, in one file and on one sheet.

`methods` explores and `runs` keeps, in a format that other programs may write; `statistics` counts,
`sheet` draws, `measuring` is what ``palpate bench tolerance`` does. Another method is one function
(see docs/benchmark.md); a target, an object or a tolerance may be changed in `measuring`.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.bench.tolerance.methods import Model, Problem
    from palpate.bench.tolerance.runs import check_sources, sources_digest
else:
    __getattr__, __dir__ = lazy(__name__)
