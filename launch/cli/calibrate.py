"""``palpate calibrate``: what each taxel means."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("calibrate")
@click.argument("scene")
@click.option("--out", type=click.Path(path_type=Path), help="Write the calibration here, as YAML.")
@click.option("--quiet", is_flag=True, help="No progress.")
def command(scene: str, out: Path | None, quiet: bool) -> None:
    """Press a known flat and a known ball with the sensor of SCENE, with its effects.

    Estimates the speed of sound, and gain and offset of each taxel, each with its standard
    error. A scene in the same folder reads the file: sensor: {calibration: FILE}.
    """
    from palpate.launch.calibrate import calibrate
    from palpate.launch.calibrate_report import report
    from palpate.launch.calibration_file import write_calibration
    from palpate.launch.located import InputError
    from palpate.launch.scene import load_scene

    if out is not None and out.exists():
        raise InputError(f"{out}: is there already; choose another name")
    spec = load_scene(scene).spec
    try:
        found = calibrate(spec, _silent if quiet else _said)
    except ValueError as error:
        raise InputError(f"{scene}: cannot be calibrated: {error}") from None
    click.echo(report(found, spec.sensor))
    if out is not None:
        write_calibration(out, found.estimate, found.pad)
        click.echo(f"{'written':<13}{out}")


def _said(text: str) -> None:
    click.echo(f"pressing     {text}", err=True)


def _silent(text: str) -> None:
    pass
