"""Recognition of objects by their shape.

`description` measures a closed surface independently of its pose, `scatter` how these measures vary
when the same object is measured and meshed again, and `matching` decides which of the stored
objects a surface is, if any.

After a change of `DescriptionSettings` or `ScatterSettings` all stored scatter has to be learned
again. The package uses geometry and the recovery of superquadrics, and no files, scenes or runs.
"""

from palpate.core.recognition.description import (
    FEATURES as FEATURES,
    Description as Description,
    DescriptionSettings as DescriptionSettings,
    ShapeFeature as ShapeFeature,
    describe as describe,
    feature_vector as feature_vector,
)
from palpate.core.recognition.matching import (
    NONE as NONE,
    Difference as Difference,
    MatchingSettings as MatchingSettings,
    ObjectModels as ObjectModels,
    Recognition as Recognition,
    differences as differences,
    object_models as object_models,
    recognise as recognise,
)
from palpate.core.recognition.scatter import (
    Scatter as Scatter,
    ScatterSettings as ScatterSettings,
    learn_scatter as learn_scatter,
    noisy_copy as noisy_copy,
)
