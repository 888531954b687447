"""A control lattice carried along by a frame: deformed and undeformed control points alike.

A slant moves the deformed ones alone, for it is part of the deformation.
"""

from __future__ import annotations

from palpate.core.arrays import Floats
from palpate.core.frames import split_pose
from palpate.core.rebuild.lattice.slanted_volume import slanted_volume
from palpate.core.rebuild.slant import Slant
from palpate.core.splines.frame import Frame
from palpate.core.splines.lattice import Lattice
from palpate.core.splines.volume import Volume


def moved_lattice(lattice: Lattice, frame: Floats | None, slant: Slant | None = None) -> Lattice:
    """The lattice slanted, and where a frame of this pose (7,) carries it; the same for None."""
    if slant is not None:
        lattice = Lattice(slanted_volume(lattice.volume, slant), lattice.undeformed)
    if frame is None:
        return lattice
    position, axes = split_pose(frame)

    def moved(volume: Volume) -> Volume:
        return Volume(volume.control @ axes.T + position, volume.bases, volume.weights)

    before = lattice.undeformed
    if isinstance(before, Frame):
        return Lattice(
            moved(lattice.volume), Frame(before.corner @ axes.T + position, before.edges @ axes.T)
        )
    return Lattice(moved(lattice.volume), moved(before))
