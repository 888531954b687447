"""Effects that disturb a sensor, and parts of your own effects: see docs/effects.md."""

from palpate.core.touch import (
    Effect as Effect,
    Fingertip as Fingertip,
    KeyedRandom as KeyedRandom,
    Phase as Phase,
    SimulatedTouch as SimulatedTouch,
    Stage as Stage,
)
