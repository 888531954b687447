"""Looking at a running graph: its topics by taps, its launcher by requests, its machine.

Copies may be lost on the way to a tool, the graph itself is never held up; patience and print
intervals may be tuned. Rests on launch.processes (which graphs run) and on palpate.messages.bus.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.tools.introspection.doctor import graphs_findings as graphs_findings
    from palpate.tools.introspection.doctor import machine_findings as machine_findings
    from palpate.tools.introspection.doctor import report_lines as report_lines
    from palpate.tools.introspection.echo import EchoFormat as EchoFormat
    from palpate.tools.introspection.echo import LossReport as LossReport
    from palpate.tools.introspection.echo import TextStyle as TextStyle
    from palpate.tools.introspection.echo import echo_topic as echo_topic
    from palpate.tools.introspection.echo import field_lines as field_lines
    from palpate.tools.introspection.echo import read_filter as read_filter
    from palpate.tools.introspection.echo import read_path as read_path
    from palpate.tools.introspection.rates import RateMonitor as RateMonitor
    from palpate.tools.introspection.rates import bandwidth_text as bandwidth_text
    from palpate.tools.introspection.rates import delay_text as delay_text
    from palpate.tools.introspection.rates import rate_text as rate_text
    from palpate.tools.introspection.requests import control_player as control_player
    from palpate.tools.introspection.requests import dump_params as dump_params
    from palpate.tools.introspection.requests import node_text as node_text
    from palpate.tools.introspection.requests import notify as notify
    from palpate.tools.introspection.requests import publish as publish
    from palpate.tools.introspection.requests import request as request
    from palpate.tools.introspection.requests import running_nodes as running_nodes
    from palpate.tools.introspection.topics import STATUS_TOPICS as STATUS_TOPICS
    from palpate.tools.introspection.topics import TapSubscription as TapSubscription
    from palpate.tools.introspection.topics import Topic as Topic
    from palpate.tools.introspection.topics import find_topic as find_topic
    from palpate.tools.introspection.topics import find_topics as find_topics
    from palpate.tools.introspection.topics import topics_of as topics_of
    from palpate.tools.introspection.topics import type_of as type_of
else:
    __getattr__, __dir__ = lazy(__name__)
