"""Effects that disturb a simulated touch: of the arm, the rubber, the echoes and the electronics.

Only files whose effects a scene lists are imported. An effect is a frozen dataclass named like the
effect (``gaussian_noise``, `GaussianNoise`), whose numbers have ranges, units and defaults: add one
here, or name a class of your own as ``module:Class``. It depends on `palpate.core.touch.pipeline`;
no file of effects imports another.
"""

from palpate.core.touch.effects.catalogue import (
    EFFECT_NAMES as EFFECT_NAMES,
    effect_type as effect_type,
    rank as rank,
)
