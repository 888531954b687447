"""What all verbs share that look at a running graph: which one, and how they refuse."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from palpate.launch.located import InputError

if TYPE_CHECKING:
    from palpate.launch.processes.register import Card

Command = Callable[..., Any]


def run_option(command: Command) -> Command:
    """The option that says which running graph is meant."""
    return click.option(
        "--run",
        "run",
        metavar="ID",
        help="Beginning of the run's number, or its name; the latest if left out.",
    )(command)


@contextmanager
def refusals() -> Iterator[None]:
    """What cannot be done is one sentence for the user."""
    try:
        yield
    except ValueError as error:
        raise InputError(str(error)) from None


def card_of(run: str | None) -> Card:
    """The running graph that is meant; says which, if several run and none is named.

    Raises
    ------
    InputError
        If there is none, or several are meant.
    """
    from palpate.launch.processes.register import find_run, running

    with refusals():
        card = find_run(run)
    others = len(running()) - 1
    if run is None and others > 0:
        tell(f"{others + 1} graphs run; this is the latest, {card.run[:6]} ({card.name})")
    return card


def tell(text: str) -> None:
    """Say something beside the output."""
    click.echo(f"palpate: {text}", err=True)
