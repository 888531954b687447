"""Every message type, one file a subject; `TYPES` finds one by its name.

A new type is a frozen dataclass in the file of its subject; changing a field changes the schema's
hash, and old recordings are refused by name. Rests on the field types of `palpate.messages` alone.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.messages.types.catalogue import ALL_KEPT as ALL_KEPT, LATCHED as LATCHED
    from palpate.messages.types.catalogue import TYPES as TYPES, Clock as Clock
    from palpate.messages.types.catalogue import LogRecord as LogRecord, NodeStatus as NodeStatus
    from palpate.messages.types.catalogue import ParameterEvent as ParameterEvent
    from palpate.messages.types.model import ModelGoal as ModelGoal, PlanDone as PlanDone
    from palpate.messages.types.model import PlanEstimate as PlanEstimate, Score as Score
    from palpate.messages.types.model import ShapeModel as ShapeModel, Superquadric as Superquadric
    from palpate.messages.types.motion import Contour as Contour, ContourGoal as ContourGoal
    from palpate.messages.types.motion import FingerClock as FingerClock
    from palpate.messages.types.motion import GraspContacts as GraspContacts, GraspGoal as GraspGoal
    from palpate.messages.types.motion import Probe as Probe, ProbeGoal as ProbeGoal
    from palpate.messages.types.motion import TouchGoal as TouchGoal
    from palpate.messages.types.procedure import BoundaryRepresentation as BoundaryRepresentation
    from palpate.messages.types.procedure import ConePose as ConePose
    from palpate.messages.types.procedure import GeneralisedCone as GeneralisedCone
    from palpate.messages.types.procedure import Openings as Openings
    from palpate.messages.types.procedure import ProcedureResult as ProcedureResult
    from palpate.messages.types.touch import SequenceEnd as SequenceEnd
    from palpate.messages.types.touch import SurfacePatch as SurfacePatch
    from palpate.messages.types.touch import TactileFrame as TactileFrame
    from palpate.messages.types.touch import TactileImage as TactileImage
    from palpate.messages.types.world import SensorInfo as SensorInfo, SpaceMap as SpaceMap
    from palpate.messages.types.world import Truth as Truth, World as World
else:
    __getattr__, __dir__ = lazy(__name__)
