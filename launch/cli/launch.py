"""``palpate launch``: start the graph of a launch file."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("launch")
@click.argument("file", type=click.Path(path_type=Path))
@click.argument("arguments", nargs=-1, metavar="[ARG:=VALUE]...")
@click.option("--show-args", "-s", is_flag=True, help="Print the arguments; start nothing.")
@click.option("--print", "-p", "only_print", is_flag=True, help="Print the wiring; start nothing.")
@click.option(
    "--graph",
    "picture",
    type=click.Path(path_type=Path, allow_dash=True),
    is_flag=False,
    flag_value="-",
    metavar="[OUT.svg]",
    help="Draw the wiring, to standard output if no file is named; start nothing.",
)
@click.option("--out", type=click.Path(path_type=Path), help="Run directory; new or empty.")
@click.option("--set", "settings", multiple=True, metavar="NODE.PARAM=VALUE", help="Repeatable.")
@click.option("--composed", is_flag=True, help="All nodes in one process.")
@click.option("--json", "as_json", is_flag=True, help="Print summary.json.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def command(
    file: Path,
    arguments: tuple[str, ...],
    show_args: bool,
    only_print: bool,
    picture: Path | None,
    out: Path | None,
    settings: tuple[str, ...],
    composed: bool,
    as_json: bool,
    quiet: bool,
) -> int:
    """Start the graph that FILE describes; explore.yaml is the one that comes with palpate."""
    from palpate.launch.early_start import wake_server
    from palpate.launch.launch_path import find_launch_file

    path = find_launch_file(file)
    if show_args:
        from palpate.launch.show_args import show_args as table_of

        click.echo(table_of(path))
        return 0
    if not (composed or only_print or picture):
        wake_server(path)
    from palpate.launch.cli.play import play
    from palpate.launch.override import read_arguments, read_settings
    from palpate.launch.run import check_run, plan_run

    args, given = read_arguments(arguments), read_settings(settings)
    if not (only_print or picture):
        plan = plan_run(path, args, given, name=path.stem, out=out)
        return play(plan, composed=composed, as_json=as_json, quiet=quiet)
    described, _ = check_run(path, args, given, out or Path("runs"))
    if only_print:
        click.echo(f"launch file {path}\n{described.graph.table()}")
    if picture:
        from palpate.launch.drawing.write import write_picture

        write_picture(described.graph, picture, f"Wiring of {path.name}")
    return 0
