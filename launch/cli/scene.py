"""``palpate scene``: what there is to explore."""

from __future__ import annotations

from pathlib import Path

import click


@click.group("scene")
def command() -> None:
    """List and check scenes."""


@command.command("list")
def list_scenes() -> None:
    """Name the scenes that come with palpate."""
    from palpate.launch.scene import scene_title, shipped_scenes

    for name in shipped_scenes():
        click.echo(f"{name:<12} {scene_title(name)}")


@command.command("check")
@click.argument("scene")
def check(scene: str) -> None:
    """Say whether SCENE can be explored, how large its object is, and what is simulated."""
    from palpate.launch.launch_path import EXPLORE
    from palpate.launch.located import Located
    from palpate.launch.run import check_run
    from palpate.launch.scene import find_scene, object_size
    from palpate.launch.scene_report import simulated

    path = find_scene(scene)
    described, _ = check_run(EXPLORE, {"scene": Located(str(path), "")}, {}, Path("runs"))
    assert described.scene is not None
    size = " x ".join(f"{1000.0 * side:.1f}" for side in object_size(described.scene))
    click.echo(f"{path}: can be explored; the object measures {size} mm")
    click.echo(simulated(described.scene.spec))


@command.command("effects")
def effects() -> None:
    """Name the effects that a scene may list, their parameters, defaults and ranges."""
    from palpate.launch.scene_report import effects_known

    click.echo(effects_known())
