"""Random numbers of one effect on one fingertip, told apart by the number of the touch.

Philox is a counter-based generator: the numbers of a touch follow from (seed, fingertip,
effect, number of the touch) and from nothing that happened before. So no effect can shift
another's draws, a state never hides in a generator, and any touch can be drawn again by itself.
Salmon, Moraes, Dror and Shaw, *Parallel random numbers: as easy as 1, 2, 3*, 2011. A file of
its own: a touch without effects does not import numpy.random, which takes 17 ms.
"""

from __future__ import annotations

from zlib import crc32

import numpy as np
from numpy.random import Generator, Philox, SeedSequence

from palpate.core.touch.pipeline import Fingertip


class KeyedRandom:
    """Random numbers of the effect `name` on a finger."""

    def __init__(self, finger: Fingertip, name: str):
        key = SeedSequence(finger.seed, spawn_key=(finger.number, crc32(name.encode())))
        self._philox = Philox(key=key.generate_state(2, np.uint64))
        self._generator = Generator(self._philox)
        self._state = self._philox.state

    def once(self) -> Generator:
        """For what is drawn once, when the finger is made; valid until the next call."""
        return self._at(0)

    def of_touch(self, number: int) -> Generator:
        """For the touch of this number; valid until the next call."""
        return self._at(number + 1)

    def _at(self, position: int) -> Generator:
        state = self._state
        state["state"]["counter"][:] = (0, 0, 0, position)
        state["buffer_pos"], state["has_uint32"], state["uinteger"] = 4, 0, 0
        self._philox.state = state
        return self._generator
