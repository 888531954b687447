"""Verbs before a run: scene, calibrate and init."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from palpate.tools.init import NodeFiles


@click.group("scene")
def scene_group() -> None:
    """List and check scenes."""


@scene_group.command("list")
def scene_list() -> None:
    """Name the scenes that come with palpate."""
    from palpate.launch import scene_title, shipped_scenes

    for name in shipped_scenes():
        click.echo(f"{name:<12} {scene_title(name)}")


@scene_group.command("check")
@click.argument("scene")
def scene_check(scene: str) -> None:
    """Say whether SCENE can be explored, how large its object is, and what is simulated."""
    from palpate.tools.report import check_scene

    click.echo(check_scene(scene))


@scene_group.command("effects")
def scene_effects() -> None:
    """Name the effects that a scene may list, their parameters, defaults and ranges."""
    from palpate.tools.report import effects_text

    click.echo(effects_text())


@click.command("calibrate")
@click.argument("scene")
@click.option("--out", type=click.Path(path_type=Path), help="Write the calibration here, as YAML.")
@click.option("--quiet", is_flag=True, help="No progress.")
def calibrate_command(scene: str, out: Path | None, quiet: bool) -> int:
    """Press a known flat and a known ball with the sensor of SCENE, with its effects.

    Estimates the speed of sound, and gain and offset of each taxel, each with its standard
    error. A scene in the same folder reads the file: sensor: {calibration: FILE}.
    """
    from palpate.launch import load_scene, write_calibration
    from palpate.launch.files import InputError, check_new
    from palpate.tools.calibration import calibrate, calibration_text, calibration_warnings

    if out is not None:
        check_new(out)
    spec = load_scene(scene).spec
    try:
        found = calibrate(spec, _print_nothing if quiet else _print_press)
    except ValueError as error:
        raise InputError(f"{scene}: cannot be calibrated: {error}") from None
    click.echo(calibration_text(found, spec.sensor))
    reasons = calibration_warnings(found)
    for reason in reasons:
        click.echo(f"{'warning':<13}{reason}")
    if out is not None and not reasons:
        write_calibration(out, found.estimate, found.pad)
        click.echo(f"{'written':<13}{out}")
    elif out is not None:
        click.echo(f"{'not written':<13}{out}: see the warnings")
    return 1 if reasons else 0


def _print_nothing(text: str) -> None:
    pass


def _print_press(text: str) -> None:
    click.echo(f"pressing     {text}", err=True)


@click.group("init")
def init_group() -> None:
    """Begin something of your own from a working example."""


@init_group.command("effect")
@click.argument("name")
def init_effect_command(name: str) -> None:
    """Write NAME.py here: an effect that works, to be changed."""
    from palpate.tools.init import init_effect

    path, listed = init_effect(name, Path())
    click.echo(f"{path}: written; list it in a scene, and start palpate in this folder:")
    click.echo(f"effects:\n  - {listed}")


@init_group.command("planner")
@click.argument("name")
def init_planner_command(name: str) -> None:
    """Write NAME.py and test_NAME.py here: a planner that works, to be changed."""
    from palpate.tools.init import init_planner

    path, test, named = init_planner(name, Path())
    click.echo(f"{path}: written, and what must hold of it: python -m pytest {test}")
    click.echo("name it in a scene, and start palpate in this folder:")
    click.echo(f"explore:\n  planner: {named}")


@init_group.command("node")
@click.argument("name")
def init_node_command(name: str) -> None:
    """Write NAME.py, test_NAME.py and NAME.yaml here: a node that works, to be changed."""
    from palpate.tools.init import init_node

    _print_begun(init_node(name, Path(), "node"), f"/{name}")


@init_group.command("driver")
@click.argument("name")
def init_driver_command(name: str) -> None:
    """Write NAME.py, test_NAME.py and NAME.yaml here: a driver for a sensor of your own."""
    from palpate.tools.init import init_node

    _print_begun(init_node(name, Path(), "driver"), "/touch/patch")


def _print_begun(begun: NodeFiles, topic: str) -> None:
    click.echo(f"{begun.module}, {begun.test}, {begun.launch}: written; in this folder")
    click.echo(f"  test it:    python -m pytest {begun.test}")
    click.echo(f"  launch it:  palpate launch {begun.launch}")
    click.echo(f"  look:       palpate topic echo {topic}")
