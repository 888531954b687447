"""Noise of the electronics: jitter of the echo's arrival."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from palpate.core.plugins import Range, Ranged
from palpate.core.touch.pipeline import Fingertip, KeyedRandom, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class GaussianNoise(Ranged):
    """White normal noise, ``v + N(0, sigma^2)``: independent in each taxel and touch.

    A jitter of the time of flight of ``s`` seconds is a noise of ``v s / 2`` metres: 20 ns, an
    array of the 1990s, are 10 um at 1000 m/s; 2 ns, a modern one, 1 um. Both are engineering
    values; the jitter of an echo goes as 1 / (2 pi f sqrt(SNR)).
    """

    phase: ClassVar = Phase.SIGNAL

    # Standard deviation of one taxel's reading.
    sigma: Annotated[float, Range(0.0, 1e-3, "m")] = 10e-6

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        draws, sigma = KeyedRandom(finger, "gaussian_noise"), self.sigma
        shape = (finger.pad.rows, finger.pad.cols)

        def apply(touch: SimulatedTouch, state: None) -> None:
            noise = draws.of_touch(touch.number).standard_normal(shape)
            touch.reading = touch.reading + sigma * noise

        return Stage(apply, noise=sigma)
