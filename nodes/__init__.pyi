from .runtime.node import (
    Finished as Finished,
    Node as Node,
    Outputs as Outputs,
    Source as Source,
    Timed as Timed,
)
