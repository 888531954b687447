"""Who publishes.

One thin file for each node, started by the name of its module, and what a user needs to write
another. To be touched: any node may be replaced by one's own with the same topics; what it
computes stands in `palpate.core`. Nodes rest on `runtime` and `specs`, never on another node.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
