"""The command line ``palpate``: its commands, common options, and all its error messages.

A failure ends in one sentence on standard error and an exit code; a traceback is written to a file,
never to the screen. The module of a command is imported when it is called.
"""

from __future__ import annotations

import errno
import io
import json
import os
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click
from click.shell_completion import CompletionItem, get_completion_class

from palpate import __version__
from palpate.core.plugins import entry_points_of
from palpate.launch.files.source_map import InputError, hint
from palpate.launch.files.units import METRES_PER_UNIT
from palpate.preloading import THREAD_VARIABLES, open_closed_streams

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

COMMANDS = "palpate.commands"  # entry points of further commands
DONE, BAD_INPUT, DIED, INTERRUPTED = 0, 2, 3, 130  # exit codes
HELP_OPTIONS = ["-h", "--help"]
Command = Callable[..., Any]
COMPLETE_VARIABLE = (
    "_PALPATE_COMPLETE"  # environment variable by which a shell requests completions
)
RUNS = Path("runs")  # as in `palpate.launch`, which is slow to import


def completing(
    names: Callable[[click.Context, str], Iterable[str]], *, files: bool = False
) -> Callable[[click.Context, click.Parameter, str], list[CompletionItem]]:
    """Completion of an argument by names that begin with it, or else by `files`."""

    def complete(
        context: click.Context, _: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        fitting = [name for name in names(context, incomplete) if name.startswith(incomplete)]
        fallback = [CompletionItem(incomplete, type="file")] if files else []
        return [*map(CompletionItem, fitting)] or fallback

    return complete


def _scenes(_: click.Context, incomplete: str) -> Iterable[str]:
    """Shipped scenes, and files of scenes in the folder that was typed."""
    from palpate.launch.files.mesh_file import is_mesh_file
    from palpate.launch.scene import shipped_scenes

    folder = incomplete[: incomplete.rfind("/") + 1]
    files = sorted(path for path in Path(folder).glob("*") if path.is_file())
    yield from shipped_scenes()
    for path in files:
        if path.suffix in (".yaml", ".yml") or is_mesh_file(path):
            yield folder + path.name


def _runs(_: click.Context, __: str) -> list[str]:
    """Run directories, the latest first."""
    return sorted((str(path) for path in RUNS.glob("*") if path.is_dir()), reverse=True)


def _graphs(_: click.Context, __: str) -> Iterable[str]:
    from palpate.launch.processes.registry import running_graphs

    return [name for card in running_graphs() for name in (card.run[:6], card.name)]


def _nodes(context: click.Context, _: str) -> Iterable[str]:
    from palpate.launch.processes.registry import find_run

    return sorted(node.name for node in find_run(context.params.get("run")).nodes)


def _topics(context: click.Context, _: str) -> Iterable[str]:
    from palpate.launch.processes.registry import find_run
    from palpate.tools.introspection.topics import topics_of

    return topics_of(find_run(context.params.get("run")))


def _located_run(_: click.Context, __: click.Parameter, path: Path | None) -> Path | None:
    if path is None or path.exists():  # the usual case, without an import
        return path
    from palpate.launch.run_directory import find_run_path

    return find_run_path(path)


# Arguments and options of several commands.
PATH = click.Path(path_type=Path)
complete_scene = completing(_scenes, files=True)
complete_topic, complete_node = completing(_topics), completing(_nodes)
TOPIC = click.argument("topic", shell_complete=complete_topic)
NODE = click.argument("node", shell_complete=complete_node)
OPTIONAL_NODE = click.argument("node", required=False, shell_complete=complete_node)
# Settings of an argument that is a run: its directory, its recording, or a running graph.
RUN_PATH: dict[str, Any] = {
    "type": PATH,
    "callback": _located_run,
    "shell_complete": completing(_runs, files=True),
}
RUN_PATHS = {  # of several runs
    **RUN_PATH,
    "nargs": -1,
    "required": True,
    "callback": lambda context, option, paths: tuple(
        _located_run(context, option, p) for p in paths
    ),
}
BAG = click.argument("bag", **RUN_PATH)
SEED = click.IntRange(0, 1 << 53)  # integers that JSON and YAML readers keep exactly
SETTINGS = click.option(
    "--set", "settings", multiple=True, metavar="NODE.PARAM=VALUE", help="Repeatable."
)
REALTIME = click.option(
    "--realtime", is_flag=True, help="Robot time passes as fast as the clock, for watching."
)
COMPOSED = click.option("--composed", is_flag=True, help="All nodes in one process.")
RUN = click.option(
    "--run",
    metavar="ID",
    shell_complete=completing(_graphs),
    help="The graph: the beginning of its number, its name or directory. Default: the graph that "
    "PALPATE_GRAPH names, or that of this folder, or the only one.",
)
JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
UNTRUSTED = click.option(
    "--untrusted",
    is_flag=True,
    help="Refuse a scene that names a program, or files outside its folder.",
)
SIZE = click.option(
    "--size", metavar="LENGTH", help="Largest extent of a mesh, instead of a unit: 120mm."
)
VIEW = click.option("--view", is_flag=True, help="Show the run in the browser: palpate view.")
VERBOSE = click.option("--verbose", is_flag=True, help="Print all figures, and the result last.")


def unit_option(help: str, name: str = "--unit") -> Callable[[Command], Command]:
    """An option for a unit of length."""
    return click.option(name, type=click.Choice(list(METRES_PER_UNIT)), help=help)


def out_option(help: str, **settings: Any) -> Callable[[Command], Command]:
    """The option for the path of the output."""
    return click.option("-o", "--out", help=help, **{"type": PATH, **settings})


def quiet_option(help: str = "Print nothing.") -> Callable[[Command], Command]:
    """The option to print less."""
    return click.option("--quiet", is_flag=True, help=help)


def names_option(flag: str, help: str) -> Callable[[Command], Command]:
    """A repeatable option for names, separated by commas."""
    return click.option(
        flag,
        metavar="A,B",
        multiple=True,
        help=f"{help} Repeatable.",
        callback=lambda _, __, texts: tuple(
            name for text in texts for name in map(str.strip, text.split(",")) if name
        ),
    )


def picture_option(flag: str, help: str) -> Callable[[Command], Command]:
    """The option to draw, into a file or, without one, to standard output."""
    path = click.Path(path_type=Path, allow_dash=True)
    return click.option(
        flag, "picture", help=help, type=path, is_flag=False, flag_value="-", metavar="[OUT.svg]"
    )


RUN_FOLDER = out_option("Run directory; new or empty.")
TOPICS = names_option("--topics", "Only these topics.")


def print_figures(figures: Any, text: str, *, as_json: bool) -> None:
    """Print figures as JSON, or as text."""
    click.echo(json.dumps(figures, indent=2, allow_nan=False) if as_json else text)


def progress_printer(shown: bool, form: str = "{}") -> Callable[[str], None]:
    """Function that prints progress on standard error, or nothing unless `shown`."""
    return lambda text: click.echo(form.format(text), err=True) if shown else None


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line, without the name of the program, and exit."""
    _prepare_streams()
    # Idle threads of linear algebra wait in a busy loop, which took 10 % of a run's processor time.
    for name in THREAD_VARIABLES:
        os.environ.setdefault(name, "1")
    if COMPLETE_VARIABLE in os.environ:
        sys.exit(answer_shell())
    code = run(sys.argv[1:] if arguments is None else arguments)
    _drop_refused_output()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # nothing is left to interrupt
    sys.exit(code)


def _prepare_streams() -> None:
    """Make the standard streams usable, also if they are closed or broken.

    Characters outside the encoding are written as escapes. Output that standard error does not
    take is dropped, since it has no results.
    """
    open_closed_streams()
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout is sys.__stdout__:
        sys.stdout.reconfigure(errors="backslashreplace")
    if isinstance(sys.stderr, io.TextIOWrapper) and sys.stderr is sys.__stderr__:
        sys.stderr = io.TextIOWrapper(
            io.BufferedWriter(_LossyFile(sys.stderr.fileno(), "w", closefd=False)),
            encoding=sys.stderr.encoding,
            errors="backslashreplace",
            line_buffering=True,
        )


class _LossyFile(io.FileIO):
    """A file that drops what cannot be written to it."""

    def write(self, data: Any) -> int:
        """Write the bytes, or drop them; returns their number."""
        written = None
        with suppress(OSError):
            written = super().write(data)
        return len(data) if written is None else written


def _drop_refused_output() -> None:
    """Redirect a broken standard output to null, since Python flushes it at exit."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def answer_shell() -> int:
    """Answer a request of a shell; errors must not appear in the line that is being typed."""
    with suppress(Exception, SystemExit):
        palpate_group.main([], prog_name="palpate", standalone_mode=False)
    return DONE


def run(arguments: Sequence[str]) -> int:
    """Run the command of the arguments; returns the exit code."""
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
        # click exits with 1 if a pipe is closed while it writes.
        if error.code == 1:
            return DONE
        text = f"something in the program called exit({error.code}); nothing is done"
        return _print_error(text, DIED)
    except (KeyboardInterrupt, click.Abort):
        return _print_error("interrupted", INTERRUPTED)
    except BrokenPipeError:
        return DONE  # the reader closed the pipe, as in ``palpate node kinds | head -1``
    except OSError as error:
        text = f"{error.filename or 'the system'}: {error.strerror or error}"
        if error.errno == errno.EMFILE:
            text = "the system allows too few open files: raise their number with ulimit -n 256"
        return _print_error(text, BAD_INPUT)
    except UnicodeEncodeError as error:
        context = error.object[max(0, error.start - 80) : error.end + 80]
        text = f"{context!r} is no text in {error.encoding}; give the file or folder another name"
        return _print_error(text, BAD_INPUT)
    except Exception as error:  # a traceback must not reach the screen
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
    text = "".join(traceback.format_exception(error)).encode(errors="backslashreplace")
    try:
        with tempfile.NamedTemporaryFile(prefix="palpate-", suffix=".txt", delete=False) as file:
            file.write(text)
        where = f"is in {file.name}"
    except OSError as fault:
        where = f"could not be written: {fault.strerror}"
    return f"a bug: {type(error).__name__}: {error!s:.200}; the traceback {where}"


class NamedGroup(click.Group):
    """Commands in the order of their definition, with a hint for a mistyped one."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the commands."""
        return list(self.commands)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that the arguments begin with."""
        names = self.list_commands(ctx)
        if args[0] not in names and not args[0].startswith("-"):
            raise click.UsageError(f"there is no command {args[0]!r}; {hint(args[0], names)}", ctx)
        return super().resolve_command(ctx, args)


class LazyGroup(NamedGroup):
    """Commands that are imported when they are called.

    `verbs`: the module of each, relative to this package, and its help in one line.
    """

    def __init__(self, name: str, verbs: Mapping[str, tuple[str, str]], help: str) -> None:
        # Subcommands inherit the names of the help option.
        super().__init__(name, help=help, context_settings={"help_option_names": HELP_OPTIONS})
        self._verbs = verbs

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the commands."""
        return [*self._verbs, *sorted(self._added)]

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that the arguments begin with; entry points are read if it is not our own."""
        own = args[0] in self._verbs
        return (click.Group if own else NamedGroup).resolve_command(self, ctx, args)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """A command by name."""
        if cmd_name in self._verbs:
            module = import_module(f".{self._verbs[cmd_name][0]}", __package__)
            command: click.Command | None = getattr(module, f"{cmd_name}_command", None)
            return command or getattr(module, f"{cmd_name}_group")
        if cmd_name in self._added:
            added: click.Command = self._added[cmd_name].load()
            return added
        return None

    @cached_property
    def _added(self) -> Mapping[str, EntryPoint]:
        """Commands of optional parts, and of other packages."""
        return entry_points_of(COMMANDS)

    def _helps(self, ctx: click.Context) -> list[tuple[str, str]]:
        own = [(verb, text) for verb, (_, text) in self._verbs.items()]
        added = [(verb, self.get_command(ctx, verb)) for verb in sorted(self._added)]
        return [*own, *((verb, some.get_short_help_str(70)) for verb, some in added if some)]

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands."""
        with formatter.section("Commands"):
            formatter.write_dl(self._helps(ctx))

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Completions of the name of a command, or of an option."""
        helps = self._helps(ctx)
        names = [CompletionItem(verb, help=t) for verb, t in helps if verb.startswith(incomplete)]
        return [*names, *click.Command.shell_complete(self, ctx, incomplete)]


def print_script(context: click.Context, _: click.Parameter, shell: str | None) -> None:
    """Print the completion script of a shell, and exit."""
    if shell is not None and not context.resilient_parsing:
        kind = get_completion_class(shell)
        assert kind is not None
        click.echo(kind(context.command, {}, "palpate", COMPLETE_VARIABLE).source())
        context.exit()


palpate_group = LazyGroup(
    "palpate",
    {
        "run": ("launching", "Explore a scene and rebuild its object."),
        "view": ("looking", "Show a run in the browser, as it runs or from its recording."),
        "launch": ("launching", "Start the graph of a launch file."),
        "replay": ("launching", "Run nodes on a recording and compare what they publish."),
        "bag": ("recordings", "Look into recordings; record, play, recover, compare and export."),
        "scene": ("solids", "List and check scenes."),
        "node": ("running_graph", "Look at the nodes of a running graph, and at all kinds."),
        "topic": ("running_graph", "Receive and publish on the topics of a running graph."),
        "interface": ("running_graph", "Look at the types of messages."),
        "param": ("running_graph", "Look at the parameters of a running graph's nodes."),
        "doctor": ("running_graph", "Check the machine, the installation and running graphs."),
        "init": ("solids", "Create a node, driver, filter, effect or planner."),
        "rebuild": ("solids", "Rebuild a solid from measured contours."),
        "report": ("looking", "Write the report of a run, or of two side by side."),
        "score": ("solids", "Measure a solid against a CAD model or measured points."),
        "export": ("solids", "Write the solid of a run as PLY, STL, 3MF, GLB or OBJ."),
        "cost": ("recordings", "Compute the time of a recorded run with other robots."),
        "bench": ("..bench.suite", "Measure the cost of accuracy, against other methods."),
    },
    "Touches an unknown object with a simulated fingertip and rebuilds its shape.",
)
click.version_option(__version__, prog_name="palpate")(palpate_group)
click.option(
    "--completion",
    type=click.Choice(["bash", "zsh", "fish"]),
    is_eager=True,
    expose_value=False,
    callback=print_script,
    help="Print the completion script of a shell.",
)(palpate_group)
