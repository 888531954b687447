"""Single touches of an object's ends, off the contours, and when they are enough.

The rule is one pure function, `next_probe`, of an `EndObservation`; its settings are
`ProbingSettings`. It rests on plane geometry, on the places where a hand searches (grasp), and on
the depth of a plain touch (tracing).
"""

from palpate.core.explore.probing.ends import (
    End as End,
    EndObservation as EndObservation,
    ProbeCommand as ProbeCommand,
    ProbeResult as ProbeResult,
    SideContour as SideContour,
)
from palpate.core.explore.probing.rule import (
    ProbingSettings as ProbingSettings,
    next_probe as next_probe,
)
