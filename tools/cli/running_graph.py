"""Commands on a running graph: topic, interface, node, param and doctor."""

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

PUB_HELP = """Publish BODY, the fields of a message in YAML, on TOPIC.

A graph has one publisher for each topic. That node publishes the message between two of its own.
So it is recorded, received like any other message, published again if the node dies, and marked
for a replay. A topic without a node needs a console in the launch file:

\b
    console: {params: {topics: {/finger/goal: TouchGoal}}}
"""
topic_group = NamedGroup("topic", help="Receive and publish on the topics of a running graph.")
node_group = NamedGroup("node", help="Look at the nodes of a running graph, and at all kinds.")
interface_group = NamedGroup("interface", help="Look at the types of messages.")
param_group = NamedGroup("param", help="Look at the parameters of a running graph's nodes.")


@topic_group.command("list", short_help="List the topics.")
@RUN
@click.option("-t", "--show-types", is_flag=True, help="Add the type.")
@click.option("-c", "--count-topics", is_flag=True, help="Print only their number.")
@click.option("-v", "--verbose", is_flag=True, help="Add publishers and subscribers.")
@JSON
def topic_list_command(
    run: str | None, show_types: bool, count_topics: bool, verbose: bool, as_json: bool
) -> None:
    """List the topics of the running graph."""
    from palpate.tools.introspection.topics import topics_of

    topics = topics_of(card_of(run)).values()
    if count_topics:
        click.echo(len(topics))
        return
    lines = []
    for topic in topics:
        line = f"{topic.name} [{topic.type}]" if show_types or verbose else topic.name
        if verbose:
            subscribers = ", ".join(topic.subscribers) or "no node"
            line += f" from {', '.join(topic.publishers)} to {subscribers}"
        lines.append(wrapped(line))
    print_figures([*map(topic_figures, topics)], "\n".join(lines), as_json=as_json)


def topic_figures(topic: Topic) -> dict[str, Any]:
    """A topic without the schema of its type."""
    return {name: value for name, value in topic._asdict().items() if name != "schema"}


@topic_group.command("type", short_help="Show the type of a topic.")
@TOPIC
@RUN
@JSON
def topic_type_command(topic: str, run: str | None, as_json: bool) -> None:
    """Show the message type of TOPIC."""
    from palpate.tools.introspection.topics import find_topic

    with as_input_errors():
        kind = find_topic(card_of(run), topic).type
    print_figures(kind, kind, as_json=as_json)


@topic_group.command("find", short_help="List the topics of a type.")
@click.argument("kind", metavar="TYPE")
@RUN
@JSON
def topic_find_command(kind: str, run: str | None, as_json: bool) -> None:
    """List the topics that carry messages of TYPE."""
    from palpate.tools.introspection.topics import topics_of

    topics = topics_of(card_of(run)).values()
    names = [topic.name for topic in topics if topic.type == kind]
    if not names:
        raise InputError(f"no topic carries {kind}; {hint(kind, {topic.type for topic in topics})}")
    print_figures(names, "\n".join(names), as_json=as_json)


@topic_group.command("info", short_help="Show type, publishers and subscribers of a topic.")
@TOPIC
@RUN
@click.option("-v", "--verbose", is_flag=True, help="Add the fields with their units.")
@JSON
def topic_info_command(topic: str, run: str | None, verbose: bool, as_json: bool) -> None:
    """Show the type of TOPIC, its publishers and its subscribers."""
    from palpate.tools.introspection.echo import field_lines
    from palpate.tools.introspection.topics import find_topic, type_of

    with as_input_errors():
        found_topic = find_topic(card_of(run), topic)
        cls = type_of(found_topic) if verbose else None
    lines = [f"Type: {found_topic.type or 'unknown'}"]
    for what, nodes in (
        ("Publisher", found_topic.publishers),
        ("Subscription", found_topic.subscribers),
    ):
        lines.append(wrapped(f"{what} count: {len(nodes)}  {', '.join(nodes)}"))
    if cls is not None:
        lines += ["Fields:", *(f"  {line}" for line in field_lines(cls))]
    extra = {} if cls is None else {"schema": messages.schema(cls)}
    print_figures({**topic_figures(found_topic), **extra}, "\n".join(lines), as_json=as_json)


