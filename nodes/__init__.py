"""Nodes, one thin module each, started by the name of the module.

A user may replace any node by another one with the same topics. The computations of nodes are in
`palpate.core`. Nodes use `runtime` and `specs`, and no other node.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
