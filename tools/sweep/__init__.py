"""Many explorations at once: which ones, who makes them, and what they came to.

A sweep file names scenes, parameters and seeds; each run is checked before the first one starts,
depends on its own resolved parameters alone, and keeps its folder. `sweep_folder` makes and keeps
them, here or on a cluster; `results` is what a user gets of them. Rests on palpate.launch.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.tools.sweep.results import pareto_front
    from palpate.tools.sweep.sweep_file import read_sweep
    from palpate.tools.sweep.sweep_folder import ASKED, ClusterWorkers, LocalWorkers, run_sweep
    from palpate.tools.sweep.sweep_folder import write_reports
else:
    __getattr__, __dir__ = lazy(__name__)
