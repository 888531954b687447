"""``palpate scene``: what there is to explore."""

from __future__ import annotations

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
    from palpate.launch.scene_check import checked

    click.echo(checked(scene))


@command.command("effects")
def effects() -> None:
    """Name the effects that a scene may list, their parameters, defaults and ranges."""
    from palpate.launch.scene_report import effects_known

    click.echo(effects_known())
