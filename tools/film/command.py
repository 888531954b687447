"""``palpate film``."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.tools.cli.command_line import (
    RUN_PATH,
    out_option,
    progress_printer,
    quiet_option,
)


@click.command("film", short_help="Draw a run as a film.")
@click.argument("run", **RUN_PATH)
@out_option("The film: .mp4, for which ffmpeg must be installed, or .gif.", required=True)
@click.option(
    "--seconds", type=click.FloatRange(1.0, 600.0), default=20.0, show_default=True, help="Length."
)
@quiet_option("Show no progress.")
def film_command(run: Path, out: Path, seconds: float, quiet: bool) -> None:
    """Draw the exploration of RUN, a run directory or a recording, as a film.

    The finger, contours, and the solid as it grows; beside them the tactile image, and error and
    bound against robot time. At the end the solid turns, coloured by its distance from the truth
    where that is known, or else by its stated uncertainty. Needs no screen.
    """
    from palpate.tools.film.film import make_film
    from palpate.tools.view.timeline import read_timeline

    say = progress_printer(not quiet, "drawing      {}")
    make_film(read_timeline(run), out, seconds=seconds, say=say)
    click.echo(f"{out}: written")
