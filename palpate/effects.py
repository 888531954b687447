"""What can disturb a sensor, and what an effect of your own is made of: see docs/effects.md."""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.touch import Effect as Effect, Fingertip as Fingertip
    from palpate.core.touch import KeyedRandom as KeyedRandom, Phase as Phase
    from palpate.core.touch import SimulatedTouch as SimulatedTouch, Stage as Stage
else:
    __getattr__, __dir__ = lazy(__name__)
