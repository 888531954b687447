"""``palpate calibrate``: what each taxel means."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("calibrate")
@click.argument("scene")
@click.option("--out", type=click.Path(path_type=Path), help="Write the calibration here, as YAML.")
@click.option("--quiet", is_flag=True, help="No progress.")
def command(scene: str, out: Path | None, quiet: bool) -> int:
    """Press a known flat and a known ball with the sensor of SCENE, with its effects.

    Estimates the speed of sound, and gain and offset of each taxel, each with its standard
    error. A scene in the same folder reads the file: sensor: {calibration: FILE}.
    """
    from palpate.launch.calibrate import calibrate
    from palpate.launch.calibrate_report import doubts, report
    from palpate.launch.calibration_file import check_place, write_calibration
    from palpate.launch.located import InputError
    from palpate.launch.scene import load_scene

    if out is not None:
        check_place(out)
    spec = load_scene(scene).spec
    try:
        found = calibrate(spec, _silent if quiet else _said)
    except ValueError as error:
        raise InputError(f"{scene}: cannot be calibrated: {error}") from None
    click.echo(report(found, spec.sensor))
    reasons = doubts(found)
    for reason in reasons:
        click.echo(f"{'doubtful':<13}{reason}")
    if out is not None and not reasons:
        write_calibration(out, found.estimate, found.pad)
        click.echo(f"{'written':<13}{out}")
    elif out is not None:
        click.echo(f"{'not written':<13}{out}: see what is doubtful")
    return 1 if reasons else 0


def _said(text: str) -> None:
    click.echo(f"pressing     {text}", err=True)


def _silent(text: str) -> None:
    pass
