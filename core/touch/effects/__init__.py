"""Effects that disturb a simulated touch: of the arm, the rubber, the echoes and the electronics.

No file is imported of which a scene lists nothing. An effect is a frozen dataclass of its own name
(``gaussian_noise``, `GaussianNoise`), whose numbers have ranges, units and defaults: add one beside
them, or name a class of your own as ``module:Class``. It rests on `palpate.core.touch.pipeline`; no
file of effects imports another.
"""

from palpate.core.touch.effects.catalogue import (
    EFFECT_NAMES as EFFECT_NAMES,
    effect_type as effect_type,
    rank as rank,
)
