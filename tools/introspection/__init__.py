"""Looking at a running graph: its topics by taps, its launcher by requests, its machine.

Copies may be lost on the way to a tool, the graph itself is never held up; patience and print
intervals may be tuned. Rests on launch.processes (which graphs run) and on palpate.messages.bus.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.tools.introspection.descriptions import describe_kind, describe_param
    from palpate.tools.introspection.descriptions import find_interface, interface_text, kind_text
    from palpate.tools.introspection.descriptions import known_interfaces, param_text, set_parameter
    from palpate.tools.introspection.doctor import graphs_findings, machine_findings, report_lines
    from palpate.tools.introspection.echo import EchoFormat, LossReport, TextStyle, echo_topic
    from palpate.tools.introspection.echo import field_lines, read_filter, read_path, yaml_lines
    from palpate.tools.introspection.requests import control_player, describe_node, dump_params
    from palpate.tools.introspection.requests import node_text, notify, publish, request
    from palpate.tools.introspection.topics import STATUS_TOPICS, TICK, RateMonitor, TapSubscription
    from palpate.tools.introspection.topics import Topic, bandwidth_text, delay_text, find_topic
    from palpate.tools.introspection.topics import find_topics, is_running, message_of, rate_text
    from palpate.tools.introspection.topics import taps_of, topics_of, type_of
else:
    __getattr__, __dir__ = lazy(__name__)
