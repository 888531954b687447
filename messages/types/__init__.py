"""All message types, in one file for each subject; `TYPES` has them by name.

A new type is a frozen dataclass in the file of its subject. Changing a field changes the hash of
the schema, so that old recordings are refused. The types use only `palpate.messages.fields`.
"""

from palpate.messages.types.catalogue import (
    ALL_KEPT as ALL_KEPT,
    LATCHED as LATCHED,
    TYPES as TYPES,
    Clock as Clock,
    LogRecord as LogRecord,
    NodeStatus as NodeStatus,
    ParameterEvent as ParameterEvent,
)
from palpate.messages.types.model import (
    ModelGoal as ModelGoal,
    PlanDone as PlanDone,
    PlanEstimate as PlanEstimate,
    Score as Score,
    ShapeModel as ShapeModel,
    Superquadric as Superquadric,
)
from palpate.messages.types.motion import (
    Contour as Contour,
    ContourGoal as ContourGoal,
    FingerClock as FingerClock,
    GraspContacts as GraspContacts,
    GraspGoal as GraspGoal,
    Probe as Probe,
    ProbeGoal as ProbeGoal,
    TouchGoal as TouchGoal,
    Turned as Turned,
    TurnGoal as TurnGoal,
)
from palpate.messages.types.procedure import (
    BoundaryRepresentation as BoundaryRepresentation,
    ConePose as ConePose,
    GeneralisedCone as GeneralisedCone,
    Openings as Openings,
    ProcedureResult as ProcedureResult,
)
from palpate.messages.types.touch import (
    SequenceEnd as SequenceEnd,
    SurfacePatch as SurfacePatch,
    TactileFrame as TactileFrame,
    TactileImage as TactileImage,
)
from palpate.messages.types.world import (
    SensorInfo as SensorInfo,
    SpaceMap as SpaceMap,
    Truth as Truth,
    World as World,
)
