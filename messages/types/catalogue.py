"""Every message type by its name, and which of them are latched."""

from __future__ import annotations

from palpate.messages.types.graph import Clock, LogRecord, NodeStatus
from palpate.messages.types.model import ModelGoal, PlanDone, Score, ShapeModel, Superquadric
from palpate.messages.types.motion import (
    Contour,
    ContourGoal,
    FingerClock,
    GraspContacts,
    GraspGoal,
    Probe,
    ProbeGoal,
    TouchGoal,
)
from palpate.messages.types.touch import SurfacePatch, TactileFrame, TactileImage
from palpate.messages.types.world import SensorInfo, Truth, World

TYPES: dict[str, type] = {
    cls.__name__: cls
    for cls in (
        Clock,
        Contour,
        ContourGoal,
        FingerClock,
        GraspContacts,
        GraspGoal,
        LogRecord,
        ModelGoal,
        NodeStatus,
        PlanDone,
        Probe,
        ProbeGoal,
        Score,
        SensorInfo,
        ShapeModel,
        Superquadric,
        SurfacePatch,
        TactileFrame,
        TactileImage,
        TouchGoal,
        Truth,
        World,
    )
}
ALL_KEPT = frozenset({Contour, Probe})  # Types of latched topics of which each message counts
# Types of latched topics: whoever comes late needs what was published before; of those
# that are not in `ALL_KEPT`, the last message
LATCHED = ALL_KEPT | {SensorInfo, ShapeModel, Superquadric, Truth, World}
