"""Times of flight to compression of the pad, and back: Fung, 1999, (1.1)."""

from __future__ import annotations

from palpate.core.arrays import Floats


def flight_times(compression: Floats, thickness: float, sound_speed: float) -> Floats:
    """Round trip of the echo through the compressed pad, s.

    Parameters
    ----------
    compression : array
        m.
    thickness : float
        Of the undeformed pad, m.
    sound_speed : float
        In the pad, m/s.
    """
    return 2.0 * (thickness - compression) / sound_speed


def compression_from_times(times: Floats, thickness: float, sound_speed: float) -> Floats:
    """Compression of the pad, m, from times of flight in s."""
    return thickness - 0.5 * sound_speed * times
