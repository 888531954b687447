"""Verbs on a running graph: topic, node, param and doctor."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from palpate.launch.files import InputError
from palpate.tools.cli.command_line import NamedGroup

if TYPE_CHECKING:
    from palpate.launch.processes import RunCard
    from palpate.tools.introspection import RateText

topic_group = NamedGroup("topic", help="Receive and publish on the topics of a running graph.")
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


@topic_group.command("list", short_help="Name the topics.")
@run_option
@click.option("-t", "--show-types", is_flag=True, help="Add the type.")
@click.option("-c", "--count-topics", is_flag=True, help="Print only how many there are.")
@click.option("-v", "--verbose", is_flag=True, help="Add publishers and subscribers.")
def topic_list_command(
    run: str | None, show_types: bool, count_topics: bool, verbose: bool
) -> None:
    """Name the topics of the running graph."""
    from palpate.tools.introspection import topics_of

    topics = topics_of(card_of(run)).values()
    if count_topics:
        click.echo(len(topics))
        return
    for topic in topics:
        line = f"{topic.name} [{topic.type}]" if show_types or verbose else topic.name
        if verbose:
            listeners = ", ".join(topic.listeners) or "nobody"
            line += f" from {', '.join(topic.publishers)} to {listeners}"
        click.echo(line)


@topic_group.command("info", short_help="Say what a topic carries, from whom to whom.")
@click.argument("topic")
@run_option
@click.option("-v", "--verbose", is_flag=True, help="Add the fields with their units.")
def topic_info_command(topic: str, run: str | None, verbose: bool) -> None:
    """Say what TOPIC carries, who publishes it and who subscribes."""
    from palpate.tools.introspection import field_lines, find_topic, type_of

    with as_input_errors():
        found = find_topic(card_of(run), topic)
        lines = field_lines(type_of(found)) if verbose else []
    click.echo(f"Type: {found.type or 'not known'}")
    click.echo(f"Publisher count: {len(found.publishers)}  {', '.join(found.publishers)}")
    click.echo(f"Subscription count: {len(found.listeners)}  {', '.join(found.listeners)}".rstrip())
    if lines:
        click.echo("Fields:")
    for line in lines:
        click.echo(f"  {line}")


@topic_group.command("echo", short_help="Print the messages of a topic.")
@click.argument("topic")
@run_option
@click.option("--once", is_flag=True, help="Print one message and end.")
@click.option("-n", "most", type=click.IntRange(1), help="Print so many messages and end.")
@click.option("--field", "fields", multiple=True, metavar="A.B", help="One value; repeatable.")
@click.option("--filter", "wanted", metavar="EXPR", help="Like touch > 3 and outcome == 'hit'.")
@click.option("--csv", is_flag=True, help="One row a message, arrays whole.")
@click.option("--raw", is_flag=True, help="The bytes as they come.")
@click.option("--no-arr", is_flag=True, help="Of arrays and lists only what they are.")
@click.option("-f", "--full-length", is_flag=True, help="Long arrays whole.")
@click.option("--flow-style", is_flag=True, help="Each message in one line.")
@click.option("--no-lost-messages", is_flag=True, help="Do not say how many were lost.")
def topic_echo_command(
    topic: str,
    run: str | None,
    once: bool,
    most: int | None,
    fields: tuple[str, ...],
    wanted: str | None,
    csv: bool,
    raw: bool,
    no_arr: bool,
    full_length: bool,
    flow_style: bool,
    no_lost_messages: bool,
) -> None:
    """Print the messages of TOPIC in YAML until the graph ends, or Ctrl-C.

    Copies may be lost on the way here, of which standard error tells; the graph loses nothing.
    """
    from palpate.tools.introspection import (
        EchoFormat,
        LossReport,
        TextStyle,
        echo_topic,
        find_topic,
        read_filter,
        read_path,
        type_of,
    )

    card = card_of(run)
    with as_input_errors():
        found = find_topic(card, topic)
        asks = fields or wanted is not None
        cls = type_of(found) if asks or not raw else None
        form = EchoFormat(
            paths=tuple(read_path(text, cls) for text in fields) if cls else (),
            style=TextStyle(arrays=not no_arr, full=full_length or csv, flow=flow_style),
            csv=csv,
            raw=raw,
            wanted=read_filter(wanted, cls) if cls and wanted is not None else None,
        )
        echo_topic(
            card,
            found,
            form,
            most=1 if once else most,
            say=click.echo,
            tell=print_aside,
            losses=LossReport(found.name, (lambda _: None) if no_lost_messages else print_aside),
        )


def measuring_options(command: Command) -> Command:
    """The arguments of a verb that measures topics."""
    for option in (
        click.option("--duration", type=click.FloatRange(0.0, min_open=True), help="End after, s."),
        click.option("-a", "--all", "every", is_flag=True, help="All topics of the graph."),
        click.option(
            "-w",
            "--window",
            type=click.IntRange(2, 1_000_000),
            default=10_000,
            show_default=True,
            help="Messages over which figures are taken.",
        ),
        run_option,
        click.argument("topics", nargs=-1, metavar="TOPIC..."),
    ):
        command = option(command)
    return command


@topic_group.command("hz", short_help="Measure how often topics are published.")
@measuring_options
def topic_hz_command(
    topics: tuple[str, ...], run: str | None, window: int, every: bool, duration: float | None
) -> None:
    """Measure how often TOPICs are published, by their publishers' own numbers and times."""
    from palpate.tools.introspection import rate_text

    measure(topics, run, window=window, every=every, duration=duration, say=rate_text)


