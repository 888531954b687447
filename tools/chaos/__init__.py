"""Fault injection: explorations in which processes are killed and stopped, and judged after.

Kinds of fault and their timing may be changed in `fault_injection`; `history` shares no code with
what it judges, and should not. Rests on launch.processes and the command line, as a user does.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.tools.chaos.fault_injection import FAULT_KINDS, FloodParams
    from palpate.tools.chaos.trials import Exploration, run_trials
else:
    __getattr__, __dir__ = lazy(__name__)
