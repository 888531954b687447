"""``palpate replay``: the same nodes on the same messages must say the same."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.launch.located import InputError

HELP = """Run nodes on the recording BAG and compare what they say with what they had said.

BAG is a topics.mcap, or the folder of a run. What one of the nodes says now is what the others
hear; all else comes from the recording. A table tells what has changed, by topic and field.

Exits with 0 if all of it is identical, with 1 if not, or if a node fails. With --set the table is
what was asked for: then it exits with 1 only if a node fails.

With --from contour=12 or --from end, the exploration goes on from there, in a new run directory,
and comes to the solid of a run that was never interrupted. What was recorded is gone through
unheard; what acts on the world does nothing again.
"""


@click.command("replay", help=HELP)
@click.argument("bag", type=click.Path(path_type=Path))
@click.option("--nodes", default="", metavar="A,B", help="Nodes to run; all exact ones if none.")
@click.option("--set", "settings", multiple=True, metavar="NODE.PARAM=VALUE", help="Repeatable.")
@click.option("--from", "place", metavar="contour=N|end", help="Go on with the exploration.")
@click.option("--out", type=click.Path(path_type=Path), help="With --from: the run directory.")
@click.option("--json", "as_json", is_flag=True, help="With --from: print summary.json.")
@click.option("--quiet", is_flag=True, help="With --from: print nothing.")
def command(
    bag: Path,
    nodes: str,
    settings: tuple[str, ...],
    place: str | None,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Run nodes of a recording again; `HELP` says how."""
    names = tuple(name.strip() for name in nodes.split(",") if name.strip())
    if place is not None:
        if settings:
            raise InputError("--set and --from exclude each other: other parameters, other solid")
        return _go_on(bag, place, names, out, as_json=as_json, quiet=quiet)
    if out is not None or as_json or quiet:
        raise InputError("--out, --json and --quiet belong to --from")
    from palpate.launch.override import read_settings
    from palpate.launch.replay.again import replay

    try:
        return replay(bag, names, click.echo, settings=read_settings(settings))
    except ValueError as error:
        raise InputError(str(error)) from None


def _go_on(
    bag: Path, place: str, names: tuple[str, ...], out: Path | None, *, as_json: bool, quiet: bool
) -> int:
    from palpate.launch.cli.play import play
    from palpate.launch.replay.resume import plan_resume
    from palpate.launch.replay.same import other_past

    kind, _, number = place.partition("=")
    if place != "end" and not (kind == "contour" and number.isdecimal() and int(number) > 0):
        raise InputError(f"--from {place}: must look like contour=12, or be the word end")
    try:
        plan = plan_resume(bag, None if place == "end" else int(number), nodes=names, out=out)
    except ValueError as error:
        raise InputError(str(error)) from None
    code = play(plan, composed=False, as_json=as_json, quiet=quiet)
    different = other_past(bag, plan.folder.path) if code == 0 else ""
    if different:
        click.echo(f"palpate: {different}", err=True)
    return 1 if different else code
