"""``palpate host`` and ``palpate keys``."""

from __future__ import annotations

import click

from palpate.launch.files.source_map import InputError, as_input_errors


@click.command("host", short_help="Lend this machine to graphs that are launched elsewhere.")
@click.argument("address")
def host_command(address: str) -> None:
    """Lend this machine at its ADDRESS, 192.168.1.5 or 192.168.1.5:7447, until Ctrl-C.

    Only launchers with the same key (palpate keys) can run nodes, which are programs, here. A
    launch file names the machine with host: ADDRESS.
    """
    from palpate.launch.hosts.addresses import key_file, read_host
    from palpate.launch.hosts.agent import run_host_agent

    where, port = read_host(address)
    with as_input_errors():
        run_host_agent(where, port, key_file(), click.echo)


@click.command("keys", short_help="Make the key that the machines of a graph share.")
def keys_command() -> None:
    """Make the key that the machines of a graph share.

    Copy it to the same place on the other machines, readable only by you.
    """
    from palpate.launch.hosts.addresses import key_file
    from palpate.messages.bus import make_key

    path = key_file()
    try:
        make_key(path)
    except FileExistsError as error:
        raise InputError(str(error)) from None
    click.echo(f"{path}: written; copy it to the other machines, to the same place and mode")
