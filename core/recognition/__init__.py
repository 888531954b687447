"""Recognition of objects by their shape.

What a closed surface is like in any pose (`description`), how that scatters when the same object is
measured and meshed again (`scatter`), and which of the stored objects it is, if any (`matching`).

The constants of `description` decide what counts as a face or a pocket: after a change all stored
scatter has to be learned again. It rests on geometry and on the recovery of superquadrics; it knows
no file, scene or run.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.recognition.description import FEATURES as FEATURES
    from palpate.core.recognition.description import Description as Description
    from palpate.core.recognition.description import ShapeFeature as ShapeFeature
    from palpate.core.recognition.description import describe as describe
    from palpate.core.recognition.description import feature_vector as feature_vector
    from palpate.core.recognition.matching import NONE as NONE
    from palpate.core.recognition.matching import UNCERTAINTY as UNCERTAINTY
    from palpate.core.recognition.matching import Difference as Difference
    from palpate.core.recognition.matching import ObjectModels as ObjectModels
    from palpate.core.recognition.matching import Recognition as Recognition
    from palpate.core.recognition.matching import differences as differences
    from palpate.core.recognition.matching import object_models as object_models
    from palpate.core.recognition.matching import recognise as recognise
    from palpate.core.recognition.scatter import LEARNED_NOISE as LEARNED_NOISE
    from palpate.core.recognition.scatter import Scatter as Scatter
    from palpate.core.recognition.scatter import learn_scatter as learn_scatter
    from palpate.core.recognition.scatter import noisy_copy as noisy_copy
else:
    __getattr__, __dir__ = lazy(__name__)
