"""What a node says of itself a few times a second."""

from __future__ import annotations

import time

from palpate.messages.bus.station import Station
from palpate.messages.types import NodeStatus
from palpate.nodes.runtime_latency import Latency


def status_of(name: str, state: str, latency: Latency | None, station: Station) -> NodeStatus:
    """The node's counters.

    Parameters
    ----------
    name, state : str
        Of the node; see `NodeStatus`.
    latency : Latency or None
        Times of its handlers; None until it is loaded.
    station : Station
        Its sockets.
    """
    subscriber, publisher = station.subscriber, station.publisher
    return NodeStatus(
        node=name,
        state=state,  # type: ignore[arg-type]
        messages=latency.count if latency else 0,
        sent=sum(publisher.sent.values()),
        gaps=subscriber.gaps,
        duplicates=subscriber.duplicates,
        p50=latency.quantile(0.5) if latency else 0.0,
        p99=latency.quantile(0.99) if latency else 0.0,
        cpu=time.process_time(),
    )
