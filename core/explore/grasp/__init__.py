"""Grasp by containment: the first coarse knowledge of size, place and axis."""
