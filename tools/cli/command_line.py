"""``palpate``: the outermost boundary between the program and whoever calls it, and its verbs.

Every failure leaves here as one sentence on standard error and an exit code; a traceback is
written to a file, never to the screen. A verb is imported only when it is called.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

import click

from palpate import __version__
from palpate.launch.files import InputError, hint
from palpate.nodes.runtime import THREAD_VARIABLES

DONE, BAD_INPUT, DIED, INTERRUPTED = 0, 2, 3, 130
HELP_OPTIONS = ["-h", "--help"]
Command = Callable[..., Any]
# What several verbs take.
PATH = click.Path(path_type=Path)
BAG = click.argument("bag", type=PATH)
SEED = click.IntRange(0, 1 << 53)
SETTINGS = click.option(
    "--set", "settings", multiple=True, metavar="NODE.PARAM=VALUE", help="Repeatable."
)
REALTIME = click.option(
    "--realtime", is_flag=True, help="Robot time passes as fast as time, to watch and to speak to."
)
COMPOSED = click.option("--composed", is_flag=True, help="All nodes in one process.")
RUN_FOLDER = click.option("--out", type=PATH, help="Run directory; new or empty.")
RUN = click.option(
    "--run",
    metavar="ID",
    help="Beginning of the run's number, or its name; the latest if left out.",
)


def json_option(told: str = "Print the figures as JSON.") -> Callable[[Command], Command]:
    """The option to print for programs."""
    return click.option("--json", "as_json", is_flag=True, help=told)


def quiet_option(told: str = "Print nothing.") -> Callable[[Command], Command]:
    """The option to print less."""
    return click.option("--quiet", is_flag=True, help=told)


UNTRUSTED = click.option(
    "--untrusted",
    is_flag=True,
    help="Refuse a scene that names a program, or files outside its folder.",
)
VERBOSE = click.option("--verbose", is_flag=True, help="Print all figures, and the result last.")


def names_option(flag: str, metavar: str, told: str) -> Callable[[Command], Command]:
    """An option that takes names between commas."""
    return click.option(
        flag,
        metavar=metavar,
        help=told,
        default="",
        callback=lambda _, __, text: tuple(filter(None, map(str.strip, text.split(",")))),
    )


def print_figures(figures: Any, text: Callable[[Any], str], *, as_json: bool) -> None:
    """Print figures for a program, or as text for a person."""
    click.echo(json.dumps(figures, indent=2, allow_nan=False) if as_json else text(figures))


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Do what the command line, without the program's name, asks for, and exit."""
    # Idle threads of linear algebra wait in a loop, which took a tenth of a run's processor time.
    for name in THREAD_VARIABLES:
        os.environ.setdefault(name, "1")
    code = run(sys.argv[1:] if arguments is None else arguments)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # there is nothing left to interrupt
    sys.exit(code)


def run(arguments: Sequence[str]) -> int:
    """Do what the arguments ask for; returns the exit code."""
    try:
        code = palpate_group.main(list(arguments), prog_name="palpate", standalone_mode=False)
        sys.stdout.flush()
    except InputError as error:
        return _print_error(str(error), BAD_INPUT)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.ctx.get_help() if error.ctx else "", err=True)
        return BAD_INPUT
    except click.ClickException as error:
        return _print_error(_usage_text(error), BAD_INPUT)
    except SystemExit as error:
        # With 1 it is click's own answer to a pipe that was closed while it wrote.
        if error.code == 1:
            return DONE
        return _print_error(
            f"something in the program called exit({error.code}); nothing is done", DIED
        )
    except (KeyboardInterrupt, click.Abort):
        return _print_error("interrupted", INTERRUPTED)
    except BrokenPipeError:
        # Whoever read our output has had enough, as in ``palpate node kinds | head -1``.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except OSError as error:
        return _print_error(
            f"{error.filename or 'the system'}: {error.strerror or error}", BAD_INPUT
        )
    except Exception as error:  # the outermost boundary: a bug must not reach the screen raw
        return _print_error(_bug_text(error), DIED)
    return code if isinstance(code, int) else DONE


