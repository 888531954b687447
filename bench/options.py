"""What single benches are asked besides what every bench is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import click

COSTS = ("touches", "robot", "compute")
FILE = click.Path(dir_okay=False, path_type=Path)
FOLDER = click.Path(file_okay=False, path_type=Path)
OPTIONS = (
    click.option(
        "--sheet",
        type=FOLDER,
        metavar="DIR",
        help="Runs and sheet go here; runs that are there are not made again. [bench-tolerance]",
    ),
    click.option("--cost", type=click.Choice(COSTS), help="Against which is drawn. [touches]"),
    click.option("--meshes", type=FOLDER, metavar="DIR", help="Explore the meshes in here, too."),
    click.option("--add", type=FILE, multiple=True, help="Runs of another method, as JSON."),
    click.option(
        "--method", multiple=True, metavar="MODULE:FUNCTION", help="Measure this method, too."
    ),
    click.option(
        "--against",
        type=FOLDER,
        metavar="DIR",
        help="An older checkout, with which scenes are run in turns.",
    ),
)


class BenchOptions(NamedTuple):
    """What is asked, by the names of the options."""

    sheet: Path | None = None
    cost: str | None = None
    meshes: Path | None = None
    add: tuple[Path, ...] = ()
    method: tuple[str, ...] = ()
    against: Path | None = None

    @property
    def names(self) -> list[str]:
        """Of those that were given."""
        return [name for name, value in self._asdict().items() if value]

    @property
    def given(self) -> str:
        """The same as they are written; empty if none was."""
        return ", ".join(f"--{name}" for name in self.names)


def bench_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options to a command."""
    for option in reversed(OPTIONS):
        command = option(command)
    return command
