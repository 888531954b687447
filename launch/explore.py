"""Explore a scene from Python: what ``palpate run`` does, as a function."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from palpate.launch.display import open_display
from palpate.launch.early_start import wake_server
from palpate.launch.launch_path import EXPLORE
from palpate.launch.located import Located
from palpate.launch.run import Run, perform, plan_run
from palpate.launch.scene import find_scene


def explore(
    scene: str | Path = "vase",
    *,
    seed: int | None = None,
    fingers: int | None = None,
    settings: Mapping[str, Any] | None = None,
    out: str | Path | None = None,
    composed: bool = False,
    record: bool = True,
    quiet: bool = True,
) -> Run:
    """Feel the object of a scene and rebuild it.

    Parameters
    ----------
    scene : str or Path
        Name of a shipped scene, or path of a scene file.
    seed : int, optional
        Overrides the scene's seed.
    fingers : int, optional
        So many explore at once, 1 to 8; one if left out.
    settings : map, optional
        ``{"planner.tolerance": 0.1e-3}``: parameters of single nodes.
    out : str or Path, optional
        The run directory; a new one in ``runs/`` if left out.
    composed : bool
        All nodes in this process instead of one process each; the results are the same.
    record : bool
        Keep every message in ``topics.mcap``.
    quiet : bool
        Show no progress.

    Returns
    -------
    Run
        The figures, the last model, and where the files lie.

    Raises
    ------
    InputError
        If the scene or a setting cannot be used; nothing has been started.
    """
    path = find_scene(scene)
    if not composed:
        wake_server(EXPLORE)
    args = {"scene": Located(str(path), "scene"), "record": Located(record, "record")}
    if seed is not None:
        args["seed"] = Located(seed, "seed")
    if fingers is not None:
        args["fingers"] = Located(fingers, "fingers")
    plan = plan_run(
        EXPLORE,
        args,
        {key: Located(value, key) for key, value in (settings or {}).items()},
        name=path.stem,
        out=None if out is None else Path(out),
    )
    return perform(plan, composed=composed, display=open_display(quiet=quiet))
