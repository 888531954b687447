"""Feels an unknown object with a simulated fingertip and rebuilds it as a solid.

What it exports stands in ``__init__.pyi``; each name is imported when it is first used.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
