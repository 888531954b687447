"""A run on disk for tests of whatever looks at one: a ball, felt with a little noise."""

from __future__ import annotations

from pathlib import Path

from palpate.launch.files.source_map import SourceMapped
from palpate.launch.launch_source import EXPLORE
from palpate.launch.progress import Display
from palpate.launch.run import perform, plan_run

SCENE = """
object: {superquadric: {size: [0.03, 0.03, 0.03], exponents: [1, 1]}}
effects:
  - gaussian_noise: {sigma: 5.0e-6}
"""
TOUCHES = 40


def make_run(folder: Path, *, composed: bool = True) -> Path:
    """Explore it, in this process or in one a node; returns the run directory."""
    scene = folder / "ball.yaml"
    scene.write_text(SCENE)
    args = {"scene": SourceMapped(str(scene), "")}
    settings = {"planner.most_touches": SourceMapped(TOUCHES, "")}
    plan = plan_run(EXPLORE, args, settings, name="ball", out=folder / "run")
    return perform(plan, composed=composed, display=Display()).folder
