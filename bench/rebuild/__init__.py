"""Solids from contours and from taxels.

Against the truth and what an engineer would do without palpate. Another method is a `Peer`; demands
are ratios to the first peer of a case. It rests on core.rebuild and bench.objects.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.bench.rebuild.peers import poisson_installed, poisson_surface, truth_of
else:
    __getattr__, __dir__ = lazy(__name__)
