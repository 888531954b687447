"""``palpate init``: a beginning for something of your own."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from palpate.launch.init_node import Begun


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


@command.command("planner")
@click.argument("name")
def planner(name: str) -> None:
    """Write NAME.py and test_NAME.py here: a planner that works, to be changed."""
    from palpate.launch.init_planner import init_planner

    path, test, named = init_planner(name, Path())
    click.echo(f"{path}: written, and what must hold of it: python -m pytest {test}")
    click.echo("name it in a scene, and start palpate in this folder:")
    click.echo(f"explore:\n  planner: {named}")


@command.command("node")
@click.argument("name")
def node(name: str) -> None:
    """Write NAME.py, test_NAME.py and NAME.yaml here: a node that works, to be changed."""
    from palpate.launch.init_node import init_node

    _tell(init_node(name, Path(), "node"), f"/{name}")


@command.command("driver")
@click.argument("name")
def driver(name: str) -> None:
    """Write NAME.py, test_NAME.py and NAME.yaml here: a driver for a sensor of your own."""
    from palpate.launch.init_node import init_node

    _tell(init_node(name, Path(), "driver"), "/touch/patch")


def _tell(begun: Begun, topic: str) -> None:
    click.echo(f"{begun.module}, {begun.test}, {begun.launch}: written; in this folder")
    click.echo(f"  test it:    python -m pytest {begun.test}")
    click.echo(f"  launch it:  palpate launch {begun.launch}")
    click.echo(f"  listen:     palpate topic echo {topic}")
