"""Solids from contours and contact points, and superquadrics from contacts: see docs/rebuild.md."""

from palpate.core.rebuild import (
    GeneralSolid as GeneralSolid,
    LatticeSolid as LatticeSolid,
    MeshSolid as MeshSolid,
    Method as Method,
    Solid as Solid,
    SolidCheck as SolidCheck,
    SolidMeasures as SolidMeasures,
    reconstruct as reconstruct,
)
from palpate.core.rebuild.contours import ContactPoints as ContactPoints
from palpate.core.rebuild.recovery import Recovery as Recovery, recover as recover