@topic_group.command("echo", short_help="Print the messages of a topic.")
@TOPIC
@RUN
@click.option("--once", is_flag=True, help="Print one message and end.")
@click.option("-n", "most", type=click.IntRange(1), help="Print so many messages and end.")
@click.option("--field", "fields", multiple=True, metavar="A.B", help="One value; repeatable.")
@click.option("--filter", "wanted", metavar="EXPR", help="Such as touch > 3 and outcome == 'hit'.")
@click.option("--csv", is_flag=True, help="A row for each message, with whole arrays.")
@click.option("--raw", is_flag=True, help="Undecoded bytes.")
@click.option("--no-arr", is_flag=True, help="Only kinds of arrays and lists.")
@click.option("-f", "--full-length", is_flag=True, help="Whole long arrays.")
@click.option("--flow-style", is_flag=True, help="Each message on one line.")
@click.option("--no-lost-messages", is_flag=True, help="Do not report lost messages.")
def topic_echo_command(
    topic: str, run: str | None, fields: tuple[str, ...], wanted: str | None, **how: Any
) -> None:
    """Print the messages of TOPIC in YAML until the graph ends, or Ctrl-C.

    Copies may be lost on the way here, which standard error reports; the graph loses nothing.
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
        found_topic = find_topic(card, topic)
        cls = type_of(found_topic) if fields or wanted is not None or not raw else None
        form = EchoFormat(
            paths=tuple(read_path(text, cls) for text in fields) if cls else (),
            style=TextStyle(not how["no_arr"], how["full_length"] or csv, how["flow_style"]),
            csv=csv,
            raw=raw,
            wanted=read_filter(wanted, cls) if cls and wanted is not None else None,
        )
        echo_topic(
            card,
            found_topic,
            form,
            most=1 if how["once"] else how["most"],
            say=click.echo,
            tell=print_aside,
            losses=LossReport(found_topic.name, lost),
        )


def measuring_options(command: Command) -> Command:
    """Add the arguments of a command that measures topics."""
    size: dict[str, Any] = {"type": click.IntRange(2, 1_000_000), "default": 10_000}
    window_help = "Number of messages over which figures are taken."
    for option in (
        click.option("--duration", type=click.FloatRange(0.0, min_open=True), help="End after, s."),
        click.option("-a", "--all", "all_topics", is_flag=True, help="All topics of the graph."),
        click.option("-w", "--window", show_default=True, help=window_help, **size),
        RUN,
        JSON,
        click.argument("topics", nargs=-1, metavar="TOPIC...", shell_complete=complete_topic),
    ):
        command = option(command)
    return command


def measure(
    topics: tuple[str, ...], run: str | None, verb: str, all_topics: bool, **how: Any
) -> None:
    """Measure topics of a running graph until it ends, the time is over, or Ctrl-C."""
    from palpate.tools.introspection import topics as measured

    if all_topics == bool(topics):
        raise click.UsageError("name at least one topic, or choose --all of them, not both")
    card = card_of(run)
    with as_input_errors():
        own, known = measured.STATUS_TOPICS, measured.topics_of(card)
        names = [name for name in known if name not in own] if all_topics else topics
        chosen = measured.find_topics(card, names)
        say = {"hz": "rate_text", "bw": "bandwidth_text", "delay": "delay_text"}[verb]
        text = None if how["as_json"] else getattr(measured, say)
        monitor = measured.RateMonitor(chosen, how["window"], text, click.echo)
        monitor.run(card, chosen, how["duration"])


for verb, short, long in (
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
    topic_group.command(verb, short_help=f"Measure how {short}.", help=f"Measure how {long}.")(
        command
    )


@topic_group.command("pub", short_help="Publish a message.", help=PUB_HELP)
@TOPIC
@click.argument("body")
@click.option("-r", "--rate", default=1.0, show_default=True, help="Messages per second.")
@click.option("-1", "--once", is_flag=True, help="Publish once.")
@click.option("-t", "--times", type=click.IntRange(1), help="Number of messages.")
@RUN
def topic_pub_command(topic: str, body: str, once: bool, times: int | None, **how: Any) -> None:
    """Publish a message; see `PUB_HELP`."""
    from palpate.tools.introspection.requests import publish

    publish(topic, body, times=1 if once else times, echo=click.echo, **how)


@node_group.command("list", short_help="List the nodes of a running graph.")
@RUN
@click.option("-a", "--all", "all_nodes", is_flag=True, help="Also nodes that have ended.")
@JSON
def node_list_command(run: str | None, all_nodes: bool, as_json: bool) -> None:
    """List the nodes of the running graph."""
    from palpate.tools.introspection.requests import request

    card = card_of(run)
    names = [node.name for node in card.nodes]
    if not all_nodes:
        with as_input_errors():
            nodes = request(card, "status")["nodes"]
        names = [name for name, about in nodes.items() if about["pid"]]
    print_figures(sorted(names), "\n".join(sorted(names)), as_json=as_json)


@node_group.command("info", short_help="Show state and topics of a running node.")
@NODE
@RUN
@JSON
def node_info_command(node: str, run: str | None, as_json: bool) -> None:
    """Show the state of NODE, its topics with publishers and subscribers, and its parameters."""
    from palpate.tools.introspection.requests import describe_node, node_text

    with as_input_errors():
        about = describe_node(card_of(run), node)
    print_figures(about, node_text(about), as_json=as_json)


@node_group.command("kinds", short_help="List the kinds of node and their topics.")
@click.argument("kind", required=False)
@JSON
def node_kinds_command(kind: str | None, as_json: bool) -> None:
    """List the kinds of node, or describe one KIND, its topics and its parameters."""
    from palpate.launch.node_kinds import list_kinds
    from palpate.tools.introspection.descriptions import describe_kind, kind_text

    if kind is None:
        print_figures(list_kinds(), "\n".join(list_kinds()), as_json=as_json)
        return
    described = describe_kind(kind)
    print_figures(described, kind_text(described), as_json=as_json)


BAG_TYPES = click.option("--bag", **RUN_PATH, help="Also types of this recording.")


@interface_group.command("list", short_help="List the types of messages.")
@RUN
@BAG_TYPES
@JSON
def interface_list_command(run: str | None, bag: Path | None, as_json: bool) -> None:
    """List the message types of palpate and of the running graph."""
    from palpate.tools.introspection.descriptions import known_interfaces

    names = list(known_interfaces(run, bag))
    print_figures(names, "\n".join(names), as_json=as_json)


@interface_group.command("show", short_help="Show the fields of a type with their units.")
@click.argument("kind", metavar="TYPE")
@RUN
@BAG_TYPES
@JSON
def interface_show_command(kind: str, run: str | None, bag: Path | None, as_json: bool) -> None:
    """Show the fields of messages of TYPE: name, kind, unit, and meaning."""
    from palpate.tools.introspection.descriptions import (
        find_interface,
        interface_text,
        known_interfaces,
    )

    with as_input_errors():
        cls = find_interface(kind, known_interfaces(run, bag))
    print_figures(messages.schema(cls), interface_text(cls), as_json=as_json)


@param_group.command("list", short_help="List the parameters.")
@OPTIONAL_NODE
@RUN
@JSON
def param_list_command(node: str | None, run: str | None, as_json: bool) -> None:
    """List the parameters of NODE, or of all nodes."""
    from palpate.tools.introspection.requests import dump_params

    with as_input_errors():
        dumped = dump_params(card_of(run), node)
    names = {name: list(node_params["params"]) for name, node_params in dumped.items()}
    lines = [
        line
        for name, params in names.items()
        for line in (params if node else (f"{name}:", *(f"  {param}" for param in params)))
    ]
    print_figures(names, "\n".join(lines), as_json=as_json)


@param_group.command("get", short_help="Print a parameter and its description.")
@NODE
@click.argument("param")
@RUN
@JSON
def param_get_command(node: str, param: str, run: str | None, as_json: bool) -> None:
    """Print the value of PARAM of NODE in YAML, with its type, unit, default and meaning."""
    from palpate.tools.introspection.descriptions import describe_param, param_text

    with as_input_errors():
        described = describe_param(card_of(run), node, param)
    print_figures(described, param_text(described), as_json=as_json)


@param_group.command("set", short_help="Set a parameter between two touches.")
@NODE
@click.argument("param")
@click.argument("value")
@RUN
def param_set_command(node: str, param: str, value: str, run: str | None) -> None:
    """Set PARAM of NODE to VALUE, in YAML, from the next touch on; of the planner, the next model.

    A length or a time may have a unit, such as 0.1mm or 5min; without one it is in m or s. Only
    parameters that palpate node kinds NODE calls settable can be set. The change is recorded on the
    node's topic of ParameterEvents, and repeated at the same place in a replay.
    """
    from palpate.tools.introspection.descriptions import set_parameter

    with as_input_errors():
        click.echo(set_parameter(card_of(run), node, param, value))


@param_group.command("dump", short_help="Print parameters in YAML.")
@OPTIONAL_NODE
@RUN
@JSON
def param_dump_command(node: str | None, run: str | None, as_json: bool) -> None:
    """Print the parameters of NODE, or of all nodes, in YAML; bytes as size and SHA-256."""
    from palpate.tools.introspection.echo import yaml_lines
    from palpate.tools.introspection.requests import dump_params

    with as_input_errors():
        dumped = dump_params(card_of(run), node)
    print_figures(dumped, "\n".join(yaml_lines(dumped)), as_json=as_json)


def card_of(run: str | None) -> RunCard:
    """A running graph; raises InputError if there is none, or the name is ambiguous."""
    from palpate.launch.processes.registry import find_run

    with as_input_errors():
        return find_run(run)


def wrapped(line: str) -> str:
    """A line folded to 80 columns."""
    return textwrap.fill(line, TEXT_WIDTH, subsequent_indent=" " * 4, break_on_hyphens=False)


def print_aside(text: str) -> None:
    """Print a remark on standard error."""
    click.echo(f"palpate: {text}", err=True)


@click.command("doctor")
@click.option("-r", "--report", is_flag=True, help="Add versions, environment and graphs.")
@JSON
def doctor_command(report: bool, as_json: bool) -> int:
    """Check machine, installation and running graphs, and give advice.

    Exits with 1 if anything fails.
    """
    from palpate.launch.processes.registry import running_graphs
    from palpate.tools.introspection.doctor import graphs_findings, machine_findings, report_lines

    cards, findings = running_graphs(), []
    for check in (machine_findings(), graphs_findings(cards)):
        for finding in check:
            findings.append(finding._asdict())
            if not as_json:  # some checks take seconds
                click.echo(str(finding))
    lines = list(report_lines(cards)) if report else []
    if as_json:
        print_figures({"findings": findings, "report": lines}, "", as_json=True)
    else:
        for line in lines:
            click.echo(wrapped(line))
    return int(any(finding["level"] == "FAIL" for finding in findings))
