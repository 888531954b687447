"""What can disturb a sensor, and what an effect of your own is made of: see docs/effects.md."""

from palpate.core.touch import (
    Effect as Effect,
    Fingertip as Fingertip,
    KeyedRandom as KeyedRandom,
    Phase as Phase,
    SimulatedTouch as SimulatedTouch,
    Stage as Stage,
)
