"""Verbs on a running graph: node, param and doctor, and what topic shares with them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from palpate.launch.files import InputError
from palpate.tools.cli.command_line import NamedGroup

if TYPE_CHECKING:
    from palpate.launch.processes import RunCard

node_group = NamedGroup(
    "node", help="Look at the nodes of a running graph, or at the kinds of node."
)
param_group = NamedGroup("param", help="Look at the parameters of a running graph's nodes.")
Command = Callable[..., Any]


def run_option(command: Command) -> Command:
    """The option that says which running graph is meant."""
    return click.option(
        "--run",
        "run",
        metavar="ID",
        help="Beginning of the run's number, or its name; the latest if left out.",
    )(command)


@node_group.command("list", short_help="Name the nodes of a running graph.")
@run_option
@click.option("-a", "--all", "every", is_flag=True, help="Also nodes that have ended.")
def node_list_command(run: str | None, every: bool) -> None:
    """Name the nodes of the running graph."""
    from palpate.tools.introspection import running_nodes

    card = card_of(run)
    with as_input_errors():
        names = sorted(one.name for one in card.nodes) if every else running_nodes(card)
    for name in names:
        click.echo(name)


@node_group.command("info", short_help="Say how a running node is doing, what it hears and says.")
@click.argument("node")
@run_option
def node_info_command(node: str, run: str | None) -> None:
    """Say how NODE is doing, what it hears from whom and says to whom, and its parameters."""
    from palpate.tools.introspection import node_text

    with as_input_errors():
        click.echo(node_text(card_of(run), node))


@node_group.command("kinds", short_help="List the kinds of node and what they hear and say.")
@click.argument("kind", required=False)
def node_kinds_command(kind: str | None) -> None:
    """Name the kinds of node; of one KIND, say what it hears and says, and its parameters."""
    from palpate.launch import describe_kind, list_kinds

    for line in list_kinds() if kind is None else [describe_kind(kind)]:
        click.echo(line)


@param_group.command("dump", short_help="Print parameters in YAML.")
@click.argument("node", required=False)
@run_option
def param_dump_command(node: str | None, run: str | None) -> None:
    """Print the parameters of NODE, or of all nodes, in YAML; bytes by their size and SHA-256."""
    from palpate.tools.introspection import dump_params

    with as_input_errors():
        click.echo(dump_params(card_of(run), node))


@click.command("doctor")
@click.option("-r", "--report", is_flag=True, help="Add versions, environment and graphs.")
def doctor_command(report: bool) -> int:
    """Look at machine, installation and running graphs, and say what to do.

    Exits with 1 if anything fails.
    """
    from palpate.launch.processes import running_graphs
    from palpate.tools.introspection import graphs_findings, machine_findings, report_lines

    cards, failed = running_graphs(), False
    for look in (machine_findings(), graphs_findings(cards)):
        for finding in look:
            failed = failed or finding.level == "FAIL"
            click.echo(str(finding))
    for line in report_lines(cards) if report else ():
        click.echo(line)
    return int(failed)


@contextmanager
def as_input_errors() -> Iterator[None]:
    """What cannot be done is one sentence for the user."""
    try:
        yield
    except ValueError as error:
        raise InputError(str(error)) from None


def card_of(run: str | None) -> RunCard:
    """The running graph that is meant; says which, if several run and none is named.

    Raises
    ------
    InputError
        If there is none, or several are meant.
    """
    from palpate.launch.processes import find_run, running_graphs

    with as_input_errors():
        card = find_run(run)
    others = len(running_graphs()) - 1
    if run is None and others > 0:
        print_aside(f"{others + 1} graphs run; this is the latest, {card.run[:6]} ({card.name})")
    return card


def print_aside(text: str) -> None:
    """Say something beside the output."""
    click.echo(f"palpate: {text}", err=True)
