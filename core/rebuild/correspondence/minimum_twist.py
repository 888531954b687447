"""Where each contour begins if the surface between it and the next is to twist least."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.correspondence.circular_peak import circular_peak


def minimum_twist(shapes: Floats) -> Floats:
    """Steps (M - 1,), in turns, from where one curve begins to where the next one should.

    Parameters
    ----------
    shapes : (M, n, 2) array
        Closed curves, each about its own middle, at even steps of the turn, m.

    Notes
    -----
    The step s makes the sum of ``|a(u) - b(u + s)|^2`` smallest, and so their circular
    correlation largest, which the Fourier transform gives for all s at once.
    """
    waves = np.fft.fft(shapes[..., 0] + 1j * shapes[..., 1], axis=1)
    # The sum over both coordinates is the real part of one complex product.
    correlation = np.fft.ifft(np.conj(waves[:-1]) * waves[1:], axis=1).real
    steps = circular_peak(correlation)
    return steps - np.round(steps)


def begin_turns(steps: Floats, from_slice: int, begin: float) -> Floats:
    """Turns (M,) from 0 to 1 at which curves begin, given the steps (M - 1,) between them.

    `from_slice` is the curve whose beginning is given.
    """
    turns = np.concatenate([[0.0], np.cumsum(steps)])
    begins: Floats = np.mod(turns - turns[from_slice] + begin, 1.0)
    return begins
