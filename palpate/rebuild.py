"""Solids from contours and contact points, and superquadrics from contacts: see docs/rebuild.md."""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.rebuild import GeneralSolid as GeneralSolid, LatticeSolid as LatticeSolid
    from palpate.core.rebuild import MeshSolid as MeshSolid, Method as Method, Solid as Solid
    from palpate.core.rebuild import SolidCheck as SolidCheck, SolidMeasures as SolidMeasures
    from palpate.core.rebuild import reconstruct as reconstruct
    from palpate.core.rebuild.contours import ContactPoints as ContactPoints
    from palpate.core.rebuild.recovery import Recovery as Recovery, recover as recover
else:
    __getattr__, __dir__ = lazy(__name__)
