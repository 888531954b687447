"""Whether a scene can be explored: all that a run would look at before it starts."""

from __future__ import annotations

from palpate.launch.launch_path import EXPLORE
from palpate.launch.located import Located
from palpate.launch.run import check_run
from palpate.launch.run_dir import RUNS
from palpate.launch.scene import find_scene
from palpate.launch.scene_report import simulated


def checked(scene: str) -> str:
    """That a scene can be explored, the size of its object, and what is simulated.

    Parameters
    ----------
    scene : str
        Path of a YAML file, or the name of a shipped scene.

    Raises
    ------
    InputError
        If it cannot be explored.
    """
    path = find_scene(scene)
    described, _ = check_run(EXPLORE, {"scene": Located(str(path), "")}, {}, RUNS)
    assert described.scene is not None
    size = " x ".join(f"{1000.0 * side:.1f}" for side in described.scene.size)
    said = f"{path}: can be explored; the object measures {size} mm"
    return f"{said}\n{simulated(described.scene.spec)}"
