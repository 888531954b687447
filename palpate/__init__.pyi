from . import (
    effects as effects,
    geometry as geometry,
    planning as planning,
    procedures as procedures,
    rebuild as rebuild,
    shapes as shapes,
    splines as splines,
    testing as testing,
    thesis as thesis,
    touch as touch,
)
from .core.rebuild import (
    GeneralSolid as GeneralSolid,
    LatticeSolid as LatticeSolid,
    MeshSolid as MeshSolid,
    Solid as Solid,
    rebuild_general as rebuild_general,
    reconstruct as reconstruct,
)
from .core.rebuild.contours import ContactPoints as ContactPoints
from .core.touch import surface_patch as surface_patch
from .launch.files.solid_file import load as load, save as save
from .launch.run import Run as Run, load_run as load_run
from .launch.scene import Scene as Scene, load_scene as load_scene
from .nodes.specs.frames import read_frames as read_frames
from .tools.bag.tables import open_recording as open_recording
from .tools.exploration import explore as explore

__version__: str
