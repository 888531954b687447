"""``palpate chaos``: explorations to which everything happens, and that come to the same end."""

from __future__ import annotations

import json

import click

HELP = """Put faults into running explorations of a scene, and say what they survive.

The scene is explored undisturbed first. Then it is explored again and again, while nodes are
killed and stopped, the recorder has no more room, a source floods it, tools join late and hang,
and the launcher is interrupted and killed. Each run must come to the same solid and the same
messages, and leave a recording that holds every message once; whoever is ended must leave nothing
behind, and go on from its recording to the same end.

\b
Kinds: kill, stop, recorder, full, neighbours, flood, late, ctrl_c, launcher.

Prints one line. Exits with 1 if anything did not survive; what it was, and the seed that repeats
it with --minutes 0, is on standard error. docs/chaos.md says more.
"""


@click.command("chaos", help=HELP)
@click.option("--seed", type=click.IntRange(0, 1 << 53), default=1, help="Of the first run.")
@click.option("--minutes", type=click.FloatRange(0), default=5.0, help="Begin no run after that.")
@click.option("--scene", default="vase", help="A shipped scene's name or a YAML file.")
@click.option("--fingers", type=click.IntRange(1, 8), default=1, help="Fingers that explore.")
@click.option("--kinds", metavar="A,B", help="Only these faults.")
@click.option("--json", "as_json", is_flag=True, help="Print all figures.")
def command(
    seed: int, minutes: float, scene: str, fingers: int, kinds: str | None, as_json: bool
) -> int:
    """Put faults into explorations; `HELP` says which."""
    from palpate.launch.chaos.campaign import campaign
    from palpate.launch.chaos.subject import Subject
    from palpate.launch.located import InputError
    from palpate.launch.scene import find_scene

    path = find_scene(scene).resolve()
    subject = Subject("explore", (f"scene:={path}", f"fingers:={fingers}"))
    try:
        tally = campaign(subject, seed=seed, minutes=minutes, kinds=_kinds(kinds), echo=_progress)
    except ValueError as error:
        raise InputError(str(error)) from None
    click.echo(json.dumps(tally.figures) if as_json else str(tally))
    for failed, what in tally.failed:
        click.echo(f"palpate: chaos --seed {failed} --minutes 0: {what}", err=True)
    return 1 if tally.failed else 0


def _kinds(text: str | None) -> tuple[str, ...]:
    from palpate.launch.chaos.faults import KINDS
    from palpate.launch.located import InputError
    from palpate.launch.nearest import hint

    named = KINDS if text is None else tuple(one.strip() for one in text.split(",") if one.strip())
    unknown = [one for one in named if one not in KINDS]
    if unknown or not named:
        raise InputError(
            f"--kinds {text}: there is no {unknown[0]!r}; {hint(unknown[0], KINDS)}"
            if unknown
            else f"--kinds names none; there are {', '.join(KINDS)}"
        )
    return named


def _progress(line: str) -> None:
    click.echo(line, err=True)
