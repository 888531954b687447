"""Damaged input of five kinds, made from seeds and by hand, and what the readers make of it.

Accepted and valid, refused in one sentence by one error, or a defect that is told with the
number by which it is reproduced. New hand-made files and new mutations may be added at the end
of their lists (a number is a seed: to put one in the middle changes what all later numbers
mean). It rests on the readers: codec, bus words, recordings, meshes, scenes, solids.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.rooms import lazy

if TYPE_CHECKING:
    from palpate.bench.fuzz.trials import reproduce as reproduce
else:
    __getattr__, __dir__ = lazy(__name__)
