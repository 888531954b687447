"""Verbs on a running graph: topic, interface, node, param and doctor."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from palpate import messages
from palpate.launch.files.source_map import InputError, as_input_errors, hint
from palpate.launch.printing import TEXT_WIDTH
from palpate.tools.cli.command_line import (
    JSON,
    NODE,
    OPTIONAL_NODE,
    RUN,
    RUN_PATH,
    TOPIC,
    Command,
    NamedGroup,
    complete_topic,
    print_figures,
)

if TYPE_CHECKING:
    from palpate.launch.processes.registry import RunCard
    from palpate.tools.introspection.topics import Topic

PUB_HELP = """Publish BODY, a message's fields in YAML, on TOPIC.

A graph has one publisher for each topic. That node publishes it between two messages of its own,
so that it is recorded, received like any other message, published again if the node dies, and
known to a replay as not the node's own. Who publishes a topic that no node has is a console in the
launch file:

\b
    console: {params: {topics: {/finger/goal: TouchGoal}}}
"""
topic_group = NamedGroup("topic", help="Receive and publish on the topics of a running graph.")
node_group = NamedGroup("node", help="Look at the nodes of a running graph, and at all kinds.")
interface_group = NamedGroup("interface", help="Look at the types of messages.")
param_group = NamedGroup("param", help="Look at the parameters of a running graph's nodes.")


@topic_group.command("list", short_help="Name the topics.")
@RUN
@click.option("-t", "--show-types", is_flag=True, help="Add the type.")
@click.option("-c", "--count-topics", is_flag=True, help="Print only how many there are.")
@click.option("-v", "--verbose", is_flag=True, help="Add publishers and subscribers.")
@JSON
def topic_list_command(
    run: str | None, show_types: bool, count_topics: bool, verbose: bool, as_json: bool
) -> None:
    """Name the topics of the running graph."""
    from palpate.tools.introspection.topics import topics_of

    topics = topics_of(card_of(run)).values()
    if count_topics:
        click.echo(len(topics))
        return
    lines = []
    for topic in topics:
        line = f"{topic.name} [{topic.type}]" if show_types or verbose else topic.name
        if verbose:
            subscribers = ", ".join(topic.subscribers) or "nobody"
            line += f" from {', '.join(topic.publishers)} to {subscribers}"
        lines.append(wrapped(line))
    print_figures([topic_figures(one) for one in topics], "\n".join(lines), as_json=as_json)


def topic_figures(topic: Topic) -> dict[str, Any]:
    """A topic without the schema of its type."""
    return {name: value for name, value in topic._asdict().items() if name != "schema"}


@topic_group.command("type", short_help="Name the type of a topic.")
@TOPIC
@RUN
@JSON
def topic_type_command(topic: str, run: str | None, as_json: bool) -> None:
    """Name the message type of TOPIC."""
    from palpate.tools.introspection.topics import find_topic

    with as_input_errors():
        found = find_topic(card_of(run), topic).type
    print_figures(found, found, as_json=as_json)


@topic_group.command("find", short_help="Name the topics of a type.")
@click.argument("kind", metavar="TYPE")
@RUN
@JSON
def topic_find_command(kind: str, run: str | None, as_json: bool) -> None:
    """Name the topics that carry messages of TYPE."""
    from palpate.tools.introspection.topics import topics_of

    topics = topics_of(card_of(run)).values()
    found = [topic.name for topic in topics if topic.type == kind]
    if not found:
        raise InputError(f"no topic carries {kind}; {hint(kind, {one.type for one in topics})}")
    print_figures(found, "\n".join(found), as_json=as_json)


@topic_group.command("info", short_help="Say what a topic carries, from whom to whom.")
@TOPIC
@RUN
@click.option("-v", "--verbose", is_flag=True, help="Add the fields with their units.")
@JSON
def topic_info_command(topic: str, run: str | None, verbose: bool, as_json: bool) -> None:
    """Say what TOPIC carries, who publishes it and who subscribes."""
    from palpate.tools.introspection.echo import field_lines
    from palpate.tools.introspection.topics import find_topic, type_of

    with as_input_errors():
        found = find_topic(card_of(run), topic)
        cls = type_of(found) if verbose else None
    lines = [f"Type: {found.type or 'not known'}"]
    for what, nodes in (("Publisher", found.publishers), ("Subscription", found.subscribers)):
        lines.append(wrapped(f"{what} count: {len(nodes)}  {', '.join(nodes)}"))
    if cls is not None:
        lines += ["Fields:", *(f"  {line}" for line in field_lines(cls))]
    told = {} if cls is None else {"schema": messages.schema(cls)}
    print_figures({**topic_figures(found), **told}, "\n".join(lines), as_json=as_json)


@topic_group.command("echo", short_help="Print the messages of a topic.")
@TOPIC
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
    topic: str, run: str | None, fields: tuple[str, ...], wanted: str | None, **how: Any
) -> None:
    """Print the messages of TOPIC in YAML until the graph ends, or Ctrl-C.

    Copies may be lost on the way here, of which standard error tells; the graph loses nothing.
    """
    from palpate.tools.introspection.echo import (
        EchoFormat,
        LossReport,
        TextStyle,
        echo_topic,
        read_filter,
        read_path,
    )
    from palpate.tools.introspection.topics import find_topic, type_of

    card, csv, raw = card_of(run), how["csv"], how["raw"]
    lost: Callable[[str], None] = (lambda _: None) if how["no_lost_messages"] else print_aside
    with as_input_errors():
        found = find_topic(card, topic)
        cls = type_of(found) if fields or wanted is not None or not raw else None
        form = EchoFormat(
            paths=tuple(read_path(text, cls) for text in fields) if cls else (),
            style=TextStyle(not how["no_arr"], how["full_length"] or csv, how["flow_style"]),
            csv=csv,
            raw=raw,
            wanted=read_filter(wanted, cls) if cls and wanted is not None else None,
        )
        echo_topic(
            card,
            found,
            form,
            most=1 if how["once"] else how["most"],
            say=click.echo,
            tell=print_aside,
            losses=LossReport(found.name, lost),
        )


def measuring_options(command: Command) -> Command:
    """The arguments of a verb that measures topics."""
    size: dict[str, Any] = {"type": click.IntRange(2, 1_000_000), "default": 10_000}
    told = "Messages over which figures are taken."
    for option in (
        click.option("--duration", type=click.FloatRange(0.0, min_open=True), help="End after, s."),
        click.option("-a", "--all", "every", is_flag=True, help="All topics of the graph."),
        click.option("-w", "--window", show_default=True, help=told, **size),
        RUN,
        JSON,
        click.argument("topics", nargs=-1, metavar="TOPIC...", shell_complete=complete_topic),
    ):
        command = option(command)
    return command


def measure(topics: tuple[str, ...], run: str | None, verb: str, every: bool, **how: Any) -> None:
    """Measure topics of a running graph until it ends, the time is over, or Ctrl-C."""
    from palpate.tools.introspection import topics as measured

    if every == bool(topics):
        raise click.UsageError("name at least one topic, or take --all of them, not both")
    card = card_of(run)
    with as_input_errors():
        own, known = measured.STATUS_TOPICS, measured.topics_of(card)
        names = [name for name in known if name not in own] if every else topics
        found = measured.find_topics(card, names)
        say = {"hz": "rate_text", "bw": "bandwidth_text", "delay": "delay_text"}[verb]
        text = None if how["as_json"] else getattr(measured, say)
        monitor = measured.RateMonitor(found, how["window"], text, click.echo)
        monitor.run(card, found, how["duration"])


for verb, short, told in (
    (
        "hz",
        "often topics are published",
        "often TOPICs are published, by their publishers' own numbers and times",
    ),
    ("bw", "many bytes topics carry", "many bytes a second TOPICs carry"),
    (
        "delay",
        "long messages are on their way",
        "long messages of TOPICs are on their way to this tool",
    ),
):
    command = measuring_options(partial(measure, verb=verb))
    topic_group.command(verb, short_help=f"Measure how {short}.", help=f"Measure how {told}.")(
        command
    )


@topic_group.command("pub", short_help="Publish a message.", help=PUB_HELP)
@TOPIC
@click.argument("body")
@click.option("-r", "--rate", default=1.0, show_default=True, help="Messages in a second.")
@click.option("-1", "--once", is_flag=True, help="Publish once.")
@click.option("-t", "--times", type=click.IntRange(1), help="Publish so many times.")
@RUN
def topic_pub_command(topic: str, body: str, once: bool, times: int | None, **how: Any) -> None:
    """Publish a message; `PUB_HELP` says how."""
    from palpate.tools.introspection.requests import publish

    publish(topic, body, times=1 if once else times, echo=click.echo, **how)


@node_group.command("list", short_help="Name the nodes of a running graph.")
@RUN
@click.option("-a", "--all", "every", is_flag=True, help="Also nodes that have ended.")
@JSON
def node_list_command(run: str | None, every: bool, as_json: bool) -> None:
    """Name the nodes of the running graph."""
    from palpate.tools.introspection.requests import request

    card = card_of(run)
    names = [one.name for one in card.nodes]
    if not every:
        with as_input_errors():
            nodes = request(card, "status")["nodes"]
        names = [name for name, about in nodes.items() if about["pid"]]
    print_figures(sorted(names), "\n".join(sorted(names)), as_json=as_json)


@node_group.command("info", short_help="Say how a running node is doing, and its topics.")
@NODE
@RUN
@JSON
def node_info_command(node: str, run: str | None, as_json: bool) -> None:
    """Say how NODE is doing, its topics with publishers and subscribers, and its parameters."""
    from palpate.tools.introspection.requests import describe_node, node_text

    with as_input_errors():
        found = describe_node(card_of(run), node)
    print_figures(found, node_text(found), as_json=as_json)


@node_group.command("kinds", short_help="List the kinds of node and their topics.")
@click.argument("kind", required=False)
@JSON
def node_kinds_command(kind: str | None, as_json: bool) -> None:
    """Name the kinds of node; of one KIND, tell what it is, its topics and its parameters."""
    from palpate.launch.node_kinds import list_kinds
    from palpate.tools.introspection.descriptions import describe_kind, kind_text

    if kind is None:
        print_figures(list_kinds(), "\n".join(list_kinds()), as_json=as_json)
        return
    found = describe_kind(kind)
    print_figures(found, kind_text(found), as_json=as_json)


BAG_TYPES = click.option("--bag", **RUN_PATH, help="Also the types of this recording.")


@interface_group.command("list", short_help="Name the types of messages.")
@RUN
@BAG_TYPES
@JSON
def interface_list_command(run: str | None, bag: Path | None, as_json: bool) -> None:
    """Name the message types of palpate, and those of the running graph's own."""
    from palpate.tools.introspection.descriptions import known_interfaces

    names = list(known_interfaces(run, bag))
    print_figures(names, "\n".join(names), as_json=as_json)


