"""A group of verbs that imports a verb only when it is called, and knows what was meant."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module

import click

from palpate.launch.nearest import hint


class Verbs(click.Group):
    """Verbs by name, each with its help in one line; ``command`` of a module is the verb."""

    def __init__(self, name: str, home: str, verbs: Mapping[str, str], help: str) -> None:
        super().__init__(name, help=help)
        self._home = home
        self._verbs = verbs

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the verbs."""
        return list(self._verbs)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The verb of a name."""
        if cmd_name not in self._verbs:
            return None
        command: click.Command = import_module(f"{self._home}.{cmd_name}").command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The verb that the arguments begin with."""
        if args[0] not in self._verbs and not args[0].startswith("-"):
            raise click.UsageError(
                f"there is no verb {args[0]!r}; {hint(args[0], self._verbs)}", ctx
            )
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the verbs without importing them."""
        with formatter.section("Verbs"):
            formatter.write_dl(list(self._verbs.items()))
