"""Feels an unknown object with a simulated fingertip and rebuilds it as a solid."""

from palpate.rooms import TYPE_CHECKING, lazy

__version__ = "0.1.0"

if TYPE_CHECKING:
    from palpate import effects as effects, geometry as geometry, planning as planning
    from palpate import procedures as procedures, rebuild as rebuild, shapes as shapes
    from palpate import splines as splines, testing as testing, thesis as thesis, touch as touch
    from palpate.core.rebuild import GeneralSolid as GeneralSolid, Solid as Solid
    from palpate.core.rebuild import rebuild_general as rebuild_general, reconstruct as reconstruct
    from palpate.core.rebuild.contours import ContactPoints as ContactPoints
    from palpate.core.touch import surface_patch as surface_patch
    from palpate.launch import Run as Run, Scene as Scene
    from palpate.launch import load_scene as load_scene
    from palpate.launch.files import load as load, save as save
    from palpate.nodes.specs import read_frames as read_frames
    from palpate.tools.bag import open_recording as open_recording
    from palpate.tools.exploration import explore as explore
else:
    __getattr__, __dir__ = lazy(__name__)