@interface_group.command("show", short_help="Say what fields a type has, with their units.")
@click.argument("kind", metavar="TYPE")
@RUN
@BAG_TYPES
@JSON
def interface_show_command(kind: str, run: str | None, bag: Path | None, as_json: bool) -> None:
    """Say what fields messages of TYPE have: name, what it holds, unit, and what it means."""
    from palpate.tools.introspection.descriptions import (
        find_interface,
        interface_text,
        known_interfaces,
    )

    with as_input_errors():
        cls = find_interface(kind, known_interfaces(run, bag))
    print_figures(messages.schema(cls), interface_text(cls), as_json=as_json)


@param_group.command("list", short_help="Name the parameters.")
@OPTIONAL_NODE
@RUN
@JSON
def param_list_command(node: str | None, run: str | None, as_json: bool) -> None:
    """Name the parameters of NODE, or of all nodes."""
    from palpate.tools.introspection.requests import dump_params

    with as_input_errors():
        dumped = dump_params(card_of(run), node)
    found = {name: list(one["params"]) for name, one in dumped.items()}
    lines = [
        line
        for name, params in found.items()
        for line in (params if node else (f"{name}:", *(f"  {param}" for param in params)))
    ]
    print_figures(found, "\n".join(lines), as_json=as_json)


@param_group.command("get", short_help="Print a parameter and what is known of it.")
@NODE
@click.argument("param")
@RUN
@JSON
def param_get_command(node: str, param: str, run: str | None, as_json: bool) -> None:
    """Print the value of PARAM of NODE in YAML, with its type, unit, default and meaning."""
    from palpate.tools.introspection.descriptions import describe_param, param_text

    with as_input_errors():
        found = describe_param(card_of(run), node, param)
    print_figures(found, param_text(found), as_json=as_json)


