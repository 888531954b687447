"""``palpate calibrate``."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.launch.files.source_map import InputError
from palpate.tools.cli.command_line import (
    JSON,
    complete_scene,
    out_option,
    print_figures,
    progress_printer,
    quiet_option,
)


@click.command("calibrate", short_help="Calibrate a sensor by pressing a known flat and ball.")
@click.argument("scene", shell_complete=complete_scene)
@out_option("Write the calibration here, as YAML.")
@JSON
@quiet_option("Show no progress.")
def calibrate_command(scene: str, out: Path | None, as_json: bool, quiet: bool) -> int:
    """Press a known flat and a known ball with the sensor of SCENE, with its effects.

    Estimates the speed of sound, and gain and offset of each taxel, each with its standard
    error. A scene in the same folder reads the file: sensor: {calibration: FILE}.
    """
    from palpate.launch.files.file_access import check_new
    from palpate.launch.scene import load_scene, write_calibration
    from palpate.tools.calibration.calibrating import (
        calibrate,
        calibration_figures,
        calibration_text,
    )

    if out is not None:
        check_new(out)
    spec = load_scene(scene).spec
    try:
        calibrated = calibrate(spec, progress_printer(not quiet, "pressing     {}"))
    except ValueError as error:
        raise InputError(f"{scene}: cannot be calibrated: {error}") from None
    figures = calibration_figures(calibrated, spec.sensor)
    lines = [calibration_text(figures), *(f"{'warning':<13}{text}" for text in figures["warnings"])]
    if out is not None and not figures["warnings"]:
        write_calibration(out, calibrated.estimate, calibrated.pad)
        figures["written"] = str(out)
        lines.append(f"{'written':<13}{out}")
    elif out is not None:
        lines.append(f"{'not written':<13}{out}: see the warnings")
    print_figures(figures, "\n".join(lines), as_json=as_json)
    return 1 if figures["warnings"] else 0
