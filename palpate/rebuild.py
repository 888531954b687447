"""Solids from contours and contact points, and superquadrics from contacts: see docs/rebuild.md."""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.rebuild import Method as Method
    from palpate.core.rebuild import Solid as Solid
    from palpate.core.rebuild import reconstruct as reconstruct
    from palpate.core.rebuild.contours import ContactPoints as ContactPoints
    from palpate.core.rebuild.recovery import Recovery as Recovery
    from palpate.core.rebuild.recovery import recover as recover
else:
    __getattr__, __dir__ = lazy(__name__)
