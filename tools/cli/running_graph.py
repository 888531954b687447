"""Verbs on a running graph: topic, interface, node, param and doctor."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate import launch
from palpate.launch import processes
from palpate.launch.files import InputError, as_input_errors, hint
from palpate.tools import introspection
from palpate.tools.cli.command_line import PATH, RUN, Command, NamedGroup

if TYPE_CHECKING:
    from palpate.launch.processes import RunCard

PUB_HELP = """Publish BODY, a message's fields in YAML, on TOPIC.

A graph has one publisher for each topic. So what is to be published from outside belongs to a
console in its launch file:

\b
    console: {params: {topics: {/finger/goal: TouchGoal}}}

What is published is recorded and received like any other message.
"""
topic_group = NamedGroup("topic", help="Receive and publish on the topics of a running graph.")
node_group = NamedGroup(
    "node", help="Look at the nodes of a running graph, or at the kinds of node."
)
interface_group = NamedGroup("interface", help="Look at the types of messages.")
param_group = NamedGroup("param", help="Look at the parameters of a running graph's nodes.")


@topic_group.command("list", short_help="Name the topics.")
@RUN
@click.option("-t", "--show-types", is_flag=True, help="Add the type.")
@click.option("-c", "--count-topics", is_flag=True, help="Print only how many there are.")
@click.option("-v", "--verbose", is_flag=True, help="Add publishers and subscribers.")
def topic_list_command(
    run: str | None, show_types: bool, count_topics: bool, verbose: bool
) -> None:
    """Name the topics of the running graph."""
    topics = introspection.topics_of(card_of(run)).values()
    if count_topics:
        click.echo(len(topics))
        return
    for topic in topics:
        line = f"{topic.name} [{topic.type}]" if show_types or verbose else topic.name
        if verbose:
            subscribers = ", ".join(topic.subscribers) or "nobody"
            line += f" from {', '.join(topic.publishers)} to {subscribers}"
        click.echo(line)


@topic_group.command("type", short_help="Name the type of a topic.")
@click.argument("topic")
@RUN
def topic_type_command(topic: str, run: str | None) -> None:
    """Name the message type of TOPIC."""
    with as_input_errors():
        click.echo(introspection.find_topic(card_of(run), topic).type)


@topic_group.command("find", short_help="Name the topics of a type.")
@click.argument("kind", metavar="TYPE")
@RUN
def topic_find_command(kind: str, run: str | None) -> None:
    """Name the topics that carry messages of TYPE."""
    topics = introspection.topics_of(card_of(run)).values()
    found = [topic.name for topic in topics if topic.type == kind]
    if not found:
        raise InputError(f"no topic carries {kind}; {hint(kind, {one.type for one in topics})}")
    for name in found:
        click.echo(name)


@topic_group.command("info", short_help="Say what a topic carries, from whom to whom.")
@click.argument("topic")
@RUN
@click.option("-v", "--verbose", is_flag=True, help="Add the fields with their units.")
def topic_info_command(topic: str, run: str | None, verbose: bool) -> None:
    """Say what TOPIC carries, who publishes it and who subscribes."""
    with as_input_errors():
        found = introspection.find_topic(card_of(run), topic)
        lines = introspection.field_lines(introspection.type_of(found)) if verbose else []
    click.echo(f"Type: {found.type or 'not known'}")
    click.echo(f"Publisher count: {len(found.publishers)}  {', '.join(found.publishers)}")
    click.echo(
        f"Subscription count: {len(found.subscribers)}  {', '.join(found.subscribers)}".rstrip()
    )
    if lines:
        click.echo("Fields:")
    for line in lines:
        click.echo(f"  {line}")


@topic_group.command("echo", short_help="Print the messages of a topic.")
@click.argument("topic")
@RUN
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
    card, lost = card_of(run), (lambda _: None) if no_lost_messages else print_aside
    with as_input_errors():
        found = introspection.find_topic(card, topic)
        asks = fields or wanted is not None
        cls = introspection.type_of(found) if asks or not raw else None
        form = introspection.EchoFormat(
            paths=tuple(introspection.read_path(text, cls) for text in fields) if cls else (),
            style=introspection.TextStyle(not no_arr, full_length or csv, flow_style),
            csv=csv,
            raw=raw,
            wanted=introspection.read_filter(wanted, cls) if cls and wanted is not None else None,
        )
        introspection.echo_topic(
            card,
            found,
            form,
            most=1 if once else most,
            say=click.echo,
            tell=print_aside,
            losses=introspection.LossReport(found.name, lost),
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
        RUN,
        click.argument("topics", nargs=-1, metavar="TOPIC..."),
    ):
        command = option(command)
    return command


def measure(
    topics: tuple[str, ...],
    run: str | None,
    *,
    window: int,
    every: bool,
    duration: float | None,
    verb: str,
) -> None:
    """Measure topics of a running graph until it ends, the time is over, or Ctrl-C."""
    if every == bool(topics):
        raise click.UsageError("name at least one topic, or take --all of them, not both")
    card = card_of(run)
    with as_input_errors():
        own, known = introspection.STATUS_TOPICS, introspection.topics_of(card)
        names = [name for name in known if name not in own] if every else topics
        found = introspection.find_topics(card, names)
        say = {
            "hz": introspection.rate_text,
            "bw": introspection.bandwidth_text,
            "delay": introspection.delay_text,
        }[verb]
        introspection.RateMonitor(found, window, say, click.echo).run(card, found, duration)


for verb, short, told in (
    (
        "hz",
        "Measure how often topics are published.",
        "Measure how often TOPICs are published, by their publishers' own numbers and times.",
    ),
    ("bw", "Measure how many bytes topics carry.", "Measure how many bytes a second TOPICs carry."),
    (
        "delay",
        "Measure how long messages are on their way.",
        "Measure how long messages of TOPICs are on their way to this tool.",
    ),
):
    command = measuring_options(partial(measure, verb=verb))
    topic_group.command(verb, short_help=short, help=told)(command)


@topic_group.command("pub", short_help="Publish a message on a console's topic.", help=PUB_HELP)
@click.argument("topic")
@click.argument("body")
@click.option("-r", "--rate", default=1.0, show_default=True, help="Messages in a second.")
@click.option("-1", "--once", is_flag=True, help="Publish once.")
@click.option("-t", "--times", type=click.IntRange(1), help="Publish so many times.")
@RUN
def topic_pub_command(
    topic: str, body: str, rate: float, once: bool, times: int | None, run: str | None
) -> None:
    """Publish a message; `PUB_HELP` says how."""
    most = 1 if once else times
    introspection.publish(topic, body, rate=rate, times=most, run=run, echo=click.echo)


@node_group.command("list", short_help="Name the nodes of a running graph.")
@RUN
@click.option("-a", "--all", "every", is_flag=True, help="Also nodes that have ended.")
def node_list_command(run: str | None, every: bool) -> None:
    """Name the nodes of the running graph."""
    card = card_of(run)
    with as_input_errors():
        names = [one.name for one in card.nodes] if every else introspection.running_nodes(card)
    for name in sorted(names):
        click.echo(name)


@node_group.command("info", short_help="Say how a running node is doing, and its topics.")
@click.argument("node")
@RUN
def node_info_command(node: str, run: str | None) -> None:
    """Say how NODE is doing, its topics with publishers and subscribers, and its parameters."""
    with as_input_errors():
        click.echo(introspection.node_text(card_of(run), node))


@node_group.command("kinds", short_help="List the kinds of node and their topics.")
@click.argument("kind", required=False)
def node_kinds_command(kind: str | None) -> None:
    """Name the kinds of node; of one KIND, tell what it is, its topics and its parameters."""
    for line in launch.list_kinds() if kind is None else [introspection.kind_text(kind)]:
        click.echo(line)


BAG_TYPES = click.option("--bag", type=PATH, help="Also the types of this recording.")


@interface_group.command("list", short_help="Name the types of messages.")
@RUN
@BAG_TYPES
def interface_list_command(run: str | None, bag: Path | None) -> None:
    """Name the message types of palpate, and those of the running graph's own."""
    for name in introspection.known_interfaces(run, bag):
        click.echo(name)


