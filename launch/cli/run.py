"""``palpate run``: explore a scene."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("run")
@click.argument("scene", default="vase")
@click.option("--out", type=click.Path(path_type=Path), help="Run directory; new or empty.")
@click.option("--seed", type=click.IntRange(0, 1 << 53), help="Overrides the scene's seed.")
@click.option("--fingers", type=int, help="Fingers that explore at once, 1 to 8.")
@click.option("--set", "settings", multiple=True, metavar="NODE.PARAM=VALUE", help="Repeatable.")
@click.option("--composed", is_flag=True, help="All nodes in one process.")
@click.option("--no-record", is_flag=True, help="Do not keep the messages.")
@click.option("--json", "as_json", is_flag=True, help="Print summary.json.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def command(
    scene: str,
    out: Path | None,
    seed: int | None,
    fingers: int | None,
    settings: tuple[str, ...],
    composed: bool,
    no_record: bool,
    as_json: bool,
    quiet: bool,
) -> int:
    """Explore SCENE, a shipped scene's name or a YAML file, and rebuild its object."""
    from palpate.launch.early_start import wake_server
    from palpate.launch.launch_path import EXPLORE

    if not composed:
        wake_server(EXPLORE)
    from palpate.launch.cli.play import play
    from palpate.launch.located import Located
    from palpate.launch.override import read_settings
    from palpate.launch.run import plan_run
    from palpate.launch.scene import find_scene

    path = find_scene(scene)
    args = {"scene": Located(str(path), ""), "record": Located(not no_record, "--no-record")}
    if seed is not None:
        args["seed"] = Located(seed, "--seed")
    if fingers is not None:
        args["fingers"] = Located(fingers, "--fingers")
    plan = plan_run(EXPLORE, args, read_settings(settings), name=path.stem, out=out)
    return play(plan, composed=composed, as_json=as_json, quiet=quiet)
