"""``palpate keys``: the key that the machines of a graph share."""

from __future__ import annotations

import click

from palpate.launch.located import InputError


@click.command("keys")
def command() -> None:
    """Make the key that the machines of a graph share.

    Copy it to the same place on the other machines, readable by nobody but you.
    """
    from palpate.launch.hosts.addresses import key_file
    from palpate.messages.bus.curve import make_key

    path = key_file()
    try:
        make_key(path)
    except FileExistsError as error:
        raise InputError(str(error)) from None
    click.echo(f"{path}: written; copy it to the other machines, to the same place and mode")