def _print_error(text: str, code: int) -> int:
    print(f"palpate: {' '.join(text.split())}", file=sys.stderr)
    return code


def _usage_text(error: click.ClickException) -> str:
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else "palpate"
    return f"{error.format_message().rstrip('.')} (see {path} --help)"


def _bug_text(error: Exception) -> str:
    with tempfile.NamedTemporaryFile(
        "w", prefix="palpate-", suffix=".txt", delete=False, encoding="utf-8"
    ) as file:
        traceback.print_exception(error, file=file)
    return f"a bug: {type(error).__name__}: {error!s:.200}; the traceback is in {file.name}"


class NamedGroup(click.Group):
    """Verbs in the order in which they were defined; one that is mistyped is hinted at."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the verbs."""
        return list(self.commands)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The verb that the arguments begin with."""
        verbs = self.list_commands(ctx)
        if args[0] not in verbs and not args[0].startswith("-"):
            raise click.UsageError(f"there is no verb {args[0]!r}; {hint(args[0], verbs)}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the verbs."""
        with formatter.section("Verbs"):
            formatter.write_dl([(verb, self.in_short(verb)) for verb in self.list_commands(ctx)])

    def in_short(self, verb: str) -> str:
        """What a verb does, in one line."""
        return self.commands[verb].short_help or ""


class LazyGroup(NamedGroup):
    """Verbs by name: the module in which each stands, from here, and its help in one line."""

    def __init__(self, name: str, verbs: Mapping[str, tuple[str, str]], help: str) -> None:
        # What the outermost verb calls help, all within it do.
        super().__init__(name, help=help, context_settings={"help_option_names": HELP_OPTIONS})
        self._verbs = verbs

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the verbs."""
        return list(self._verbs)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The verb of a name."""
        if cmd_name not in self._verbs:
            return None
        module = import_module(f".{self._verbs[cmd_name][0]}", __package__)
        command: click.Command | None = getattr(module, f"{cmd_name}_command", None)
        return command or getattr(module, f"{cmd_name}_group")

    def in_short(self, verb: str) -> str:
        """What a verb does, in one line; nothing is imported."""
        return self._verbs[verb][1]


palpate_group = LazyGroup(
    "palpate",
    {
        "run": ("launching", "Explore a scene and rebuild its object."),
        "sweep": ("launching", "Explore with many parameters, and draw what accuracy costs."),
        "launch": ("launching", "Start the graph of a launch file."),
        "host": ("launching", "Lend this machine to graphs that are launched elsewhere."),
        "keys": ("launching", "Make the key that the machines of a graph share."),
        "replay": ("launching", "Run nodes on a recording and compare what they publish."),
        "bag": (
            "recordings",
            "Look into recordings, play, recover and compare them, and hand them on.",
        ),
        "scene": ("solids", "List and check scenes."),
        "node": ("running_graph", "Look at the nodes of a running graph, or at the kinds of node."),
        "topic": ("running_graph", "Receive and publish on the topics of a running graph."),
        "interface": ("running_graph", "Look at the types of messages."),
        "param": ("running_graph", "Look at the parameters of a running graph's nodes."),
        "doctor": (
            "running_graph",
            "Say whether machine, installation and running graphs are well.",
        ),
        "init": ("solids", "Begin a node, a driver, an effect or a planner of your own."),
        "calibrate": ("solids", "Press a known flat and ball, and say what each taxel means."),
        "rebuild": ("solids", "Rebuild a solid from contours that anybody measured."),
        "score": ("solids", "Measure a solid against a CAD model or measured points."),
        "recognise": ("solids", "Say which of the stored objects a run has touched, or none."),
        "cost": ("recordings", "Say what a recorded run would have cost another robot."),
        "bench": ("..bench.suite", "Measure speed and accuracy."),
        "chaos": ("launching", "Put faults into explorations and say what they survive."),
    },
    "Touches an unknown object with a simulated fingertip and rebuilds it as a solid.",
)
click.version_option(__version__, prog_name="palpate")(palpate_group)
