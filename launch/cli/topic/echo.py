"""``palpate topic echo``: the messages of a topic, as they come."""

from __future__ import annotations

import click

from palpate.launch.cli.looking import card_of, refusals, run_option, tell


@click.command("echo")
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
def command(
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
    from palpate.launch.looking.echoing import Form, Losses, echo_topic
    from palpate.launch.looking.field_path import read_path
    from palpate.launch.looking.filtering import read_filter
    from palpate.launch.looking.showing import Style
    from palpate.launch.looking.topics import find_topic, type_of

    card = card_of(run)
    with refusals():
        found = find_topic(card, topic)
        asks = fields or wanted is not None
        cls = type_of(found) if asks or not raw else None
        form = Form(
            paths=tuple(read_path(text, cls) for text in fields) if cls else (),
            style=Style(arrays=not no_arr, full=full_length or csv, flow=flow_style),
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
            tell=tell,
            losses=Losses(found.name, (lambda _: None) if no_lost_messages else tell),
        )
