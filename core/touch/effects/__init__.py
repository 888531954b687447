"""Effects that disturb a simulated touch, one a file.

Nothing here is imported that no scene lists. A module of this room holds one frozen dataclass of
the same name (``gaussian_noise``, `GaussianNoise`), whose numbers have ranges, units and defaults:
add one beside them, or name a class of your own as ``module:Class``. It rests on
`palpate.core.touch.pipeline`; no effect imports another.
"""

from typing import TYPE_CHECKING

from palpate.rooms import lazy

if TYPE_CHECKING:
    from palpate.core.touch.effects.catalogue import EFFECT_NAMES as EFFECT_NAMES
    from palpate.core.touch.effects.catalogue import effect_type as effect_type
    from palpate.core.touch.effects.catalogue import rank as rank
else:
    __getattr__, __dir__ = lazy(__name__)
