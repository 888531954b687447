"""Feels an unknown object with a simulated fingertip and rebuilds it as a solid.

The exported names are in ``__init__.pyi``; each is imported at its first use.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
