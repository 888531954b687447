"""``palpate``: the outermost boundary between the program and whoever calls it.

Every failure leaves here as one sentence on standard error and an exit code; a traceback is
written to a file, never to the screen.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import traceback
from collections.abc import Sequence
from typing import NoReturn

import click

from palpate import __version__
from palpate.launch.cli.verbs import Verbs
from palpate.launch.located import InputError

DONE, BAD_INPUT, DIED, INTERRUPTED = 0, 2, 3, 130

command = Verbs(
    "palpate",
    "palpate.launch.cli",
    {
        "run": "Explore a scene and rebuild its object.",
        "launch": "Start the graph of a launch file.",
        "host": "Lend this machine to graphs that are launched elsewhere.",
        "keys": "Make the key that the machines of a graph share.",
        "replay": "Run nodes on a recording and compare what they say.",
        "bag": "Look into recordings, play, recover and compare them, and hand them on.",
        "scene": "List and check scenes.",
        "node": "Look at the nodes of a running graph, or at the kinds of node.",
        "topic": "Hear and speak on the topics of a running graph.",
        "param": "Look at the parameters of a running graph's nodes.",
        "doctor": "Say whether machine, installation and running graphs are well.",
        "init": "Begin a node, a driver, an effect or a planner of your own.",
        "calibrate": "Press a known flat and ball, and say what each taxel means.",
        "rebuild": "Rebuild a solid from contours that anybody measured.",
        "score": "Measure a solid against a CAD model or measured points.",
        "cost": "Say what a recorded run would have cost another robot.",
        "bench": "Measure speed and accuracy.",
        "chaos": "Put faults into explorations and say what they survive.",
    },
    "Feels an unknown object with a simulated fingertip and rebuilds it as a solid.",
)
click.version_option(__version__, prog_name="palpate")(command)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Do what the command line asks for, and exit.

    Parameters
    ----------
    arguments : texts, optional
        The command line without the program's name; the process's own if left out.
    """
    code = run(sys.argv[1:] if arguments is None else arguments)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # there is nothing left to interrupt
    sys.exit(code)


def run(arguments: Sequence[str]) -> int:
    """Do what the arguments ask for; returns the exit code."""
    try:
        code = command.main(list(arguments), prog_name="palpate", standalone_mode=False)
        sys.stdout.flush()
    except InputError as error:
        return _say(str(error), BAD_INPUT)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.ctx.get_help() if error.ctx else "", err=True)
        return BAD_INPUT
    except click.ClickException as error:
        return _say(_usage(error), BAD_INPUT)
    except SystemExit as error:
        # With 1 it is click's own answer to a pipe that was closed while it wrote.
        if error.code == 1:
            return DONE
        return _say(f"something in the program called exit({error.code}); nothing is done", DIED)
    except (KeyboardInterrupt, click.Abort):
        return _say("interrupted", INTERRUPTED)
    except BrokenPipeError:
        # Whoever read our output has had enough, as in ``palpate node kinds | head -1``.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except OSError as error:
        return _say(f"{error.filename or 'the system'}: {error.strerror or error}", BAD_INPUT)
    except Exception as error:  # the outermost boundary: a bug must not reach the screen raw
        return _say(_bug(error), DIED)
    return code if isinstance(code, int) else DONE


def _say(text: str, code: int) -> int:
    print(f"palpate: {' '.join(text.split())}", file=sys.stderr)
    return code


def _usage(error: click.ClickException) -> str:
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else "palpate"
    return f"{error.format_message().rstrip('.')} (see {path} --help)"


def _bug(error: Exception) -> str:
    with tempfile.NamedTemporaryFile(
        "w", prefix="palpate-", suffix=".txt", delete=False, encoding="utf-8"
    ) as file:
        traceback.print_exception(error, file=file)
    return f"a bug: {type(error).__name__}: {error!s:.200}; the traceback is in {file.name}"
