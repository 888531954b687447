"""One touch: the pad that presses, and what its frame says about the surface."""
