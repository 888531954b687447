"""A control lattice carried along by a frame: deformed and undeformed control points alike."""

from __future__ import annotations

from palpate.core.arrays import Floats
from palpate.core.frames import split_pose
from palpate.core.splines.frame import Frame
from palpate.core.splines.lattice import Lattice
from palpate.core.splines.volume import Volume


def moved_lattice(lattice: Lattice, frame: Floats | None) -> Lattice:
    """The lattice where a frame of this pose (7,) carries it; the same one for None."""
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
