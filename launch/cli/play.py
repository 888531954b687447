"""What ``run`` and ``launch`` share: from a plan to an exit code."""

from __future__ import annotations

import json

import click

from palpate.launch.display import open_display
from palpate.launch.run import Plan, perform


def play(plan: Plan, *, composed: bool, as_json: bool, quiet: bool) -> int:
    """Perform a plan and print what it came to; returns the exit code.

    Parameters
    ----------
    plan : Plan
        What to run.
    composed : bool
        All nodes in this process.
    as_json : bool
        Print ``summary.json`` to standard output instead of a text.
    quiet : bool
        Print nothing but what was asked for by `as_json`.
    """
    done = perform(plan, composed=composed, display=open_display(quiet=quiet or as_json))
    if as_json:
        click.echo(json.dumps(done.summary, indent=2, allow_nan=False))
    elif not quiet:
        click.echo(done.text)
    elif done.exit_code != 0:
        click.echo(f"palpate: {done.ending.status}: {done.ending.reason}", err=True)
    return done.exit_code
