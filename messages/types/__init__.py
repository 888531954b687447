"""Every message type, one file a subject; `TYPES` finds one by its name.

A new type is a frozen dataclass in the file of its subject; changing a field changes the schema's
hash, and old recordings are refused by name. Rests on the field types of `palpate.messages` alone.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.messages.types.catalogue import ALL_KEPT as ALL_KEPT
    from palpate.messages.types.catalogue import LATCHED as LATCHED
    from palpate.messages.types.catalogue import TYPES as TYPES
    from palpate.messages.types.catalogue import Clock as Clock
    from palpate.messages.types.catalogue import LogRecord as LogRecord
    from palpate.messages.types.catalogue import NodeStatus as NodeStatus
    from palpate.messages.types.model import ModelGoal as ModelGoal
    from palpate.messages.types.model import PlanDone as PlanDone
    from palpate.messages.types.model import PlanEstimate as PlanEstimate
    from palpate.messages.types.model import Score as Score
    from palpate.messages.types.model import ShapeModel as ShapeModel
    from palpate.messages.types.model import Superquadric as Superquadric
    from palpate.messages.types.motion import Contour as Contour
    from palpate.messages.types.motion import ContourGoal as ContourGoal
    from palpate.messages.types.motion import FingerClock as FingerClock
    from palpate.messages.types.motion import GraspContacts as GraspContacts
    from palpate.messages.types.motion import GraspGoal as GraspGoal
    from palpate.messages.types.motion import Probe as Probe
    from palpate.messages.types.motion import ProbeGoal as ProbeGoal
    from palpate.messages.types.motion import TouchGoal as TouchGoal
    from palpate.messages.types.procedure import BoundaryRepresentation as BoundaryRepresentation
    from palpate.messages.types.procedure import ConePose as ConePose
    from palpate.messages.types.procedure import GeneralisedCone as GeneralisedCone
    from palpate.messages.types.procedure import Openings as Openings
    from palpate.messages.types.procedure import ProcedureResult as ProcedureResult
    from palpate.messages.types.touch import SurfacePatch as SurfacePatch
    from palpate.messages.types.touch import TactileFrame as TactileFrame
    from palpate.messages.types.touch import TactileImage as TactileImage
    from palpate.messages.types.world import SensorInfo as SensorInfo
    from palpate.messages.types.world import SpaceMap as SpaceMap
    from palpate.messages.types.world import Truth as Truth
    from palpate.messages.types.world import World as World
else:
    __getattr__, __dir__ = lazy(__name__)