@interface_group.command("show", short_help="Say what fields a type has, with their units.")
@click.argument("kind", metavar="TYPE")
@RUN
@BAG_TYPES
def interface_show_command(kind: str, run: str | None, bag: Path | None) -> None:
    """Say what fields messages of TYPE have: name, what it holds, unit, and what it means."""
    with as_input_errors():
        known = introspection.known_interfaces(run, bag)
        for line in introspection.interface_lines(kind, known):
            click.echo(line)


@param_group.command("list", short_help="Name the parameters.")
@click.argument("node", required=False)
@RUN
def param_list_command(node: str | None, run: str | None) -> None:
    """Name the parameters of NODE, or of all nodes."""
    with as_input_errors():
        for line in introspection.param_names(card_of(run), node):
            click.echo(line)


@param_group.command("get", short_help="Print a parameter and what is known of it.")
@click.argument("node")
@click.argument("param")
@RUN
def param_get_command(node: str, param: str, run: str | None) -> None:
    """Print the value of PARAM of NODE in YAML, with its type, unit, default and meaning."""
    with as_input_errors():
        click.echo(introspection.param_text(card_of(run), node, param))


@param_group.command("dump", short_help="Print parameters in YAML.")
@click.argument("node", required=False)
@RUN
def param_dump_command(node: str | None, run: str | None) -> None:
    """Print the parameters of NODE, or of all nodes, in YAML; bytes by their size and SHA-256."""
    with as_input_errors():
        click.echo(introspection.dump_params(card_of(run), node))


def card_of(run: str | None) -> RunCard:
    """The running graph that is meant; says which, if several run and none is named.

    Raises InputError if there is none, or several are meant.
    """
    with as_input_errors():
        card = processes.find_run(run)
    others = len(processes.running_graphs()) - 1
    if run is None and others > 0:
        print_aside(f"{others + 1} graphs run; this is the latest, {card.run[:6]} ({card.name})")
    return card


def print_aside(text: str) -> None:
    """Say something beside the output."""
    click.echo(f"palpate: {text}", err=True)


@click.command("doctor")
@click.option("-r", "--report", is_flag=True, help="Add versions, environment and graphs.")
def doctor_command(report: bool) -> int:
    """Look at machine, installation and running graphs, and say what to do.

    Exits with 1 if anything fails.
    """
    cards, failed = processes.running_graphs(), False
    for look in (introspection.machine_findings(), introspection.graphs_findings(cards)):
        for finding in look:
            failed = failed or finding.level == "FAIL"
            click.echo(str(finding))
    for line in introspection.report_lines(cards) if report else ():
        click.echo(line)
    return int(failed)
