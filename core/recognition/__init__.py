"""Recognition of objects by their shape.

What a closed surface is like in any pose (`description`), how that scatters when the same object is
measured and meshed again (`scatter`), and which of the stored objects it is, if any (`matching`).

The constants of `description` decide what counts as a face or a pocket: after a change all stored
scatter has to be learned again. It rests on geometry and on the recovery of superquadrics; it knows
no file, scene or run.
"""

from palpate.core.recognition.description import (
    FEATURES,
    Description,
    ShapeFeature,
    describe,
    feature_vector,
)
from palpate.core.recognition.matching import (
    NONE,
    UNCERTAINTY,
    Difference,
    ObjectModels,
    Recognition,
    differences,
    object_models,
    recognise,
)
from palpate.core.recognition.scatter import LEARNED_NOISE, Scatter, learn_scatter, noisy_copy
