"""What a taxel sends, and what it means: Fung, 1999, (1.1), (1.2) and section 3.4.1."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from palpate.core.arrays import Floats

Signal = Literal["time", "force"]
"""What the array sends: times of flight of an echo, s, or forces, N."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """How an array's signal is turned into compression of its pad, and back."""

    signal: Signal
    """What a taxel sends."""
    thickness: float
    """Of the undeformed pad, m."""
    sound_speed: float
    """In the pad, m/s."""
    taxel_stiffness: float
    """Force on one taxel for each metre of compression, N/m: k of (1.2)."""
    gain: Floats | float = 1.0
    """Factor that corrects each taxel, (rows, cols) or one for all."""
    offset: Floats | float = 0.0
    """What is added to each taxel after that, m, (rows, cols) or one for all."""

    def encode(self, reading: Floats) -> Floats:
        """What the array sends for a compression that it takes to be `reading`, m.

        A round trip of the echo through the compressed pad, ``2 (d1 - c) / v`` in s, or a
        force, ``k c`` in N. Gain and offset are corrections of the listener: not applied.
        """
        if self.signal == "force":
            return self.taxel_stiffness * reading
        return (self.thickness - reading) * (2.0 / self.sound_speed)

    def decode(self, array: Floats) -> Floats:
        """Compression, m, of each taxel of a frame in s or N; corrected by gain and offset.

        With times of flight this is (1.1), whose reference t1 is that of the undeformed pad.
        """
        if self.signal == "force":
            raw = array / self.taxel_stiffness
        else:
            raw = self.thickness - (0.5 * self.sound_speed) * array
        corrected: Floats = np.multiply(raw, self.gain) + self.offset
        return corrected
