"""A run on disk for tests of whatever looks at one: a ball, felt with a little noise."""

from __future__ import annotations

from pathlib import Path

from palpate import launch
from palpate.launch.files import SourceMapped

SCENE = """
object: {superquadric: {size: [0.03, 0.03, 0.03], exponents: [1, 1]}}
effects:
  - gaussian_noise: {sigma: 5.0e-6}
"""
TOUCHES = 40


def make_run(folder: Path) -> Path:
    """Explore it in this process; returns the run directory."""
    scene = folder / "ball.yaml"
    scene.write_text(SCENE)
    args = {"scene": SourceMapped(str(scene), "")}
    settings = {"planner.most_touches": SourceMapped(TOUCHES, "")}
    plan = launch.plan_run(launch.EXPLORE, args, settings, name="ball", out=folder / "run")
    return launch.perform(plan, composed=True, display=launch.Display()).folder
