"""``palpate init``: a beginning for something of your own."""

from __future__ import annotations

from pathlib import Path

import click


@click.group("init")
def command() -> None:
    """Begin something of your own from a working example."""


@command.command("effect")
@click.argument("name")
def effect(name: str) -> None:
    """Write NAME.py here: an effect that works, to be changed."""
    from palpate.launch.init_effect import init_effect

    path, listed = init_effect(name, Path())
    click.echo(f"{path}: written; list it in a scene, and start palpate in this folder:")
    click.echo(f"effects:\n  - {listed}")
