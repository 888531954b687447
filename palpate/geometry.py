"""Poses, and distances between surfaces: see docs/distances.md."""

from palpate.core.geometry import (
    compare_surfaces as compare_surfaces,
    prepare_surface as prepare_surface,
)
from palpate.core.poses import Pose as Pose, pad_rotation as pad_rotation