@param_group.command("set", short_help="Set a parameter between two touches.")
@NODE
@click.argument("param")
@click.argument("value")
@RUN
def param_set_command(node: str, param: str, value: str, run: str | None) -> None:
    """Set PARAM of NODE to VALUE, in YAML, from the next touch on, or of the planner, model on.

    A length or a time may have a unit, as 0.1mm or 5min; without one it is in m or s. Only
    parameters that palpate node kinds NODE calls settable can be set. That it was set is recorded
    on the node's topic of ParameterEvents, and done at the same place in a replay.
    """
    from palpate.tools.introspection.descriptions import set_parameter

    with as_input_errors():
        click.echo(set_parameter(card_of(run), node, param, value))


@param_group.command("dump", short_help="Print parameters in YAML.")
@OPTIONAL_NODE
@RUN
@JSON
def param_dump_command(node: str | None, run: str | None, as_json: bool) -> None:
    """Print the parameters of NODE, or of all nodes, in YAML; bytes by their size and SHA-256."""
    from palpate.tools.introspection.echo import yaml_lines
    from palpate.tools.introspection.requests import dump_params

    with as_input_errors():
        found = dump_params(card_of(run), node)
    print_figures(found, "\n".join(yaml_lines(found)), as_json=as_json)


def card_of(run: str | None) -> RunCard:
    """The running graph that is meant; InputError if there is none, or several may be meant."""
    from palpate.launch.processes.registry import find_run

    with as_input_errors():
        return find_run(run)


def wrapped(line: str) -> str:
    """A line as lines of 80 columns."""
    return textwrap.fill(line, TEXT_WIDTH, subsequent_indent=" " * 4, break_on_hyphens=False)


def print_aside(text: str) -> None:
    """Say something beside the output."""
    click.echo(f"palpate: {text}", err=True)


@click.command("doctor")
@click.option("-r", "--report", is_flag=True, help="Add versions, environment and graphs.")
@JSON
def doctor_command(report: bool, as_json: bool) -> int:
    """Look at machine, installation and running graphs, and say what to do.

    Exits with 1 if anything fails.
    """
    from palpate.launch.processes.registry import running_graphs
    from palpate.tools.introspection.doctor import graphs_findings, machine_findings, report_lines

    cards, found = running_graphs(), []
    for look in (machine_findings(), graphs_findings(cards)):
        for finding in look:
            found.append(finding._asdict())
            if not as_json:  # some of it takes seconds to find out
                click.echo(str(finding))
    lines = list(report_lines(cards)) if report else []
    if as_json:
        print_figures({"findings": found, "report": lines}, "", as_json=True)
    else:
        for line in lines:
            click.echo(wrapped(line))
    return int(any(one["level"] == "FAIL" for one in found))