@topic_group.command("bw", short_help="Measure how many bytes topics carry.")
@measuring_options
def topic_bw_command(
    topics: tuple[str, ...], run: str | None, window: int, every: bool, duration: float | None
) -> None:
    """Measure how many bytes a second TOPICs carry."""
    from palpate.tools.introspection import bandwidth_text

    measure(topics, run, window=window, every=every, duration=duration, say=bandwidth_text)


@topic_group.command("delay", short_help="Measure how long messages are on their way.")
@measuring_options
def topic_delay_command(
    topics: tuple[str, ...], run: str | None, window: int, every: bool, duration: float | None
) -> None:
    """Measure how long messages of TOPICs are on their way to this tool."""
    from palpate.tools.introspection import delay_text

    measure(topics, run, window=window, every=every, duration=duration, say=delay_text)


def measure(
    topics: tuple[str, ...],
    run: str | None,
    *,
    window: int,
    every: bool,
    duration: float | None,
    say: RateText,
) -> None:
    """Measure topics of a running graph until it ends, the time is over, or Ctrl-C."""
    from palpate.tools.introspection import STATUS_TOPICS, RateMonitor, find_topics, topics_of

    if every == bool(topics):
        raise click.UsageError("name at least one topic, or take --all of them, not both")
    card = card_of(run)
    with as_input_errors():
        if every:
            found = [one for name, one in topics_of(card).items() if name not in STATUS_TOPICS]
        else:
            found = find_topics(card, topics)
        RateMonitor(found, window, say, click.echo).run(card, found, duration)


@topic_group.command("pub", short_help="Publish a message on a console's topic.")
@click.argument("topic")
@click.argument("body")
@click.option("-r", "--rate", default=1.0, show_default=True, help="Messages in a second.")
@click.option("-1", "--once", is_flag=True, help="Publish once.")
@click.option("-t", "--times", type=click.IntRange(1), help="Publish so many times.")
@click.option("--run", metavar="ID", help="Which running graph; the latest if left out.")
def topic_pub_command(
    topic: str, body: str, rate: float, once: bool, times: int | None, run: str | None
) -> None:
    r"""Publish BODY, a message's fields in YAML, on TOPIC.

    A graph has one publisher for each topic. So what is to be published from outside belongs to a
    console in its launch file:

    \b
        console: {params: {topics: {/finger/goal: TouchGoal}}}

    What is published is recorded and received like any other message.
    """
    from palpate.tools.introspection import publish

    publish(topic, body, rate=rate, times=1 if once else times, run=run, echo=click.echo)


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


@node_group.command("info", short_help="Say how a running node is doing, and its topics.")
@click.argument("node")
@run_option
def node_info_command(node: str, run: str | None) -> None:
    """Say how NODE is doing, its topics with publishers and subscribers, and its parameters."""
    from palpate.tools.introspection import node_text

    with as_input_errors():
        click.echo(node_text(card_of(run), node))


@node_group.command("kinds", short_help="List the kinds of node and their topics.")
@click.argument("kind", required=False)
def node_kinds_command(kind: str | None) -> None:
    """Name the kinds of node; of one KIND, tell its topics and its parameters."""
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


def card_of(run: str | None) -> RunCard:
    """The running graph that is meant; says which, if several run and none is named.

    Raises InputError if there is none, or several are meant.
    """
    from palpate.launch.processes import find_run, running_graphs

    with as_input_errors():
        card = find_run(run)
    others = len(running_graphs()) - 1
    if run is None and others > 0:
        print_aside(f"{others + 1} graphs run; this is the latest, {card.run[:6]} ({card.name})")
    return card


@contextmanager
def as_input_errors() -> Iterator[None]:
    """What cannot be done is one sentence for the user."""
    try:
        yield
    except ValueError as error:
        raise InputError(str(error)) from None


def print_aside(text: str) -> None:
    """Say something beside the output."""
    click.echo(f"palpate: {text}", err=True)


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
