"""Recognition of objects by their shape.

What a closed surface is like in any pose (`description`), how that scatters when the same object is
measured and meshed again (`scatter`), and which of the stored objects it is, if any (`matching`).

The constants of `description` decide what counts as a face or a pocket: after a change all stored
scatter has to be learned again. It rests on geometry and on the recovery of superquadrics; it knows
no file, scene or run.
"""

from palpate.core.recognition.description import (
    FEATURES as FEATURES,
    Description as Description,
    ShapeFeature as ShapeFeature,
    describe as describe,
    feature_vector as feature_vector,
)
from palpate.core.recognition.matching import (
    NONE as NONE,
    UNCERTAINTY as UNCERTAINTY,
    Difference as Difference,
    ObjectModels as ObjectModels,
    Recognition as Recognition,
    differences as differences,
    object_models as object_models,
    recognise as recognise,
)
from palpate.core.recognition.scatter import (
    LEARNED_NOISE as LEARNED_NOISE,
    Scatter as Scatter,
    learn_scatter as learn_scatter,
    noisy_copy as noisy_copy,
)
