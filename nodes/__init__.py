"""Who publishes.

One thin file for each node, started by the name of its module, and what a user needs to write
another. To be touched: any node may be replaced by one's own with the same topics; what it
computes stands in `palpate.core`. Nodes rest on `runtime` and `specs`, never on another node.
"""

from palpate.nodes.runtime.node import (
    Finished as Finished,
    Node as Node,
    Outputs as Outputs,
    Source as Source,
    Timed as Timed,
)
