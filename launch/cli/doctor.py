"""``palpate doctor``: whether machine, installation and running graphs are well."""

from __future__ import annotations

import click


@click.command("doctor")
@click.option("-r", "--report", is_flag=True, help="Add versions, environment and graphs.")
def command(report: bool) -> int:
    """Look at machine, installation and running graphs, and say what to do.

    Exits with 1 if anything fails.
    """
    from palpate.launch.looking.graph_health import graphs_findings
    from palpate.launch.looking.machine import machine_findings
    from palpate.launch.looking.report import report_lines
    from palpate.launch.processes.register import running

    cards, failed = running(), False
    for look in (machine_findings(), graphs_findings(cards)):
        for finding in look:
            failed = failed or finding.level == "FAIL"
            click.echo(str(finding))
    for line in report_lines(cards) if report else ():
        click.echo(line)
    return int(failed)
