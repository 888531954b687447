"""``palpate host``: this machine runs nodes of graphs that are launched elsewhere."""

from __future__ import annotations

import click

from palpate.launch.located import InputError


@click.command("host")
@click.argument("address")
def command(address: str) -> None:
    """Lend this machine at its ADDRESS, 192.168.1.5 or 192.168.1.5:7447, until Ctrl-C.

    Whoever has the same key (palpate keys) may run nodes here, and nobody else: a node is a
    program. A launch file names the machine with host: ADDRESS.
    """
    from palpate.launch.hosts.addresses import key_file, read_host
    from palpate.launch.hosts.lender import lend

    where, port = read_host(address)
    try:
        lend(where, port, key_file(), lambda text: click.echo(text))
    except ValueError as error:
        raise InputError(str(error)) from None
